"""The pyramid of minima: the nearest pixel of every area of 1, 2, 4, 8 and 16 pixels a side.

Kernels take `first_row`: rows of all views counted on.
"""

import warp as wp

from depthwarp_kernels.filters_layers import EMPTY_CELL, LEVELS, WORD, lowest_bit, spacing_in
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)


# Isolated pixels are left out: they speak for no surface. The cells are empty before. A thread
# takes two rows of a word's columns, which are areas of 2 x 2 pixels; `words` says which pixels are
# there. Launch over (pairs of rows, words).
@wp.kernel
def fill_first_levels(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    words: wp.array3d[wp.uint32],
    spacing: wp.array3d[wp.uint16],
    limit: wp.array[wp.int32],
    extents: wp.int32,
    # Out:
    cells_out: wp.array2d[wp.uint64],
):
    i, word = wp.tid()
    rows = depth.shape[1]
    columns = depth.shape[2]
    pairs = (rows + 1) // 2
    v = (first_row + i) // pairs
    pair = (first_row + i) - v * pairs
    areas = rows * columns + pair * ((columns + 1) // 2)
    for row in range(2 * pair, wp.min(2 * pair + 2, rows)):
        bits = words[v, row, word]
        while bits != wp.uint32(0):
            column = word * WORD + lowest_bit(bits)
            bits = bits & (bits - wp.uint32(1))
            own = wp.int32(spacing[v, row, column])
            if spacing_in(own) <= limit[v]:
                kept = wp.where(extents != 0, own, spacing_in(own))
                near = wp.uint64(wp.cast(depth[v, row, column], wp.uint32))
                cell = (near << wp.uint64(32)) | (wp.uint64(kept) << wp.uint64(16))
                cells_out[v, row * columns + column] = cell
                area = areas + column // 2
                place = wp.uint64(((row % 2) << 8) | (column % 2))
                cells_out[v, area] = wp.min(cells_out[v, area], cell | place)


@wp.func
def nearest_of_areas(
    cells: wp.array2d[wp.uint64],
    v: wp.int32,
    first: wp.int32,
    rows: wp.int32,
    columns: wp.int32,
    level: wp.int32,
    row: wp.int32,
    column: wp.int32,
):
    """The cell of an area from the four of the level below, of `rows` x `columns` from `first`."""
    half = wp.uint64(1 << (level - 1))
    nearest = wp.uint64(EMPTY_CELL)
    for k in range(4):
        r = 2 * row + k // 2
        c = 2 * column + k % 2
        if r < rows and c < columns:
            cell = cells[v, first + r * columns + c]
            if cell != wp.uint64(EMPTY_CELL):
                place = half * wp.uint64(k % 2) + (half * wp.uint64(k // 2) << wp.uint64(8))
                nearest = wp.min(nearest, cell + place)
    return nearest


# A thread takes one area of the coarsest level, and all of the levels between that lie in it, from
# fine to coarse. Launch over (rows, columns) of the coarsest level, of `rows` x `columns` pixels.
@wp.kernel
def fill_next_levels(
    # In:
    first_row: wp.int32,
    rows: wp.int32,
    columns: wp.int32,
    # Out:
    cells_out: wp.array2d[wp.uint64],
):
    i, area_column = wp.tid()
    area_rows = ((rows - 1) >> (LEVELS - 1)) + 1
    v = (first_row + i) // area_rows
    area_row = (first_row + i) - v * area_rows
    below = rows * columns
    rows_below = (rows + 1) >> 1
    columns_below = (columns + 1) >> 1
    for level in range(2, LEVELS):
        own = below + rows_below * columns_below
        own_rows = (rows_below + 1) >> 1
        own_columns = (columns_below + 1) >> 1
        finer = LEVELS - 1 - level
        for k in range(1 << (2 * finer)):
            row = (area_row << finer) + (k >> finer)
            column = (area_column << finer) + (k & ((1 << finer) - 1))
            if row < own_rows and column < own_columns:
                cells_out[v, own + row * own_columns + column] = nearest_of_areas(
                    cells_out, v, below, rows_below, columns_below, level, row, column
                )
        below = own
        rows_below = own_rows
        columns_below = own_columns
