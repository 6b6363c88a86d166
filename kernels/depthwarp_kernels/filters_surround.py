"""Hidden pixels: those that nearer ones surround, and what of their surface is left.

Kernels erase in place: what they read of other pixels is a copy that was made before. They take
`first_row`: rows of all views counted on.
"""

import warp as wp

from depthwarp_kernels.filters_layers import (
    LEVELS,
    PixelGrid,
    cells_of_level,
    column_in_image,
    column_of_cell,
    depth_of_cell,
    erase_pixel,
    is_along_line,
    pitch,
    row_of_cell,
    spacing_bits_of_cell,
    spacing_in,
)
from depthwarp_kernels.filters_sectors import (
    longest_empty_run,
    offset_round,
    sector_bit,
    surrounds,
)
from depthwarp_kernels.filters_spacing import (
    RUN,
    THINNED,
    WORD,
    lowest_bit,
)
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

LINE_EXTENT = wp.constant(wp.float32(0.6))
"""A pixel stands for its spacing round it; one whose companions lie along a line for 0.6 of it, as
there they are on two sides only."""

HIDING_REACH_SQUARE = wp.constant(wp.float32(9.0))
"""A pixel hides others up to 3 times what it stands for away."""

DENSE_REACH_SQUARE = wp.constant(wp.float32(2.0))
"""One whose surface has no gaps, of spacing 1, its eight neighbours."""

MOST_TIMES_SPARSER = wp.constant(6)
SPARSE = wp.constant(12)
"""A pixel whose spacing is above 12 px hides none whose own is below a sixth of it: what is so
sparse before a dense surface is seldom a surface, but mixed pixels and strays."""

HIDING_MARGIN = wp.constant(wp.float32(0.02))
HIDING_SHARE = wp.constant(wp.float32(0.002))
HIDING_SLOPE = wp.constant(wp.float32(0.5))
"""It has to be nearer by 0.02 m + 0.2 % of the hidden one's depth + half of d pitch."""

MOST_EMPTY = wp.constant(14)
"""Longest run of empty sectors of a pixel that is hidden. Pixels on one side of a straight line,
however it lies, touch 17 sectors of 32 at most, and leave a run of 15."""

GAP_WEIGHT = wp.constant(wp.float32(8.0))
MOST_LOOSE = wp.constant(wp.float32(23.5))
"""A pixel is hidden where its longest run of empty sectors + 8 times the gap that it lies in is at
most 23.5: through the gaps of a surface, which are narrow, it is not seen."""

LINE_ALLOWANCE = wp.constant(wp.float32(4.0))
"""Added for a pixel whose own companions lie along a line: poles and wires behind others."""

HALF_PIXEL = wp.constant(wp.float32(0.5))
OCTANTS = 8
FAR = wp.constant(wp.float32(1.0e6))


@wp.func
def extent_of(spacing_bits: wp.int32):
    """How far a pixel stands for its surface [px]."""
    spacing = wp.float32(spacing_in(spacing_bits))
    return wp.where(is_along_line(spacing_bits), LINE_EXTENT * spacing, spacing)


@wp.func
def reach_square(spacing_bits: wp.int32):
    """Square of how far a pixel hides others [px^2]."""
    extent = extent_of(spacing_bits)
    is_dense = spacing_in(spacing_bits) == 1
    return wp.where(is_dense, DENSE_REACH_SQUARE, HIDING_REACH_SQUARE * extent * extent)


# From a pixel's edge: where its surface has gaps, it may lie anywhere in them.
@wp.func
def in_extents(way: wp.float32, spacing_bits: wp.int32):
    """A distance from a pixel, in what it stands for; between pixels without gaps in pixels."""
    is_dense = spacing_in(spacing_bits) == 1
    return wp.where(is_dense, way, (way - HALF_PIXEL) / extent_of(spacing_bits))


