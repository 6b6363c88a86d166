"""Own-layer spacing: how far apart the pixels of one surface are in an image.

The spacing S of a pixel is the radius of the smallest square ring that holds 4 pixels of its layer.
They are looked for among the bits of present pixels, 32 a word, so that gaps cost nothing. Kernels
take `first_row`: rows of all views counted on, and run over (rows, runs of columns).
"""

import warp as wp

from depthwarp_kernels.filters_layers import ALONG_LINE, PixelGrid, is_present, pitch, spacing_in
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

LAYER_MARGIN = wp.constant(wp.float32(0.03))
LAYER_SLOPE = wp.constant(wp.float32(1.0))
"""Pixels d apart are of one layer if their depths differ by at most 0.03 m + d pitch."""

FARTHEST_RING = wp.constant(32)
"""Largest ring that is searched [px]."""

NO_RING = wp.constant(33)
"""Spacing of a pixel without enough companions in the largest ring."""

THINNED = wp.constant(255)
"""In the place of a spacing: the pixel lost too many of its companions."""

LINE_SQUARE = wp.constant(wp.float32(11.56))
"""Square of what the directions to four companions, of length 1, add up to along a line: 3.4 of 4
at least, twice their angles taken."""

SPACING_BINS = 34
"""Counts of a row: of each spacing from 0 to `NO_RING`."""

WORD = wp.constant(32)
"""Columns whose presence is one word."""

RUN = wp.constant(8)
"""Columns that one thread takes, one after the other."""

FIRST_REACH = wp.constant(2)
REACH_FACTOR = wp.constant(4)
"""Rings are searched up to 2, 8 and 32 px, as long as they do not hold enough."""


# Launch over (rows, words).
@wp.kernel
def mark_present(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    state: wp.array3d[wp.uint8],
    # Out:
    words_out: wp.array3d[wp.uint32],
):
    i, word = wp.tid()
    rows = depth.shape[1]
    v = (first_row + i) // rows
    row = (first_row + i) - v * rows
    left = word * WORD
    bits = wp.uint32(0)
    for k in range(wp.min(WORD, depth.shape[2] - left)):
        present = is_present(depth[v, row, left + k], state[v, row, left + k])
        bits = bits | (wp.where(present, wp.uint32(1), wp.uint32(0)) << wp.uint32(k))
    words_out[v, row, word] = bits


@wp.func
def lowest_bit(word: wp.uint32):
    """Number of the lowest bit that is set, by the exponent of its value."""
    lowest = word & (~word + wp.uint32(1))
    return wp.int32(wp.cast(wp.float32(lowest), wp.uint32) >> wp.uint32(23)) - 127


@wp.func
def bits_between(word: wp.uint32, first: wp.int32, last: wp.int32):
    """The bits of a word from first to last; both may lie outside of it."""
    low = ~wp.uint32(0) << wp.uint32(wp.max(first, 0))
    high = ~wp.uint32(0) >> wp.uint32(WORD - 1 - wp.min(last, WORD - 1))
    return word & low & high


# A companion is `ring << 16 | 64 + right << 8 | 64 + down`, so the smallest number is the nearest.
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
def ring_of(companion: wp.int32):
    """Ring that a companion is in [px]."""
    return companion >> 16


# Of twice the angle to each, opposite directions are the same.
@wp.func
def lie_along_line(four: wp.vec4i):
    """Whether the directions to four companions are much the same, or opposite."""
    cosines = wp.float32(0.0)
    sines = wp.float32(0.0)
    for k in range(4):
        right = wp.float32(((four[k] >> 8) & 255) - 64)
        down = wp.float32((four[k] & 255) - 64)
        share = wp.float32(1.0) / (right * right + down * down)
        cosines += (right * right - down * down) * share
        sines += wp.float32(2.0) * right * down * share
    return cosines * cosines + sines * sines > LINE_SQUARE


# Rows are taken from the pixel's own outwards, the upper before the lower, of each only what lies
# in nearer rings than the last of the four. Of a row's in one ring the leftmost stay, also at a
# seam.
@wp.func
def nearest_companions(
    depth: wp.array3d[wp.float32],
    words: wp.array3d[wp.uint32],
    v: wp.int32,
    row: wp.int32,
    column: wp.int32,
    reach: wp.int32,
    wraps: wp.int32,
    own: wp.float32,
    slope: wp.float32,
):
    """The four nearest companions; the last one's ring is above `reach` if there are fewer."""
    rows = depth.shape[1]
    columns = depth.shape[2]
    none = (reach + 1) << 16
    four = wp.vec4i(none, none, none, none)
    for k in range(2 * reach + 1):
        away = (k + 1) >> 1
        most = ring_of(four[3]) - 1
        if away > most:
            break
        r = wp.where(k & 1 != 0, row - away, row + away)
        if r >= 0 and r < rows:
            for turn in range(-wraps, wraps + 1):
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
                        within = LAYER_MARGIN + slope * wp.float32(ring)
                        if ring > 0 and wp.abs(depth[v, r, c] - own) <= within:
                            place = (64 + c - middle) << 8 | (64 + r - row)
                            four = with_companion(four, ring << 16 | place)
    return four


