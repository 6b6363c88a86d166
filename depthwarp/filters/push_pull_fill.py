"""Filling by averages of ever larger areas."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import warp as wp

from depthwarp import arrays
from depthwarp.filters.maps import DeviceMaps
from depthwarp.filters.pyramid import check_cells, level_sizes
from depthwarp.filters.rows import row_launch
from depthwarp_kernels import filters_push_pull as kernels

__all__ = ["PushPullFill"]

LEVELS = 6
"""Areas of 1 to 32 pixels a side."""


@dataclass(frozen=True)
class PushPullFill:
    """Push and pull: averages of areas of 1 to 32 px a side fill what is empty, as FILLED.

    Inverse depths are averaged upwards, weighted by how full an area is, and brought back between
    the middles of the areas. Smooth and without holes up to about 32 px from the next pixel, but it
    mixes the layers at an edge. After S. Gortler et al., "The Lumigraph", SIGGRAPH 1996. The index
    is that of a pixel of the area. Images of a full turn do not go round.
    """

    scratch_bytes = 17

    def build(self, maps: DeviceMaps) -> Callable[[], None]:
        """Allocate all levels and return the step; see `Filter.build`."""
        written = [maps.depth, maps.index, maps.state]
        views, rows, columns = maps.depth.shape
        sizes = level_sizes(rows, columns, LEVELS)
        check_cells(sizes, views)
        firsts = [sum(r * c for r, c in sizes[:level]) for level in range(LEVELS)]
        shape = (views, sum(r * c for r, c in sizes))
        levels = [
            arrays.empty(shape, dtype, maps.depth.device)
            for dtype in (wp.float32, wp.float32, wp.int32)
        ]
        steps = [row_launch(kernels.start_level, maps, [maps.depth, maps.state], levels)]
        for level in range(1, LEVELS):
            numbers = [firsts[level - 1], firsts[level], *sizes[level - 1]]
            steps.append(row_launch(kernels.pull, maps, numbers, levels, sizes[level]))
        for level in reversed(range(LEVELS - 1)):
            numbers = [firsts[level + 1], firsts[level], *sizes[level]]
            steps.append(row_launch(kernels.push, maps, numbers, levels, sizes[level]))
        steps.append(row_launch(kernels.write_filled, maps, levels, written))

        def fill() -> None:
            for step in steps:
                step()

        return fill
