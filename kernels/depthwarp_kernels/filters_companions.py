"""A pixel's companions: the pixels nearest to it that are of its own layer.

They are looked for among the bits of present pixels, 32 a word, so that gaps cost nothing.
"""

import warp as wp

from depthwarp_kernels.filters_layers import WORD, PixelGrid, lowest_bit, pitch
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

LAYER_MARGIN = wp.constant(wp.float32(0.025))
LAYER_SLOPE = wp.constant(wp.float32(1.0))
"""Pixels d apart are of one layer if their depths differ by at most 0.025 m + d pitch."""

LINE_SQUARE = wp.constant(wp.float32(10.24))
"""Square of 3.2: four companions lie along a line if their directions, as vectors of length 1 whose
angles are doubled, add up to more. Of angles doubled, opposite directions are the same."""


@wp.func
def bits_between(word: wp.uint32, first: wp.int32, last: wp.int32):
    """The bits of a word from first to last; both may lie outside of it."""
    low = ~wp.uint32(0) << wp.uint32(wp.max(first, 0))
    high = ~wp.uint32(0) >> wp.uint32(WORD - 1 - wp.min(last, WORD - 1))
    return word & low & high


@wp.func
def is_any_near(
    words: wp.array3d[wp.uint32],
    v: wp.int32,
    row: wp.int32,
    column: wp.int32,
    columns: wp.int32,
    reach: wp.int32,
    wraps: wp.int32,
):
    """Whether a bit is set in the square ring round a pixel, or inside of it."""
    found = wp.uint32(0)
    for turn in range(-wraps, wraps + 1):
        middle = column + turn * columns
        first = wp.max(middle - reach, 0)
        last = wp.min(middle + reach, columns - 1)
        for word in range(first // WORD, last // WORD + 1):
            left = word * WORD
            for r in range(wp.max(row - reach, 0), wp.min(row + reach + 1, words.shape[1])):
                found = found | bits_between(words[v, r, word], first - left, last - left)
    return found != wp.uint32(0)


# A companion is `ring << 16 | 64 + right << 8 | 64 + down`, so the smallest number is the nearest.
@wp.func
def ring_of(companion: wp.int32):
    """Ring that a companion is in [px]."""
    return companion >> 16


@wp.func
def right_of(companion: wp.int32):
    """Columns from the pixel to a companion."""
    return ((companion >> 8) & 255) - 64


@wp.func
def down_of(companion: wp.int32):
    """Rows from the pixel to a companion."""
    return (companion & 255) - 64


@wp.func
def with_companion(four: wp.vec4i, one: wp.int32):
    """The four nearest companions, the nearest first, after one more."""
    return wp.vec4i(
        wp.min(four[0], one),
        wp.min(four[1], wp.max(four[0], one)),
        wp.min(four[2], wp.max(four[1], one)),
        wp.min(four[3], wp.max(four[2], one)),
    )


@wp.func
def is_companion(depth: wp.float32, own: wp.float32, slope: wp.float32, ring: wp.int32):
    """Whether a pixel in a ring is of the layer of the middle, which is not in a ring itself."""
    return ring > 0 and wp.abs(depth - own) <= LAYER_MARGIN + slope * wp.float32(ring)


# Rows are taken from the pixel's own outwards, the upper before the lower, of each only what lies
# in nearer rings than the last of the four. Of a row's in one ring the leftmost stay, also at a
# seam.
@wp.func
def nearest_companions(
    depth: wp.array3d[wp.float32],
    words: wp.array3d[wp.uint32],
    grid: PixelGrid,
    v: wp.int32,
    row: wp.int32,
    column: wp.int32,
    reach: wp.int32,
):
    """The four nearest companions; the last one's ring is above `reach` if there are fewer."""
    rows = depth.shape[1]
    columns = depth.shape[2]
    own = depth[v, row, column]
    slope = LAYER_SLOPE * pitch(grid, own)
    none = (reach + 1) << 16
    four = wp.vec4i(none, none, none, none)
    for k in range(2 * reach + 1):
        away = (k + 1) >> 1
        most = ring_of(four[3]) - 1
        if away > most:
            break
        r = wp.where(k & 1 != 0, row - away, row + away)
        if r >= 0 and r < rows:
            for turn in range(-grid.wraps, grid.wraps + 1):
                middle = column + turn * columns
                first = wp.max(middle - most, 0)
                last = wp.min(middle + most, columns - 1)
                for word in range(first // WORD, last // WORD + 1):
                    left = word * WORD
                    bits = bits_between(words[v, r, word], first - left, last - left)
                    while bits != wp.uint32(0):
                        c = left + lowest_bit(bits)
                        bits = bits & (bits - wp.uint32(1))
                        ring = wp.max(wp.abs(c - middle), away)
                        if is_companion(depth[v, r, c], own, slope, ring):
                            place = (64 + c - middle) << 8 | (64 + r - row)
                            four = with_companion(four, ring << 16 | place)
    return four


@wp.func
def line_through(four: wp.vec4i):
    """Direction, of length 1, of the line that four companions lie along; (0, 0) if none."""
    cosines = wp.float32(0.0)
    sines = wp.float32(0.0)
    for k in range(4):
        right = wp.float32(right_of(four[k]))
        down = wp.float32(down_of(four[k]))
        share = wp.float32(1.0) / (right * right + down * down)
        cosines += (right * right - down * down) * share
        sines += wp.float32(2.0) * right * down * share
    square = cosines * cosines + sines * sines
    if square <= LINE_SQUARE:
        return wp.vec2f(0.0, 0.0)
    half = wp.float32(0.5) * cosines / wp.sqrt(square)
    down = wp.sqrt(wp.max(wp.float32(0.5) - half, wp.float32(0.0)))
    right = wp.sqrt(wp.max(wp.float32(0.5) + half, wp.float32(0.0)))
    return wp.vec2f(right, wp.where(sines < 0.0, -down, down))


# The sine of the angle between the line and the way to a companion is above a half where it is
# more than 30 degrees.
@wp.func
def ring_across(
    depth: wp.array3d[wp.float32],
    words: wp.array3d[wp.uint32],
    grid: PixelGrid,
    v: wp.int32,
    row: wp.int32,
    column: wp.int32,
    reach: wp.int32,
    line: wp.vec2f,
):
    """The ring that holds companions on both sides of a line; above `reach` if there is none."""
    rows = depth.shape[1]
    columns = depth.shape[2]
    own = depth[v, row, column]
    slope = LAYER_SLOPE * pitch(grid, own)
    sides = wp.vec2i(reach + 1, reach + 1)
    for k in range(2 * reach + 1):
        away = (k + 1) >> 1
        most = wp.max(sides[0], sides[1]) - 1
        if away > most:
            break
        r = wp.where(k & 1 != 0, row - away, row + away)
        if r >= 0 and r < rows:
            for turn in range(-grid.wraps, grid.wraps + 1):
                middle = column + turn * columns
                first = wp.max(middle - most, 0)
                last = wp.min(middle + most, columns - 1)
                for word in range(first // WORD, last // WORD + 1):
                    left = word * WORD
                    bits = bits_between(words[v, r, word], first - left, last - left)
                    while bits != wp.uint32(0):
                        c = left + lowest_bit(bits)
                        bits = bits & (bits - wp.uint32(1))
                        ring = wp.max(wp.abs(c - middle), away)
                        if is_companion(depth[v, r, c], own, slope, ring):
                            right = wp.float32(c - middle)
                            down = wp.float32(r - row)
                            across = line[0] * down - line[1] * right
                            if 4.0 * across * across > right * right + down * down:
                                side = wp.where(across > 0.0, 0, 1)
                                sides[side] = wp.min(sides[side], ring)
    return wp.max(sides[0], sides[1])
