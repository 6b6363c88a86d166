"""Hidden pixels: those that nearer ones surround, or that see too little of the sky before them.

Kernels erase in place: what they read of other pixels is a copy that was made before. They take
`first_row`: rows of all views counted on.
"""

import warp as wp

from depthwarp_kernels.filters_layers import (
    LEVELS,
    STATE_ERASED,
    PixelGrid,
    cells_of_level,
    column_in_image,
    column_of_cell,
    depth_of_cell,
    is_present,
    pitch,
    row_of_cell,
    spacing_of_cell,
)
from depthwarp_kernels.filters_spacing import RUN, THINNED, WORD
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

REACH = wp.constant(31)
"""Farthest offset of a pixel that is found in the pyramid, along rows and columns [px]."""

HIDING_REACH_4 = wp.constant(25)
"""A pixel hides others up to 2.5 times its own spacing away: 25 is the square of twice that."""

DENSE_REACH_4 = wp.constant(9)
"""The same of one whose surface has no gaps, of spacing 1: its eight neighbours."""

MOST_TIMES_SPARSER = wp.constant(6)
"""A pixel hides none whose own spacing is below a sixth of its: what is so sparse before a dense
surface is seldom a surface, but mixed pixels and strays."""

HIDING_MARGIN = wp.constant(wp.float32(0.02))
HIDING_SHARE = wp.constant(wp.float32(0.002))
HIDING_SLOPE = wp.constant(wp.float32(0.5))
"""It has to be nearer by 0.02 m + 0.2 % of the hidden one's depth + half of d pitch."""

HALF_REACH = wp.constant(63)
SIDE = wp.constant(127)
"""Sectors are in a table of offsets in half pixels: farthest one, and side of the table."""

MOST_EMPTY = wp.constant(11)
"""Longest run of empty sectors of a pixel that is hidden. Pixels on one side of a straight line,
however it lies, touch 17 sectors of 32 at most, and leave a run of 15."""

SECTORS = 32
"""Sectors of a full turn."""


@wp.func
def sector_bit(sector_bits: wp.array[wp.uint32], right: wp.int32, down: wp.int32):
    """Sector of an offset in half pixels, as one bit of 32; none of no offset."""
    return sector_bits[(down + HALF_REACH) * SIDE + right + HALF_REACH]


@wp.func
def surrounds(sectors: wp.uint32, most_empty: wp.int32):
    """Whether sectors of 32, as bits, leave no run of more empty ones (8 to 23) round the turn."""
    empty = wp.uint64(~sectors)
    ring = empty | (empty << wp.uint64(32))
    runs = ring & (ring >> wp.uint64(1))  # bit i: 2 empty ones from i on
    runs = runs & (runs >> wp.uint64(2))  # 4
    runs = runs & (runs >> wp.uint64(4))  # 8
    last = most_empty - 7  # where the last 8 of one too many begin
    longer = runs & (runs >> wp.uint64(wp.min(last, 8))) & (runs >> wp.uint64(last))
    return (longer & wp.uint64(0xFFFFFFFF)) == wp.uint64(0)


@wp.func
def offset_round(offset: wp.int32, columns: wp.int32, wraps: wp.int32):
    """An offset between columns, the shorter way where the image wraps."""
    if wraps != 0:
        if 2 * offset > columns:
            return offset - columns
        if 2 * offset < -columns:
            return offset + columns
    return offset


@wp.func
def is_in_reach(way_square: wp.int32, spacing: wp.int32, own_spacing: wp.int32):
    """Whether a pixel hides another so far away, by their spacings."""
    reach_4 = wp.where(spacing == 1, DENSE_REACH_4, HIDING_REACH_4 * spacing * spacing)
    is_gap = spacing > 1 or own_spacing > 1  # between two surfaces without gaps nothing shines
    return is_gap and 4 * way_square <= reach_4 and spacing <= MOST_TIMES_SPARSER * own_spacing


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
    own_spacing: wp.int32,
):
    """Whether nearer pixels, each within its reach, stand round a pixel on all sides."""
    margin = HIDING_MARGIN + HIDING_SHARE * own
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
                        square = down * down + right * right
                        if is_in_reach(square, spacing_of_cell(cell), own_spacing):
                            slope = HIDING_SLOPE * wp.sqrt(wp.float32(square)) * pitch(grid, nearer)
                            if own - nearer > margin + slope:
                                sectors = sectors | sector_bit(sector_bits, 2 * right, 2 * down)
        if not is_any_nearer:
            break
    return surrounds(sectors, MOST_EMPTY)


