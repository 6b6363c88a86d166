"""Hidden pixels: those that nearer ones stand closely round, and whose companions' are so too.

Kernels erase in place: what they read of other pixels is found before. They take `first_row`: rows
of all views counted on.
"""

import warp as wp

from depthwarp_kernels.filters_companions import (
    down_of,
    is_any_near,
    nearest_companions,
    right_of,
    ring_of,
)
from depthwarp_kernels.filters_layers import (
    LEVELS,
    WORD,
    PixelGrid,
    cells_of_level,
    column_in_image,
    column_of_cell,
    depth_of_cell,
    erase_pixel,
    extent_in,
    is_along_line,
    lowest_bit,
    offset_round,
    pitch,
    row_of_cell,
    spacing_bits_of_cell,
    spacing_in,
)
from depthwarp_kernels.filters_sectors import longest_empty_run, sector_bit, surrounds
from depthwarp_kernels.filters_spacing import FARTHEST_RING, RUN
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

HIDING_REACH_SQUARE = wp.constant(wp.float32(9.0))
"""A pixel hides others up to 3 times its extent away."""

DENSE_REACH_SQUARE = wp.constant(wp.float32(2.0))
"""One whose surface has no gaps, of spacing 1, its eight neighbours."""

MOST_TIMES_SPARSER = wp.constant(6)
SPARSE = wp.constant(12)
"""A pixel whose spacing is above 12 px hides none whose own is below a sixth of it: what is so
sparse before a dense surface is seldom a surface, but mixed pixels and strays."""

HIDING_MARGIN = wp.constant(wp.float32(0.02))
HIDING_SHARE = wp.constant(wp.float32(0.004))
HIDING_SLOPE = wp.constant(wp.float32(0.5))
"""It has to be nearer by 0.02 m + 0.4 % of the hidden one's depth + half of d pitch."""

MOST_EMPTY = wp.constant(14)
"""Longest run of empty sectors of a pixel that is hidden. Pixels on one side of a straight line,
however it lies, touch 17 sectors of 32 at most, and leave a run of 15."""

GAP_WEIGHT = wp.constant(wp.float32(8.0))
"""What counts is the longest run of empty sectors + 8 times the gap that a pixel lies in: through
the gaps of a surface, which are narrow, it is not seen."""

LINE_ALLOWANCE = wp.constant(wp.float32(6.0))
"""Added for a pixel that is of a line itself: poles and wires behind others."""

FREEST = wp.constant(wp.float32(27.0))
EIGHTHS = wp.constant(wp.float32(8.0))
"""Freedom is kept in eighths, up to 27: that of what nothing surrounds."""

SEEN = wp.constant(198)
"""A pixel is seen from 24.75 on, in eighths: half of it its own freedom, half its companions'."""

HALF_PIXEL = wp.constant(wp.float32(0.5))
OCTANTS = 8
FAR = wp.constant(wp.float32(1.0e6))


# From a pixel's edge: where its surface has gaps, it may lie anywhere in them.
@wp.func
def in_extents(way: wp.float32, spacing_bits: wp.int32):
    """A distance from a pixel in its extents; in pixels where its surface has no gaps."""
    is_dense = spacing_in(spacing_bits) == 1
    return wp.where(is_dense, way, (way - HALF_PIXEL) / extent_in(spacing_bits))


@wp.func
def reach_square(spacing_bits: wp.int32):
    """Square of how far a pixel hides others [px^2]."""
    extent = extent_in(spacing_bits)
    is_dense = spacing_in(spacing_bits) == 1
    return wp.where(is_dense, DENSE_REACH_SQUARE, HIDING_REACH_SQUARE * extent * extent)


@wp.func
def may_hide(spacing: wp.int32, own_spacing: wp.int32):
    """Whether a pixel of a spacing hides one of another."""
    is_gap = spacing > 1 or own_spacing > 1  # between two surfaces without gaps nothing shines
    return is_gap and spacing <= wp.max(MOST_TIMES_SPARSER * own_spacing, SPARSE)