# The smallest ring of whole radius, at most `FARTHEST_RING`, inside which 4 pixels are of the
# pixel's own layer: within 0.03 m + r pitch of its depth, r the companion's own ring; and whether
# they lie along a line, as one bit more.
# On a CPU one thread has a row and its counts; on CUDA several share them, hence the atomics.
# Launch over (rows, runs).
@wp.kernel
def find_spacing(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    words: wp.array3d[wp.uint32],
    grids: wp.array[PixelGrid],
    # Out:
    spacing_out: wp.array3d[wp.uint8],
    counts_out: wp.array3d[wp.int32],
):
    i, run = wp.tid()
    rows = depth.shape[1]
    v = (first_row + i) // rows
    row = (first_row + i) - v * rows
    left = run * RUN
    bits = words[v, row, left // WORD] >> wp.uint32(left % WORD)
    grid = grids[v]
    for k in range(wp.min(RUN, depth.shape[2] - left)):
        spacing = int(0)
        if (bits >> wp.uint32(k)) & wp.uint32(1) != wp.uint32(0):
            own = depth[v, row, left + k]
            slope = LAYER_SLOPE * pitch(grid, own)
            reach = int(FIRST_REACH)
            spacing = NO_RING
            is_line = bool(False)
            while spacing == NO_RING and reach <= FARTHEST_RING:
                four = nearest_companions(
                    depth, words, v, row, left + k, reach, grid.wraps, own, slope
                )
                if ring_of(four[3]) <= reach:
                    spacing = ring_of(four[3])
                    is_line = lie_along_line(four)
                reach = reach * REACH_FACTOR
            wp.atomic_add(counts_out, v, row, spacing, 1)
            spacing = wp.where(is_line, spacing | ALONG_LINE, spacing)
        spacing_out[v, row, left + k] = wp.uint8(spacing)


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


# What hides loses few companions, what is hidden most: a pixel whose spacing has grown by half or
# more since it was found is marked in its place. `words` are the pixels that are left, `erased`
# those that are not. Launch over (rows, runs).
@wp.kernel
def mark_thinned(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    words: wp.array3d[wp.uint32],
    erased: wp.array3d[wp.uint32],
    grids: wp.array[PixelGrid],
    # Out:
    spacing_out: wp.array3d[wp.uint8],
):
    i, run = wp.tid()
    rows = depth.shape[1]
    columns = depth.shape[2]
    v = (first_row + i) // rows
    row = (first_row + i) - v * rows
    left = run * RUN
    bits = words[v, row, left // WORD] >> wp.uint32(left % WORD)
    grid = grids[v]
    for k in range(wp.min(RUN, columns - left)):
        own_spacing = spacing_in(wp.int32(spacing_out[v, row, left + k]))
        reach = (3 * own_spacing - 1) // 2  # below 1.5 times as far
        is_left = (bits >> wp.uint32(k)) & wp.uint32(1) != wp.uint32(0)
        if is_left and reach <= FARTHEST_RING:
            if is_any_near(erased, v, row, left + k, columns, reach, grid.wraps):
                own = depth[v, row, left + k]
                slope = LAYER_SLOPE * pitch(grid, own)
                four = nearest_companions(
                    depth, words, v, row, left + k, reach, grid.wraps, own, slope
                )
                if ring_of(four[3]) > reach:
                    spacing_out[v, row, left + k] = wp.uint8(THINNED)


# Launch over (views, `SPACING_BINS`).
@wp.kernel
def sum_counts(
    # In:
    row_counts: wp.array3d[wp.int32],
    # Out:
    counts_out: wp.array2d[wp.int32],
):
    v, spacing = wp.tid()
    total = int(0)
    for row in range(row_counts.shape[1]):
        total += row_counts[v, row, spacing]
    counts_out[v, spacing] = total


# A pixel farther from its companions than 8 times the median, from 16 to 32 px, is isolated.
# Launch over views.
@wp.kernel
def find_limit(
    # In:
    counts: wp.array2d[wp.int32],
    # Out:
    limit_out: wp.array[wp.int32],
):
    v = wp.tid()
    total = int(0)
    for spacing in range(1, counts.shape[1]):
        total += counts[v, spacing]
    below = int(0)
    median = int(0)
    while 2 * below < total:
        median += 1
        below += counts[v, median]
    limit_out[v] = wp.clamp(8 * median, 16, FARTHEST_RING)
