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

STATE_ERASED = wp.constant(wp.uint8(3))


SPACING = wp.constant(63)
ALONG_LINE = wp.constant(64)
"""Of a pixel's spacing bits: its own-layer spacing, and that its companions lie along a line."""


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
def spacing_in(spacing_bits: wp.int32):
    """Own-layer spacing [px], 0 without a pixel."""
    return spacing_bits & SPACING


@wp.func
def is_along_line(spacing_bits: wp.int32):
    """Whether the companions of a pixel lie along a line."""
    return spacing_bits & ALONG_LINE != 0


# A cell is `depth bits << 32 | spacing bits << 16 | row in the area << 8 | column in the area`, so
# the smallest cell is the nearest pixel.
@wp.func
def depth_of_cell(cell: wp.uint64):
    """Depth [m]; NaN of an empty cell, so that no comparison with it holds."""
    return wp.cast(wp.uint32(cell >> wp.uint64(32)), wp.float32)


@wp.func
def spacing_bits_of_cell(cell: wp.uint64):
    """Own-layer spacing and whether the companions lie along a line, as of the pixel."""
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


# Isolated pixels are left out: they speak for no surface. A thread takes a block of 2 x 2 pixels,
# and the area of the second level that they are. Launch over (rows, columns) of blocks.
@wp.kernel
def fill_first_levels(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    spacing: wp.array3d[wp.uint8],
    limit: wp.array[wp.int32],
    # Out:
    cells_out: wp.array2d[wp.uint64],
):
    i, j = wp.tid()
    rows = depth.shape[1]
    columns = depth.shape[2]
    own_rows = (rows + 1) // 2
    v = (first_row + i) // own_rows
    block_row = (first_row + i) - v * own_rows
    nearest = wp.uint64(EMPTY_CELL)
    for k in range(4):
        row = 2 * block_row + k // 2
        column = 2 * j + k % 2
        if row < rows and column < columns:
            s = wp.int32(spacing[v, row, column])
            cell = wp.uint64(EMPTY_CELL)
            if s > 0 and spacing_in(s) <= limit[v]:
                bits = wp.uint64(wp.cast(depth[v, row, column], wp.uint32))
                cell = (bits << wp.uint64(32)) | wp.uint64(s << 16)
                nearest = wp.min(nearest, cell | wp.uint64(((k // 2) << 8) | (k % 2)))
            cells_out[v, row * columns + column] = cell
    cells_out[v, rows * columns + block_row * ((columns + 1) // 2) + j] = nearest


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
