"""Many depth maps: the result of a batch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from depthwarp.depth_map import DepthMap
from depthwarp.errors import InputError

__all__ = ["DepthMaps"]


MOST_SHOWN = 4
"""Maps that the text of a batch tells of."""


class DepthMaps:
    """The depth maps of a batch, in the order of its cameras.

    Args:
        maps: The maps; sizes and camera models may differ.
        names: The cameras' names, all different, if they have some.

    Raises:
        InputError: Another number of names than of maps.

    Example:
        >>> import numpy as np, depthwarp as dw
        >>> cloud = dw.PointCloud(np.array([[2.0, 0.0, 0.0]], np.float32))
        >>> camera = dw.PinholeCamera.from_fov((60, 45), (4, 3))
        >>> maps = dw.render_batch(cloud, {"left": camera, "right": camera}, device="cpu")
        >>> maps["right"]
        DepthMap(4 x 3 px, PinholeCamera, range, 8.3% not empty)
    """

    def __init__(self, maps: Sequence[DepthMap], names: Sequence[str] | None = None) -> None:
        self._maps = tuple(maps)
        self._names = None if names is None else tuple(names)
        if self._names is not None and len(self._names) != len(self._maps):
            raise InputError(
                f"names must be one for each map, got {len(self._names)} names and "
                f"{len(self._maps)} maps"
            )

    @property
    def names(self) -> tuple[str, ...] | None:
        """The cameras' names, in order; None of a batch of a list."""
        return self._names

    def __len__(self) -> int:
        """The number of views."""
        return len(self._maps)

    def __iter__(self) -> Iterator[DepthMap]:
        """The maps of all views, in order."""
        return iter(self._maps)

    def __repr__(self) -> str:
        """How many maps, their names, and what the first ones are."""
        labels = [""] * len(self) if self._names is None else [f"{n}: " for n in self._names]
        shown = [
            f"{label}{depth_map!r}"
            for label, depth_map in zip(labels[:MOST_SHOWN], self._maps[:MOST_SHOWN], strict=True)
        ]
        more = ", ..." if len(self) > MOST_SHOWN else ""
        return f"DepthMaps of {len(self)} views ({', '.join(shown)}{more})"

    @overload
    def __getitem__(self, view: int | str) -> DepthMap: ...

    @overload
    def __getitem__(self, view: slice) -> DepthMaps: ...

    def __getitem__(self, view: int | str | slice) -> DepthMap | DepthMaps:
        """The map of a view, by number or by name, or the maps of some.

        Raises:
            IndexError: There is no view of that number.
            KeyError: There is no view of that name; the message lists those that there are.
        """
        if isinstance(view, slice):
            return DepthMaps(self._maps[view], None if self._names is None else self._names[view])
        if isinstance(view, str):
            return self._maps[self._number_of(view)]
        return self._maps[view]

    def _number_of(self, name: str) -> int:
        if self._names is None:
            raise KeyError(f"no view '{name}': the batch was rendered of a list, without names")
        if name not in self._names:
            raise KeyError(f"no view '{name}'; there are {', '.join(self._names)}")
        return self._names.index(name)

    @property
    def depth(self) -> npt.NDArray[np.float32]:
        """Depth [m], shape (V, H, W), 0 = empty; of views of one size."""
        return self._stacked("depth")

    @property
    def index(self) -> npt.NDArray[np.int32]:
        """Row of the cloud whose point gave the depth, shape (V, H, W), -1 = empty."""
        return self._stacked("index")

    @property
    def state(self) -> npt.NDArray[np.uint8]:
        """How the pixels came about, shape (V, H, W), values of `State`."""
        return self._stacked("state")

    def _stacked(self, name: str) -> npt.NDArray[Any]:
        sizes = sorted({depth_map.camera.size for depth_map in self._maps})
        if len(sizes) > 1:
            raise InputError(
                f"views of {len(sizes)} sizes do not stack into one array "
                f"({', '.join(f'{width} x {height}' for width, height in sizes[:4])}): "
                "take the maps one by one, e.g. maps[0].depth"
            )
        return np.stack([getattr(depth_map, name) for depth_map in self._maps])
