"""Layers of a depth map: what is kept of a pixel and of the nearest one of every area."""

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
def lowest_bit(word: wp.uint32):
    """Number of the lowest bit that is set, by the exponent of its value; the word is not 0."""
    lowest = word & (~word + wp.uint32(1))
    return wp.int32(wp.cast(wp.float32(lowest), wp.uint32) >> wp.uint32(23)) - 127


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


@wp.func
def cell_of(
    depth: wp.float32, spacing_bits: wp.int32, extents: wp.int32, row: wp.int32, column: wp.int32
):
    """A pixel at a place in an area; without extents its spacing bits are its spacing alone."""
    kept = wp.where(extents != 0, spacing_bits, spacing_in(spacing_bits))
    near = wp.uint64(wp.cast(depth, wp.uint32))
    place = wp.uint64((row << 8) | column)
    return (near << wp.uint64(32)) | (wp.uint64(kept) << wp.uint64(16)) | place