# Where a pixel's own depth is kept, its state alone says that it is erased.
@wp.func
def erase_pixel(
    depth: wp.array3d[wp.float32],
    index: wp.array3d[wp.int32],
    state: wp.array3d[wp.uint8],
    v: wp.int32,
    row: wp.int32,
    column: wp.int32,
    keep_depth: wp.int32,
):
    """Mark a pixel as erased, and empty it unless its depth is to be kept."""
    state[v, row, column] = STATE_ERASED
    if keep_depth == 0:
        depth[v, row, column] = 0.0
        index[v, row, column] = -1


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
        own_spacing = wp.int32(spacing[v, row, column])
        if own_spacing > 0:
            own = depth_out[v, row, column]
            if is_surrounded(
                cells, sector_bits, grid, v, row, column, rows, columns, own, own_spacing
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


# Depth of pixels that hold one, 0 elsewhere. Launch over (rows, columns).
@wp.kernel
def copy_present(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    state: wp.array3d[wp.uint8],
    # Out:
    depth_out: wp.array3d[wp.float32],
):
    i, column = wp.tid()
    v = (first_row + i) // depth.shape[1]
    row = (first_row + i) % depth.shape[1]
    d = depth[v, row, column]
    depth_out[v, row, column] = wp.where(is_present(d, state[v, row, column]), d, 0.0)


# In each of 8 sectors the pixel that stands highest above the viewing ray's foot leaves free what
# is nearer to the ray than it; together this is the part of the half sphere towards the camera
# that is free. Launch over (rows, columns).
@wp.kernel
def erase_by_cone(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    sector_bits: wp.array[wp.uint32],
    grids: wp.array[PixelGrid],
    radius: wp.int32,
    least_free: wp.float32,
    margin: wp.float32,
    keep_depth: wp.int32,
    # Out:
    depth_out: wp.array3d[wp.float32],
    index_out: wp.array3d[wp.int32],
    state_out: wp.array3d[wp.uint8],
):
    i, column = wp.tid()
    rows = depth.shape[1]
    columns = depth.shape[2]
    v = (first_row + i) // rows
    row = (first_row + i) % rows
    own = depth[v, row, column]
    if own == 0.0:
        return
    grid = grids[v]
    highest = wp.zeros(shape=(8,), dtype=wp.float32)  # cosine of the angle to the viewing ray
    for down in range(-radius, radius + 1):
        r = row + down
        if r >= 0 and r < rows:
            for right in range(-radius, radius + 1):
                c = column_in_image(column + right, columns, grid.wraps)
                way = down * down + right * right
                if c >= 0 and way <= radius * radius:
                    other = depth[v, r, c]
                    ahead = own - other
                    if other > 0.0 and ahead > margin:
                        aside = wp.sqrt(wp.float32(way)) * pitch(grid, other)
                        cosine = ahead / wp.sqrt(ahead * ahead + aside * aside)
                        bit = sector_bit(sector_bits, 2 * right, 2 * down)
                        for sector in range(8):
                            if (bit >> wp.uint32(4 * sector)) & wp.uint32(15) != wp.uint32(0):
                                highest[sector] = wp.max(highest[sector], cosine)
    free = wp.float32(0.0)
    for sector in range(8):
        free += wp.float32(0.125) * (wp.float32(1.0) - highest[sector])
    if free < least_free:
        erase_pixel(depth_out, index_out, state_out, v, row, column, keep_depth)
