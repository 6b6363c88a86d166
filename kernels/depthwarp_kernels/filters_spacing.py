"""Own-layer spacing: how far apart the pixels of one surface are in an image.

The spacing S of a pixel is the radius of the smallest square ring that holds 4 pixels of its layer.
They are looked for among the bits of present pixels, 32 a word, so that gaps cost nothing. Kernels
take `first_row`: rows of all views counted on, and run over (rows, runs of columns).
"""

import warp as wp

from depthwarp_kernels.filters_layers import PixelGrid, is_present, pitch
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


@wp.func
def with_ring(rings: wp.vec4i, ring: wp.int32):
    """The four smallest rings, rising, after one more."""
    return wp.vec4i(
        wp.min(rings[0], ring),
        wp.min(rings[1], wp.max(rings[0], ring)),
        wp.min(rings[2], wp.max(rings[1], ring)),
        wp.min(rings[3], wp.max(rings[2], ring)),
    )


# Rows are taken from the pixel's own outwards, of each only what could still be one of the four.
@wp.func
def ring_of_companions(
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
    """Ring of the fourth companion; above `reach` if there are fewer inside it."""
    rows = depth.shape[1]
    columns = depth.shape[2]
    rings = wp.vec4i(reach + 1, reach + 1, reach + 1, reach + 1)
    for k in range(2 * reach + 1):
        away = (k + 1) >> 1
        if away >= rings[3]:
            break
        r = wp.where(k & 1 != 0, row - away, row + away)
        if r >= 0 and r < rows:
            for turn in range(-wraps, wraps + 1):
                middle = column + turn * columns
                first = wp.max(middle - rings[3] + 1, 0)
                last = wp.min(middle + rings[3] - 1, columns - 1)
                for word in range(first // WORD, last // WORD + 1):
                    left = word * WORD
                    bits = bits_between(words[v, r, word], first - left, last - left)
                    while bits != wp.uint32(0):
                        c = left + lowest_bit(bits)
                        bits = bits & (bits - wp.uint32(1))
                        ring = wp.max(wp.abs(c - middle), away)
                        within = LAYER_MARGIN + slope * wp.float32(ring)
                        if ring > 0 and wp.abs(depth[v, r, c] - own) <= within:
                            rings = with_ring(rings, ring)
    return rings[3]


# The smallest ring of whole radius, at most `FARTHEST_RING`, inside which 4 pixels are of the
# pixel's own layer: within 0.03 m + r pitch of its depth, r the companion's own ring.
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
            while spacing == NO_RING and reach <= FARTHEST_RING:
                ring = ring_of_companions(
                    depth, words, v, row, left + k, reach, grid.wraps, own, slope
                )
                spacing = wp.where(ring <= reach, ring, NO_RING)
                reach = reach * REACH_FACTOR
            wp.atomic_add(counts_out, v, row, spacing, 1)
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
        reach = (3 * wp.int32(spacing_out[v, row, left + k]) - 1) // 2  # below 1.5 times as far
        is_left = (bits >> wp.uint32(k)) & wp.uint32(1) != wp.uint32(0)
        if is_left and reach <= FARTHEST_RING:
            if is_any_near(erased, v, row, left + k, columns, reach, grid.wraps):
                own = depth[v, row, left + k]
                slope = LAYER_SLOPE * pitch(grid, own)
                ring = ring_of_companions(
                    depth, words, v, row, left + k, reach, grid.wraps, own, slope
                )
                if ring > reach:
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
