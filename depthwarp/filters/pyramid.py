"""The pyramid of minima in which filters look for the layers round a pixel."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import warp as wp

from depthwarp import arrays
from depthwarp.errors import CapacityError
from depthwarp.filters.maps import DeviceMaps
from depthwarp.filters.rows import row_launch
from depthwarp_kernels import filters_spacing as spacings
from depthwarp_kernels.filters_layers import EMPTY_CELL, LEVELS, WORD
from depthwarp_kernels.filters_pyramid import fill_first_levels, fill_next_levels

__all__ = ["PYRAMID_BYTES", "Pyramid", "check_cells", "level_sizes"]

MOST_CELLS = (1 << 31) - 1
CELL_BYTES = 8

PYRAMID_BYTES = 13
"""Working memory a pixel: spacing, cells of all levels, and bits."""


class Pyramid:
    """Own-layer spacing of every pixel, and the nearest pixel of every area of 1 to 16 pixels.

    Args:
        maps: The maps that its steps will read.

    Attributes:
        spacing: Own-layer spacing S [px], shape (V, H, W), uint16: 0 = empty, 33 = none found; see
            `depthwarp_kernels.filters_layers` for what its upper bits hold.
        words: Which pixels are there, 32 a word, shape (V, H, words), uint32.
        cells: All levels, one after the other, row by row, shape (V, cells), uint64.
    """

    def __init__(self, maps: DeviceMaps) -> None:
        self._maps = maps
        depth, device = maps.depth, maps.depth.device
        views, rows, columns = depth.shape
        self._sizes = level_sizes(rows, columns, LEVELS)
        check_cells(self._sizes, views)
        self.words = arrays.empty((views, rows, -(-columns // WORD)), wp.uint32, device)
        self.spacing = arrays.empty(depth.shape, wp.uint16, device)
        self._row_counts = arrays.empty((views, rows, spacings.SPACING_BINS), wp.int32, device)
        self._counts = arrays.empty((views, spacings.SPACING_BINS), wp.int32, device)
        self._limit = arrays.empty(views, wp.int32, device)
        cells = sum(r * c for r, c in self._sizes)
        self.cells = arrays.empty((views, cells), wp.uint64, device)

    def reading(self, *, extents: bool) -> Callable[[], None]:
        """A step that reads the maps.

        Args:
            extents: Whether to find, beside the spacing, how far a pixel stands for its surface.
        """
        maps, words = self._maps, self.words
        mark = row_launch(
            spacings.mark_present, maps, [maps.depth, maps.state], [words], words.shape[1:]
        )
        inputs = [maps.depth, words, maps.grids, int(extents)]
        return self._building([mark, self._spacing_launch(spacings.find_spacing, inputs)], extents)

    def leaving_out(self, erased: Any) -> Callable[[], None]:
        """A step that goes on from the last one, without extents, when pixels have been erased.

        Args:
            erased: Which they are, of the shape of `words`; `words` knows of it.
        """
        inputs = [self._maps.depth, self.words, erased, self._maps.grids]
        return self._building([self._spacing_launch(spacings.renew_spacing, inputs)], False)

    def _spacing_launch(self, kernel: Any, inputs: list[Any]) -> Callable[[], None]:
        _, rows, columns = self._maps.depth.shape
        written = [self.spacing, self._row_counts]
        return row_launch(kernel, self._maps, inputs, written, (rows, -(-columns // spacings.RUN)))

    def _building(self, steps: list[Callable[[], None]], extents: bool) -> Callable[[], None]:
        maps, counts, limit = self._maps, self._counts, self._limit
        device, sizes = maps.depth.device, self._sizes
        launches = [
            *steps,
            _launch(spacings.sum_counts, counts.shape, [self._row_counts], [counts], device),
            _launch(spacings.find_limit, limit.shape, [counts], [limit], device),
            row_launch(
                fill_first_levels,
                maps,
                [maps.depth, self.words, self.spacing, limit, int(extents)],
                [self.cells],
                (sizes[1][0], self.words.shape[2]),
            ),
            row_launch(fill_next_levels, maps, [*sizes[0]], [self.cells], sizes[-1]),
        ]

        def build() -> None:
            self._row_counts.zero_()
            self.cells.fill_(EMPTY_CELL)
            for launch in launches:
                launch()

        return build


def level_sizes(rows: int, columns: int, levels: int) -> list[tuple[int, int]]:
    """(rows, columns) of every level: the areas of the finest are the pixels."""
    sides = (1 << level for level in range(levels))
    return [(-(-rows // side), -(-columns // side)) for side in sides]


def check_cells(sizes: list[tuple[int, int]], views: int) -> None:
    """Refuse a view whose cells a 32-bit number cannot count, of several also their bytes.

    Raises:
        CapacityError: The images are too large for filters that use levels.
    """
    rows, columns = sizes[0]
    cells = sum(r * c for r, c in sizes)
    if cells > MOST_CELLS:
        raise CapacityError(
            f"this filter takes images of up to about 1.6e9 pixels, got {columns} x {rows}: "
            "render in tiles"
        )
    if views > 1 and cells * CELL_BYTES > MOST_CELLS:
        raise CapacityError(
            f"this filter takes several images of up to about 2e8 pixels at once, got {views} of "
            f"{columns} x {rows}: render one after the other"
        )


def _launch(
    kernel: Any, dim: tuple[int, ...], inputs: list[Any], outputs: list[Any], device: Any
) -> Callable[[], None]:
    command: Any = wp.launch(
        kernel, dim=dim, inputs=inputs, outputs=outputs, device=device, record_cmd=True
    )
    run: Callable[[], None] = command.launch
    return run