@wp.func
def may_hide(spacing: wp.int32, own_spacing: wp.int32):
    """Whether a pixel of a spacing hides one of another."""
    is_gap = spacing > 1 or own_spacing > 1  # between two surfaces without gaps nothing shines
    return is_gap and spacing <= wp.max(MOST_TIMES_SPARSER * own_spacing, SPARSE)


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
def is_surrounded(
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
    """Whether nearer pixels, each within its reach, stand closely round a pixel on all sides."""
    own_spacing = spacing_in(own_bits)
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
                    if own - nearer > margin:
                        is_any_nearer = True
                        down = (r << level) + row_of_cell(cell) - row
                        right = (c << level) + column_of_cell(cell) - column
                        right = offset_round(right, columns, grid.wraps)
                        square = wp.float32(down * down + right * right)
                        bits = spacing_bits_of_cell(cell)
                        is_in_reach = square <= reach_square(bits)
                        if is_in_reach and may_hide(spacing_in(bits), own_spacing):
                            way = wp.sqrt(square)
                            if own - nearer > margin + HIDING_SLOPE * way * pitch(grid, nearer):
                                bit = sector_bit(sector_bits, 2 * right, 2 * down)
                                sectors = sectors | bit
                                octant = lowest_bit(bit) >> 2
                                ways[octant] = wp.min(ways[octant], in_extents(way, bits))
        if not is_any_nearer:
            break
    if not surrounds(sectors, MOST_EMPTY):
        return False
    allowance = wp.where(is_along_line(own_bits), LINE_ALLOWANCE, wp.float32(0.0))
    loose = wp.float32(longest_empty_run(sectors)) + GAP_WEIGHT * gap_between(ways) + allowance
    return loose <= MOST_LOOSE


# Other pixels are read through the pyramid only, so erasing in place sees the map as it was. The
# bits of erased pixels go over from `words_out` to `erased_out`. Launch over (rows, runs).
@wp.kernel
def erase_surrounded(
    # In:
    first_row: wp.int32,
    cells: wp.array2d[wp.uint64],
    spacing: wp.array3d[wp.uint8],
    sector_bits: wp.array[wp.uint32],
    grids: wp.array[PixelGrid],
    keep_depth: wp.int32,
    # Out:
    depth_out: wp.array3d[wp.float32],
    index_out: wp.array3d[wp.int32],
    state_out: wp.array3d[wp.uint8],
    words_out: wp.array3d[wp.uint32],
    erased_out: wp.array3d[wp.uint32],
):
    i, run = wp.tid()
    rows = depth_out.shape[1]
    columns = depth_out.shape[2]
    v = (first_row + i) // rows
    row = (first_row + i) - v * rows
    grid = grids[v]
    for column in range(run * RUN, wp.min((run + 1) * RUN, columns)):
        own_bits = wp.int32(spacing[v, row, column])
        if own_bits > 0:
            own = depth_out[v, row, column]
            if is_surrounded(
                cells, sector_bits, grid, v, row, column, rows, columns, own, own_bits
            ):
                erase_pixel(depth_out, index_out, state_out, v, row, column, keep_depth)
                bit = wp.uint32(1) << wp.uint32(column % WORD)
                wp.atomic_and(words_out, v, row, column // WORD, ~bit)
                wp.atomic_or(erased_out, v, row, column // WORD, bit)


# Launch over (rows, words).
@wp.kernel
def erase_thinned(
    # In:
    first_row: wp.int32,
    spacing: wp.array3d[wp.uint8],
    keep_depth: wp.int32,
    # Out:
    depth_out: wp.array3d[wp.float32],
    index_out: wp.array3d[wp.int32],
    state_out: wp.array3d[wp.uint8],
):
    i, word = wp.tid()
    rows = depth_out.shape[1]
    v = (first_row + i) // rows
    row = (first_row + i) - v * rows
    for column in range(word * WORD, wp.min((word + 1) * WORD, depth_out.shape[2])):
        if wp.int32(spacing[v, row, column]) == THINNED:
            erase_pixel(depth_out, index_out, state_out, v, row, column, keep_depth)