@wp.func
def hides(
    spacing_bits: wp.int32,
    own_spacing: wp.int32,
    ahead: wp.float32,
    square: wp.float32,
    pitch_there: wp.float32,
):
    """Whether a pixel hides another, by how far it is ahead of it, beyond the margin."""
    if square > reach_square(spacing_bits):
        return False
    if not may_hide(spacing_in(spacing_bits), own_spacing):
        return False
    return ahead > HIDING_SLOPE * wp.sqrt(square) * pitch_there


@wp.func
def gap_between(ways: wp.array[wp.float32]):
    """Least sum of the ways to what hides in two octants that lie opposite, or nearly so."""
    gap = wp.float32(FAR)
    for octant in range(OCTANTS):
        third = ways[(octant + 3) % OCTANTS]
        fourth = ways[(octant + 4) % OCTANTS]
        gap = wp.min(gap, ways[octant] + wp.min(third, fourth))
    return gap


# What is nearer by less than the margin in the areas of a level is so in those of finer levels too,
# which lie inside of them: from coarse to fine, most pixels need a level or two.
@wp.func
def freedom_of(
    cells: wp.array2d[wp.uint64],
    sector_bits: wp.array[wp.uint32],
    grid: PixelGrid,
    v: wp.int32,
    row: wp.int32,
    column: wp.int32,
    rows: wp.int32,
    columns: wp.int32,
    own: wp.float32,
    own_bits: wp.int32,
):
    """How freely a pixel is seen between nearer ones, up to `FREEST`."""
    margin = HIDING_MARGIN + HIDING_SHARE * own
    ways = wp.zeros(shape=(wp.static(OCTANTS),), dtype=wp.float32)  # to the closest, in extents
    for octant in range(OCTANTS):
        ways[octant] = FAR
    sectors = wp.uint32(0)
    first = int(0)
    for level in range(LEVELS):
        first += cells_of_level(rows, columns, level)
    for k in range(LEVELS):
        level = LEVELS - 1 - k
        first -= cells_of_level(rows, columns, level)
        level_rows = ((rows - 1) >> level) + 1
        level_columns = ((columns - 1) >> level) + 1
        is_any_nearer = bool(False)
        for r in range(wp.max((row >> level) - 1, 0), wp.min((row >> level) + 2, level_rows)):
            for dc in range(-1, 2):
                c = column_in_image((column >> level) + dc, level_columns, grid.wraps)
                if c >= 0:
                    cell = cells[v, first + r * level_columns + c]
                    nearer = depth_of_cell(cell)
                    ahead = own - nearer - margin
                    if ahead > 0.0:
                        is_any_nearer = True
                        down = (r << level) + row_of_cell(cell) - row
                        right = (c << level) + column_of_cell(cell) - column
                        right = offset_round(right, columns, grid.wraps)
                        square = wp.float32(down * down + right * right)
                        bits = spacing_bits_of_cell(cell)
                        if hides(bits, spacing_in(own_bits), ahead, square, pitch(grid, nearer)):
                            bit = sector_bit(sector_bits, 2 * right, 2 * down)
                            sectors = sectors | bit
                            octant = lowest_bit(bit) >> 2
                            ways[octant] = wp.min(ways[octant], in_extents(wp.sqrt(square), bits))
        if not is_any_nearer:
            break
    if not surrounds(sectors, MOST_EMPTY):  # sooner than the run's length is found
        return FREEST
    allowance = wp.where(is_along_line(own_bits), LINE_ALLOWANCE, wp.float32(0.0))
    freedom = wp.float32(longest_empty_run(sectors)) + GAP_WEIGHT * gap_between(ways) + allowance
    return wp.min(freedom, FREEST)


