"""Own-layer spacing: how far apart the pixels of one surface are in an image.

The spacing S of a pixel is the radius of the smallest square ring that holds 4 pixels of its layer,
its companions. Its extent, how far it stands for its surface, is S too; where the companions lie
along a line it is the way to the next row of points, or half of S. Kernels take `first_row`: rows
of all views counted on.
"""

import warp as wp

from depthwarp_kernels.filters_companions import (
    is_any_near,
    line_through,
    nearest_companions,
    ring_across,
    ring_of,
)
from depthwarp_kernels.filters_layers import (
    ALONG_LINE,
    WORD,
    PixelGrid,
    is_present,
    spacing_bits_of,
    spacing_in,
)
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

FARTHEST_RING = wp.constant(32)
"""Largest ring that is searched [px]."""

NO_RING = wp.constant(33)
"""Spacing of a pixel without enough companions in the largest ring."""

LINE_QUARTERS = wp.constant(2)
"""Extent where the companions lie along a line, so on two sides only: quarters of S."""

FARTHEST_ROW = wp.constant(12)
"""Rings that are searched for the next rows of points beside such a line [px]."""

SPACING_BINS = 34
"""Counts of a row: of each spacing from 0 to `NO_RING`."""

RUN = wp.constant(8)
"""Columns that one thread takes, one after the other."""

FIRST_REACH = wp.constant(2)
REACH_FACTOR = wp.constant(4)
"""Rings are searched up to 2, 8 and 32 px, as long as they do not hold enough."""

SPARSE_BITS = wp.constant(8)
"""Where a word has at most so many pixels, from 8 px on at once, to the same result."""


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


# Rows of points are a surface that the scanner saw at a grazing angle; poles and wires have none
# beside them.
@wp.func
def spacing_bits_at(
    depth: wp.array3d[wp.float32],
    words: wp.array3d[wp.uint32],
    grid: PixelGrid,
    v: wp.int32,
    row: wp.int32,
    column: wp.int32,
    extents: wp.int32,
):
    """Spacing bits of a present pixel; without extents its spacing alone."""
    is_sparse = wp.bit_count(words[v, row, column // WORD]) <= SPARSE_BITS
    reach = wp.where(is_sparse, FIRST_REACH * REACH_FACTOR, FIRST_REACH)
    four = nearest_companions(depth, words, grid, v, row, column, reach)
    while ring_of(four[3]) > reach and reach < FARTHEST_RING:
        reach = reach * REACH_FACTOR
        four = nearest_companions(depth, words, grid, v, row, column, reach)
    spacing = wp.where(ring_of(four[3]) > reach, NO_RING, ring_of(four[3]))
    if extents == 0:
        return spacing
    if spacing == NO_RING:
        return spacing_bits_of(NO_RING, 4 * NO_RING)
    line = line_through(four)
    if line[0] == 0.0 and line[1] == 0.0:
        return spacing_bits_of(spacing, 4 * spacing)
    across = int(FARTHEST_ROW + 1)
    if spacing <= FARTHEST_ROW:  # rows are farther apart than the companions along a line
        across = ring_across(depth, words, grid, v, row, column, FARTHEST_ROW, line)
    if across <= FARTHEST_ROW:
        return spacing_bits_of(spacing, 4 * across)
    return spacing_bits_of(spacing, LINE_QUARTERS * spacing) | ALONG_LINE


# On a CPU one thread has a row and its counts; on CUDA several share them, hence the atomics.
# Launch over (rows, runs of columns).
@wp.kernel
def find_spacing(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    words: wp.array3d[wp.uint32],
    grids: wp.array[PixelGrid],
    extents: wp.int32,
    # Out:
    spacing_out: wp.array3d[wp.uint16],
    counts_out: wp.array3d[wp.int32],
):
    i, run = wp.tid()
    rows = depth.shape[1]
    v = (first_row + i) // rows
    row = (first_row + i) - v * rows
    left = run * RUN
    present = words[v, row, left // WORD] >> wp.uint32(left % WORD)
    for k in range(wp.min(RUN, depth.shape[2] - left)):
        bits = int(0)
        if (present >> wp.uint32(k)) & wp.uint32(1) != wp.uint32(0):
            bits = spacing_bits_at(depth, words, grids[v], v, row, left + k, extents)
            wp.atomic_add(counts_out, v, row, spacing_in(bits), 1)
        spacing_out[v, row, left + k] = wp.uint16(bits)


# A pixel keeps its spacing unless one of the pixels no farther away was erased; of those that are
# there `words` knows. Launch over (rows, runs of columns).
@wp.kernel
def renew_spacing(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    words: wp.array3d[wp.uint32],
    erased: wp.array3d[wp.uint32],
    grids: wp.array[PixelGrid],
    # Out:
    spacing_out: wp.array3d[wp.uint16],
    counts_out: wp.array3d[wp.int32],
):
    i, run = wp.tid()
    rows = depth.shape[1]
    columns = depth.shape[2]
    v = (first_row + i) // rows
    row = (first_row + i) - v * rows
    left = run * RUN
    present = words[v, row, left // WORD] >> wp.uint32(left % WORD)
    for k in range(wp.min(RUN, columns - left)):
        spacing = int(0)
        if (present >> wp.uint32(k)) & wp.uint32(1) != wp.uint32(0):
            spacing = spacing_in(wp.int32(spacing_out[v, row, left + k]))
            reach = wp.min(spacing, FARTHEST_RING)
            if is_any_near(erased, v, row, left + k, columns, reach, grids[v].wraps):
                spacing = spacing_bits_at(depth, words, grids[v], v, row, left + k, 0)
            wp.atomic_add(counts_out, v, row, spacing, 1)
        spacing_out[v, row, left + k] = wp.uint16(spacing)


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
