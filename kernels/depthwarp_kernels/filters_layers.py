"""Layers of a depth map: the nearest pixel of every area, with its spacing and place.

The pyramid of minima keeps it for areas of 1, 2, 4, 8 and 16 pixels a side. Kernels take
`first_row`: rows of all views counted on.
"""

import warp as wp

from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

LEVELS = 5
"""Levels of the pyramid: areas of 1 to 16 pixels a side."""

EMPTY_CELL = 0xFFFFFFFFFFFFFFFF

LARGEST_DEPTH = wp.constant(wp.float32(3.0e38))

WORD = wp.constant(32)
"""Columns whose presence is one word of bits."""

STATE_ERASED = wp.constant(wp.uint8(3))


SPACING = wp.constant(63)
ALONG_LINE = wp.constant(64)
"""A pixel's spacing bits are `extent [px / 4] << 8 | 64 where its layer is a line | own-layer
spacing [px]`, and 0 without a pixel."""


@wp.struct
class PixelGrid:
    """What filters know of a camera.

    At depth z two neighbouring pixels are `slope * z + constant` metres apart. `wraps` is 1 where
    the first and the last column are neighbours.
    """

    slope: wp.float32
    constant: wp.float32
    wraps: wp.int32


@wp.func
def pitch(grid: PixelGrid, depth: wp.float32):
    """Metres between neighbouring pixels at a depth."""
    return grid.slope * depth + grid.constant


@wp.func
def is_present(depth: wp.float32, state: wp.uint8):
    """Whether a pixel has a depth: it is not empty, not erased with its depth kept, and finite."""
    return depth > 0.0 and depth < LARGEST_DEPTH and state != STATE_ERASED


@wp.func
def column_in_image(column: wp.int32, columns: wp.int32, wraps: wp.int32):
    """The column, round the turn where the image wraps; -1 outside."""
    if column >= 0 and column < columns:
        return column
    if wraps == 0:
        return -1
    if column < 0:
        column += columns
    else:
        column -= columns
    return wp.where(column >= 0 and column < columns, column, -1)


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
def spacing_bits_of(spacing: wp.int32, quarters: wp.int32):
    """Spacing bits of an own-layer spacing [px] and an extent [px / 4]."""
    return spacing | (quarters << 8)


@wp.func
def spacing_in(spacing_bits: wp.int32):
    """Own-layer spacing [px], 0 without a pixel."""
    return spacing_bits & SPACING


@wp.func
def is_along_line(spacing_bits: wp.int32):
    """Whether a pixel is of a line, such as a pole or a wire: of no surface to both sides."""
    return spacing_bits & ALONG_LINE != 0


@wp.func
def extent_in(spacing_bits: wp.int32):
    """How far a pixel stands for its surface round it [px]."""
    return wp.float32(0.25) * wp.float32(spacing_bits >> 8)


# A cell is `depth bits << 32 | spacing bits << 16 | row in the area << 8 | column in the area`, so
# the smallest cell is the nearest pixel.
@wp.func
def depth_of_cell(cell: wp.uint64):
    """Depth [m]; NaN of an empty cell, so that no comparison with it holds."""
    return wp.cast(wp.uint32(cell >> wp.uint64(32)), wp.float32)


@wp.func
def spacing_bits_of_cell(cell: wp.uint64):
    """Spacing bits, as of the pixel."""
    return wp.int32(wp.uint32(cell) >> wp.uint32(16))


@wp.func
def spacing_of_cell(cell: wp.uint64):
    """Own-layer spacing [px]."""
    return spacing_in(spacing_bits_of_cell(cell))


@wp.func
def row_of_cell(cell: wp.uint64):
    """Row of the pixel inside the area."""
    return wp.int32((wp.uint32(cell) >> wp.uint32(8)) & wp.uint32(255))


@wp.func
def column_of_cell(cell: wp.uint64):
    """Column of the pixel inside the area."""
    return wp.int32(wp.uint32(cell) & wp.uint32(255))


@wp.func
def cells_of_level(rows: wp.int32, columns: wp.int32, level: wp.int32):
    """Areas of 1, 2, 4, ... pixels a side that an image has."""
    return (((rows - 1) >> level) + 1) * (((columns - 1) >> level) + 1)


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


# Isolated pixels are left out: they speak for no surface. A thread takes blocks of 2 x 2 pixels,
# each an area of the second level, of a word's columns; `words` says which pixels are there. Launch
# over (rows of blocks, words).
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
    own_rows = (rows + 1) // 2
    own_columns = (columns + 1) // 2
    v = (first_row + i) // own_rows
    block_row = (first_row + i) - v * own_rows
    most = limit[v]
    for column in range(word * WORD, wp.min((word + 1) * WORD, columns), 2):
        nearest = wp.uint64(EMPTY_CELL)
        for down in range(2):
            row = 2 * block_row + down
            if row < rows:
                bits = words[v, row, word] >> wp.uint32(column % WORD)
                for right in range(2):
                    cell = wp.uint64(EMPTY_CELL)
                    if (bits >> wp.uint32(right)) & wp.uint32(1) != wp.uint32(0):
                        own_bits = wp.int32(spacing[v, row, column + right])
                        if spacing_in(own_bits) <= most:
                            kept = wp.where(extents != 0, own_bits, spacing_in(own_bits))
                            near = wp.uint64(wp.cast(depth[v, row, column + right], wp.uint32))
                            cell = (near << wp.uint64(32)) | wp.uint64(kept << 16)
                            place = wp.uint64((down << 8) | right)
                            nearest = wp.min(nearest, cell | place)
                    if column + right < columns:
                        cells_out[v, row * columns + column + right] = cell
        cells_out[v, rows * columns + block_row * own_columns + column // 2] = nearest


# Launch over (rows, columns) of the level; `below` is the first cell of the finer level, of
# `rows` x `columns` cells, and `own` that of this one.
@wp.kernel
def fill_next_level(
    # In:
    first_row: wp.int32,
    below: wp.int32,
    own: wp.int32,
    rows: wp.int32,
    columns: wp.int32,
    level: wp.int32,
    # Out:
    cells_out: wp.array2d[wp.uint64],
):
    i, column = wp.tid()
    own_rows = (rows + 1) // 2
    v = (first_row + i) // own_rows
    row = (first_row + i) % own_rows
    half = wp.uint64(1 << (level - 1))
    nearest = wp.uint64(EMPTY_CELL)
    for k in range(4):
        r = 2 * row + k // 2
        c = 2 * column + k % 2
        if r < rows and c < columns:
            cell = cells_out[v, below + r * columns + c]
            if cell != wp.uint64(EMPTY_CELL):
                place = half * wp.uint64(k % 2) + (half * wp.uint64(k // 2) << wp.uint64(8))
                nearest = wp.min(nearest, cell + place)
    cells_out[v, own + row * ((columns + 1) // 2) + column] = nearest
