"""Filling with the nearest pixel of the image."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import warp as wp

from depthwarp import arrays
from depthwarp.checks import check_window
from depthwarp.filters.maps import DeviceMaps
from depthwarp.filters.rows import row_launch
from depthwarp_kernels.filters_nearest import fill_nearest, nearest_in_column

__all__ = ["NearestFill"]

FARTHEST = 1024
"""Largest radius [px]: squares of distances stay small integers."""


@dataclass(frozen=True)
class NearestFill:
    """An empty pixel takes depth and index of the pixel nearest in the image, as FILLED.

    Of several equally near the one with the smallest depth wins, then the lowest index. Images of a
    full turn go round.

    Attributes:
        radius: How far the nearest one may be [px], Euclidean, at most 1024.
    """

    radius: int = 10

    scratch_bytes = 4

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", check_window("radius", self.radius, FARTHEST))

    def build(self, maps: DeviceMaps) -> Callable[[], None]:
        """Allocate the columns' nearest rows and return the step; see `Filter.build`."""
        written = [maps.depth, maps.index, maps.state]
        source = arrays.empty(maps.depth.shape, wp.int32, maps.depth.device)
        find = row_launch(nearest_in_column, maps, [*written, self.radius], [source])
        fill = row_launch(fill_nearest, maps, [source, self.radius, maps.grids], written)

        def step() -> None:
            find()
            fill()

        return step
