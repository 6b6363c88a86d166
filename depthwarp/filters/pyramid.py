"""The pyramid of minima in which filters look for the layers round a pixel."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import warp as wp

from depthwarp import arrays
from depthwarp.errors import CapacityError
from depthwarp.filters.maps import DeviceMaps
from depthwarp.filters.rows import row_launch
from depthwarp_kernels import filters_layers as layers
from depthwarp_kernels import filters_spacing as spacings

__all__ = ["PYRAMID_BYTES", "Pyramid", "check_cells", "level_sizes"]

MOST_CELLS = (1 << 31) - 1

PYRAMID_BYTES = 12
"""Working memory a pixel: spacing, cells of all levels, and bits."""


class Pyramid:
    """Own-layer spacing of every pixel, and the nearest pixel of every area of 1 to 16 pixels.

    Args:
        maps: The maps that `build` will read.

    Attributes:
        spacing: Own-layer spacing S [px], shape (V, H, W), uint8: 0 = empty, 33 = none found; 64
            more where the companions lie along a line. `SurroundErase` marks in it what lost its
            companions: 255.
        limit: Spacing above which a pixel is isolated, by view, shape (V,), int32.
        words: Which pixels are there, 32 a word, shape (V, H, words), uint32.
        cells: All levels, one after the other, row by row, shape (V, cells), uint64.
    """

    def __init__(self, maps: DeviceMaps) -> None:
        depth, device = maps.depth, maps.depth.device
        views, rows, columns = depth.shape
        self.spacing = arrays.empty(depth.shape, wp.uint8, device)
        self.limit = arrays.empty(views, wp.int32, device)
        self._row_counts = arrays.empty((views, rows, spacings.SPACING_BINS), wp.int32, device)
        counts = arrays.empty((views, spacings.SPACING_BINS), wp.int32, device)
        sizes = level_sizes(rows, columns, layers.LEVELS)
        check_cells(sizes)
        firsts = [sum(r * c for r, c in sizes[:level]) for level in range(len(sizes))]
        self.cells = arrays.empty((views, sum(r * c for r, c in sizes)), wp.uint64, device)

        words = self.words = arrays.empty(
            (views, rows, -(-columns // spacings.WORD)), wp.uint32, device
        )
        runs = rows, -(-columns // spacings.RUN)
        maps_read = [depth, maps.state]
        self._steps = [
            row_launch(spacings.mark_present, maps, maps_read, [words], words.shape[1:]),
            row_launch(
                spacings.find_spacing,
                maps,
                [depth, words, maps.grids],
                [self.spacing, self._row_counts],
                runs,
            ),
            _launch(spacings.sum_counts, counts.shape, [self._row_counts], [counts], device),
            _launch(spacings.find_limit, (views,), [counts], [self.limit], device),
            row_launch(
                layers.fill_first_levels,
                maps,
                [depth, self.spacing, self.limit],
                [self.cells],
                sizes[1],
            ),
        ]
        for level in range(2, layers.LEVELS):
            below = sizes[level - 1]
            numbers = [firsts[level - 1], firsts[level], *below, level]
            self._steps.append(
                row_launch(layers.fill_next_level, maps, numbers, [self.cells], sizes[level])
            )

    def build(self) -> None:
        """Read the maps anew."""
        self._row_counts.zero_()
        for step in self._steps:
            step()


def level_sizes(rows: int, columns: int, levels: int) -> list[tuple[int, int]]:
    """(rows, columns) of every level: the areas of the finest are the pixels."""
    sides = (1 << level for level in range(levels))
    return [(-(-rows // side), -(-columns // side)) for side in sides]


def check_cells(sizes: list[tuple[int, int]]) -> None:
    """Refuse a view whose cells a 32-bit number cannot count.

    Raises:
        CapacityError: The image is too large for filters that use levels.
    """
    rows, columns = sizes[0]
    if sum(r * c for r, c in sizes) > MOST_CELLS:
        raise CapacityError(
            f"this filter takes images of up to about 1.6e9 pixels, got {columns} x {rows}: "
            "render in tiles"
        )


def _launch(
    kernel: Any, dim: tuple[int, ...], inputs: list[Any], outputs: list[Any], device: Any
) -> Callable[[], None]:
    command: Any = wp.launch(
        kernel, dim=dim, inputs=inputs, outputs=outputs, device=device, record_cmd=True
    )
    run: Callable[[], None] = command.launch
    return run
