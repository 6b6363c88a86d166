"""Many depth maps: the result of a batch."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, overload

import numpy as np
import numpy.typing as npt

from depthwarp.depth_map import DepthMap
from depthwarp.errors import InputError

__all__ = ["DepthMaps"]


class DepthMaps:
    """The depth maps of a batch, in the order of its cameras.

    Args:
        maps: The maps; sizes and camera models may differ.
    """

    def __init__(self, maps: Sequence[DepthMap]) -> None:
        self._maps = tuple(maps)

    def __len__(self) -> int:
        """The number of views."""
        return len(self._maps)

    def __iter__(self) -> Iterator[DepthMap]:
        """The maps of all views, in order."""
        return iter(self._maps)

    @overload
    def __getitem__(self, view: int) -> DepthMap: ...

    @overload
    def __getitem__(self, view: slice) -> DepthMaps: ...

    def __getitem__(self, view: int | slice) -> DepthMap | DepthMaps:
        """The map of a view, or the maps of some."""
        if isinstance(view, slice):
            return DepthMaps(self._maps[view])
        return self._maps[view]

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
