"""Samples round a block of empty pixels, from the pyramid of minima."""

import warp as wp

from depthwarp_kernels.filters_layers import (
    EMPTY_CELL,
    LEVELS,
    PixelGrid,
    column_in_image,
    column_of_cell,
    depth_of_cell,
    offset_round,
    row_of_cell,
    spacing_of_cell,
)
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

MOST_SAMPLES = 36
"""Samples round a block of 4 x 4 pixels: 6 x 6 pixels; coarser areas follow on three at most."""

ENOUGH = wp.constant(4)
"""Samples from which coarser areas are not looked at."""

FILL_REACH_2 = wp.constant(3)
"""A sample speaks for pixels up to 1.5 times its spacing away: in half pixels, 3 times."""

BORDER_REACH_2 = wp.constant(2)
"""Where nothing surrounds them, for those up to its spacing away: in half pixels, twice."""

BORDER_DOUBT = wp.constant(wp.float32(0.16))
BESIDE_SQUARE = wp.constant(10)
"""There a pixel stays empty if its way to the closest sample, in spacings of that, times the range
of all samples' depths, as a share of the largest, is above 0.16; unless that sample lies beside the
block of 2 x 2, at most 1.6 px from its middle: 10 half pixels squared."""


@wp.func
def squared(right: wp.int32, down: wp.int32):
    """Square of a distance."""
    return right * right + down * down


# What is the nearest of a coarse area is also the nearest of the finer area that it lies in.
@wp.func
def was_seen(
    row: wp.int32,
    column: wp.int32,
    level: wp.int32,
    top: wp.int32,
    left: wp.int32,
    size: wp.int32,
    finer_columns: wp.int32,
    wraps: wp.int32,
):
    """Whether the finer areas round the block at (top, left) held a pixel."""
    if level == 0:
        return False
    finer = level - 1
    most = wp.max(size >> finer, 1)
    rows = (row >> finer) - (top >> finer)
    columns = offset_round((column >> finer) - (left >> finer), finer_columns, wraps)
    return rows >= -1 and rows <= most and columns >= -1 and columns <= most


# From small areas to large ones, until there are enough. Offsets are in half pixels from the middle
# of the block of `size` pixels a side at (top, left), `more` what is added to the samples' reach.
@wp.func
def gather_samples(
    cells: wp.array2d[wp.uint64],
    grid: PixelGrid,
    v: wp.int32,
    top: wp.int32,
    left: wp.int32,
    size: wp.int32,
    more: wp.int32,
    rows: wp.int32,
    columns: wp.int32,
    depth_out: wp.array[wp.float32],
    right_out: wp.array[wp.int32],
    down_out: wp.array[wp.int32],
):
    """Number of samples whose reach covers a block's middle, written one after the other."""
    count = int(0)
    first = int(0)
    level_rows = int(rows)
    level_columns = int(columns)
    finer_columns = int(0)
    finer_wraps = int(0)
    for level in range(LEVELS):
        below = wp.max(size >> level, 1)
        wraps = wp.where(level_columns > below + 1, grid.wraps, 0)  # no area twice
        side = left >> level
        inside = side > 0 and side + below < level_columns
        r = wp.max((top >> level) - 1, 0)
        last = wp.min((top >> level) + below, level_rows - 1)
        while r <= last:
            dc = int(-1)
            while dc <= below:
                c = side + dc
                if not inside:
                    c = column_in_image(c, level_columns, wraps)
                if c >= 0:
                    cell = cells[v, first + r * level_columns + c]
                    if cell != wp.uint64(EMPTY_CELL):
                        row = (r << level) + row_of_cell(cell)
                        column = (c << level) + column_of_cell(cell)
                        x = 2 * offset_round(column - left, columns, grid.wraps) - (size - 1)
                        y = 2 * (row - top) - (size - 1)
                        reach = FILL_REACH_2 * spacing_of_cell(cell) + more
                        if squared(x, y) <= reach * reach:
                            if not was_seen(
                                row, column, level, top, left, size, finer_columns, finer_wraps
                            ):
                                depth_out[count] = depth_of_cell(cell)
                                right_out[count] = x
                                down_out[count] = y
                                count += 1
                dc += 1
            r += 1
        if count >= ENOUGH:
            return count
        finer_columns = level_columns
        finer_wraps = wraps
        first += level_rows * level_columns
        level_rows = (level_rows + 1) >> 1
        level_columns = (level_columns + 1) >> 1
    return count


@wp.func
def row_of_sample(down: wp.int32, top: wp.int32, size: wp.int32):
    """Row of a sample, by its offset from the middle of a block at `top`."""
    return top + ((down + size - 1) >> 1)


@wp.func
def column_of_sample(right: wp.int32, left: wp.int32, size: wp.int32, columns: wp.int32):
    """Column of a sample, round the turn where the image wraps."""
    return (left + ((right + size - 1) >> 1) + columns) % columns


# Of the samples of a block of 2 x 2; of several the one with the smallest depth. The farther away
# it is, and the more the depths differ, the more an error would be likely, and large.
@wp.func
def closest_at_border(
    cells: wp.array2d[wp.uint64],
    v: wp.int32,
    top: wp.int32,
    left: wp.int32,
    columns: wp.int32,
    depth: wp.array[wp.float32],
    right: wp.array[wp.int32],
    down: wp.array[wp.int32],
    count: wp.int32,
):
    """The closest sample of those that reach so far at a border; -1 without one or in doubt."""
    best = int(-1)
    least = int(0)
    best_reach = int(0)
    near = depth[0]
    far = depth[0]
    for k in range(count):
        row = row_of_sample(down[k], top, 2)
        column = column_of_sample(right[k], left, 2, columns)
        reach = BORDER_REACH_2 * spacing_of_cell(cells[v, row * columns + column])
        way = squared(right[k], down[k])
        if way <= reach * reach:
            if best < 0 or way < least or (way == least and depth[k] < depth[best]):
                best = k
                least = way
                best_reach = reach
        near = wp.min(near, depth[k])
        far = wp.max(far, depth[k])
    doubt = wp.sqrt(wp.float32(least)) * (far - near)
    if least > BESIDE_SQUARE and doubt > BORDER_DOUBT * wp.float32(best_reach) * far:
        return -1
    return best
