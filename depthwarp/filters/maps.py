"""What a filter works on: the maps on the device, and the shape of a filter."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp.cameras import Camera
from depthwarp_kernels.filters_layers import PixelGrid

__all__ = ["DeviceMaps", "Filter", "device_grids", "pixel_grids"]


@dataclass(frozen=True)
class DeviceMaps:
    """Depth maps on a device, shape (views, rows, columns); filters change them in place.

    Attributes:
        depth: Depth [m], `wp.float32`, 0 = empty.
        index: Winning point, `wp.int32`, -1 = empty; None where nobody asked for it.
        state: Values of `State`, `wp.uint8`.
        grids: What filters know of the cameras, `PixelGrid`, shape (views,); None without filters.
        blind: Pixels that the lens has no ray for, 32 columns a word, `wp.uint32`, shape (V, H,
            words); None where all have one.
        threads: Threads on a CPU; None for all cores that this process may use.
    """

    depth: Any
    index: Any
    state: Any
    grids: Any = None
    blind: Any = None
    threads: int | None = None


def pixel_grids(cameras: Sequence[Camera]) -> npt.NDArray[Any]:
    """Records of `PixelGrid`, one a camera, as a NumPy array of shape (V,)."""
    struct: Any = PixelGrid
    grids: Any = np.zeros(len(cameras), struct.numpy_dtype())
    for row, camera in zip(grids, cameras, strict=True):
        row["slope"], row["constant"] = camera.pixel_pitch
        row["wraps"] = camera.wraps
    records: npt.NDArray[Any] = grids
    return records


def device_grids(cameras: Sequence[Camera], device: Any) -> Any:
    """The same on a device."""
    return wp.array(pixel_grids(cameras), dtype=PixelGrid, device=device)


class Filter(Protocol):
    """A step after the splat: maps (depth, index, state) to the same, on the device."""

    @property
    def scratch_bytes(self) -> int:
        """Bytes of working memory a pixel."""
        ...

    def build(self, maps: DeviceMaps) -> Callable[[], None]:
        """Allocate the working memory for these maps and return the step that runs on them.

        The step allocates nothing and does not synchronize; it is graph-capture safe once its
        kernels are loaded.
        """
        ...
