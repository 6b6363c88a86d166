"""Strays: pixels that many others are nearer to than any of their own layer.

Mixed pixels, which a scanner measures at an edge between two surfaces, and false returns lie in
front of surfaces or between them, alone. Kernels take `first_row`: rows of all views counted on.
"""

import warp as wp

from depthwarp_kernels.filters_companions import (
    bits_between,
    nearest_companions,
    ring_of,
)
from depthwarp_kernels.filters_layers import (
    WORD,
    PixelGrid,
    is_along_line,
    lowest_bit,
    spacing_in,
)
from depthwarp_kernels.filters_spacing import FARTHEST_RING
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

CROWD = wp.constant(12)
"""A stray has so many other pixels in nearer rings than its nearest companion."""


@wp.func
def count_near(
    words: wp.array3d[wp.uint32],
    hidden: wp.array3d[wp.uint32],
    v: wp.int32,
    row: wp.int32,
    column: wp.int32,
    columns: wp.int32,
    reach: wp.int32,
    wraps: wp.int32,
):
    """How many pixels that are not hidden a square round a pixel holds, the pixel among them."""
    count = int(0)
    for turn in range(-wraps, wraps + 1):
        middle = column + turn * columns
        first = wp.max(middle - reach, 0)
        last = wp.min(middle + reach, columns - 1)
        for word in range(first // WORD, last // WORD + 1):
            left = word * WORD
            for r in range(wp.max(row - reach, 0), wp.min(row + reach + 1, words.shape[1])):
                bits = words[v, r, word] & ~hidden[v, r, word]
                count += wp.bit_count(bits_between(bits, first - left, last - left))
    return count


# The fourth companion is no nearer than the first: where there is no crowd up to there, there is
# none. Of a floor at a grazing angle the pixels far away may have no four companions.
@wp.func
def is_stray(
    depth: wp.array3d[wp.float32],
    words: wp.array3d[wp.uint32],
    hidden: wp.array3d[wp.uint32],
    grid: PixelGrid,
    v: wp.int32,
    row: wp.int32,
    column: wp.int32,
    spacing_bits: wp.int32,
):
    """Whether a pixel is a stray; none is that is of a line or has no four companions."""
    columns = depth.shape[2]
    spacing = spacing_in(spacing_bits)
    if spacing < 3 or spacing > FARTHEST_RING or is_along_line(spacing_bits):
        return False  # below 3 px, 3 x 3 pixels are no crowd
    if count_near(words, hidden, v, row, column, columns, spacing - 1, grid.wraps) <= CROWD:
        return False
    four = nearest_companions(depth, words, grid, v, row, column, spacing)
    reach = ring_of(four[0]) - 1
    return count_near(words, hidden, v, row, column, columns, reach, grid.wraps) > CROWD


# Launch over (rows, words).
@wp.kernel
def add_strays(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    words: wp.array3d[wp.uint32],
    spacing: wp.array3d[wp.uint16],
    hidden: wp.array3d[wp.uint32],
    grids: wp.array[PixelGrid],
    # Out:
    erased_out: wp.array3d[wp.uint32],
):
    i, word = wp.tid()
    rows = depth.shape[1]
    v = (first_row + i) // rows
    row = (first_row + i) - v * rows
    erased = hidden[v, row, word]
    bits = words[v, row, word] & ~erased
    while bits != wp.uint32(0):
        lowest = lowest_bit(bits)
        bits = bits & (bits - wp.uint32(1))
        column = word * WORD + lowest
        own_bits = wp.int32(spacing[v, row, column])
        if is_stray(depth, words, hidden, grids[v], v, row, column, own_bits):
            erased = erased | (wp.uint32(1) << wp.uint32(lowest))
    erased_out[v, row, word] = erased