# Launch over (rows, runs).
@wp.kernel
def find_freedom(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    cells: wp.array2d[wp.uint64],
    spacing: wp.array3d[wp.uint16],
    sector_bits: wp.array[wp.uint32],
    grids: wp.array[PixelGrid],
    # Out:
    freedom_out: wp.array3d[wp.uint8],
    doubtful_out: wp.array3d[wp.uint32],
):
    i, run = wp.tid()
    rows = depth.shape[1]
    columns = depth.shape[2]
    v = (first_row + i) // rows
    row = (first_row + i) - v * rows
    grid = grids[v]
    doubtful = wp.uint32(0)
    for column in range(run * RUN, wp.min((run + 1) * RUN, columns)):
        bits = wp.int32(spacing[v, row, column])
        if bits > 0:
            own = depth[v, row, column]
            freedom = freedom_of(cells, sector_bits, grid, v, row, column, rows, columns, own, bits)
            eighths = wp.int32(EIGHTHS * freedom)
            freedom_out[v, row, column] = wp.uint8(eighths)
            if eighths < SEEN:
                doubtful = doubtful | (wp.uint32(1) << wp.uint32(column % WORD))
    wp.atomic_or(doubtful_out, v, row, run * RUN // WORD, doubtful)


# Where no companion is found its freedom is the pixel's own.
@wp.func
def mean_freedom(
    freedom: wp.array3d[wp.uint8],
    four: wp.vec4i,
    reach: wp.int32,
    v: wp.int32,
    row: wp.int32,
    column: wp.int32,
):
    """Mean of a pixel's freedom and the mean of its companions' [eighths]."""
    own = wp.int32(freedom[v, row, column])
    total = int(0)
    for k in range(4):
        one = own
        if ring_of(four[k]) <= reach:
            columns = freedom.shape[2]
            c = (column + right_of(four[k]) + columns) % columns
            one = wp.int32(freedom[v, row + down_of(four[k]), c])
        total += one
    return (4 * own + total) // 8


# A pixel is seen where no companion nor itself is in doubt. Launch over (rows, runs).
@wp.kernel
def mark_hidden(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    words: wp.array3d[wp.uint32],
    spacing: wp.array3d[wp.uint16],
    freedom: wp.array3d[wp.uint8],
    doubtful: wp.array3d[wp.uint32],
    grids: wp.array[PixelGrid],
    # Out:
    hidden_out: wp.array3d[wp.uint32],
):
    i, run = wp.tid()
    rows = depth.shape[1]
    columns = depth.shape[2]
    v = (first_row + i) // rows
    row = (first_row + i) - v * rows
    grid = grids[v]
    hidden = wp.uint32(0)
    for column in range(run * RUN, wp.min((run + 1) * RUN, columns)):
        bits = wp.int32(spacing[v, row, column])
        if bits > 0:
            reach = wp.min(spacing_in(bits), FARTHEST_RING)
            if is_any_near(doubtful, v, row, column, columns, reach, grid.wraps):
                four = nearest_companions(depth, words, grid, v, row, column, reach)
                if mean_freedom(freedom, four, reach, v, row, column) < SEEN:
                    hidden = hidden | (wp.uint32(1) << wp.uint32(column % WORD))
    wp.atomic_or(hidden_out, v, row, run * RUN // WORD, hidden)


# `words_out` says which pixels are there. Launch over (rows, words).
@wp.kernel
def erase_marked(
    # In:
    first_row: wp.int32,
    marked: wp.array3d[wp.uint32],
    keep_depth: wp.int32,
    # Out:
    depth_out: wp.array3d[wp.float32],
    index_out: wp.array3d[wp.int32],
    state_out: wp.array3d[wp.uint8],
    words_out: wp.array3d[wp.uint32],
):
    i, word = wp.tid()
    rows = depth_out.shape[1]
    v = (first_row + i) // rows
    row = (first_row + i) - v * rows
    bits = marked[v, row, word]
    words_out[v, row, word] = words_out[v, row, word] & ~bits
    while bits != wp.uint32(0):
        column = word * WORD + lowest_bit(bits)
        bits = bits & (bits - wp.uint32(1))
        erase_pixel(depth_out, index_out, state_out, v, row, column, keep_depth)
