"""The paper's erase and dilation on maps (views, rows, columns).

Both are a minimum over a square window, taken as a row pass and a column pass. The window of an
even side leans as OpenCV's default anchor does: offsets -(side // 2) to side - side // 2 - 1.
Pixels that were erased count as empty, also those that kept their depth. Kernels run over (rows,
columns) and take `first_row`: rows of all views counted on.
"""

from functools import cache

import warp as wp

from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

NO_RANK = 0xFFFFFFFFFFFFFFFF

STATE_FILLED = wp.constant(wp.uint8(2))
STATE_ERASED = wp.constant(wp.uint8(3))


@wp.kernel
def erase_row_minimum(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    state: wp.array3d[wp.uint8],
    side: wp.int32,
    # Out:
    nearest_out: wp.array3d[wp.float32],
):
    i, column = wp.tid()
    v = (first_row + i) // depth.shape[1]
    row = (first_row + i) % depth.shape[1]
    first = wp.max(column - side // 2, 0)
    last = wp.min(column - side // 2 + side, depth.shape[2])
    nearest = wp.float32(wp.inf)
    for c in range(first, last):
        d = depth[v, row, c]
        if d > 0.0 and state[v, row, c] != STATE_ERASED:
            nearest = wp.min(nearest, d)
    nearest_out[v, row, column] = nearest


# Reads other pixels only through `row_nearest`, so erasing in place sees the map as it was.
@wp.kernel
def erase_by_column(
    # In:
    first_row: wp.int32,
    row_nearest: wp.array3d[wp.float32],
    side: wp.int32,
    threshold: wp.float32,
    keep_depth: wp.int32,
    # Out:
    depth_out: wp.array3d[wp.float32],
    index_out: wp.array3d[wp.int32],
    state_out: wp.array3d[wp.uint8],
):
    i, column = wp.tid()
    v = (first_row + i) // depth_out.shape[1]
    row = (first_row + i) % depth_out.shape[1]
    d = depth_out[v, row, column]
    if d == 0.0 or state_out[v, row, column] == STATE_ERASED:
        return
    first = wp.max(row - side // 2, 0)
    last = wp.min(row - side // 2 + side, depth_out.shape[1])
    nearest = d
    for r in range(first, last):
        nearest = wp.min(nearest, row_nearest[v, r, column])
    if d - nearest > threshold:
        state_out[v, row, column] = STATE_ERASED
        if keep_depth == 0:
            depth_out[v, row, column] = 0.0
            index_out[v, row, column] = -1


@wp.func
def rank_farthest(depth: wp.float32, index: wp.int32):
    """Rank whose minimum is the farthest pixel, then the lowest index."""
    bits = wp.uint64(~wp.cast(depth, wp.uint32))
    return (bits << wp.uint64(32)) | wp.uint64(wp.cast(index, wp.uint32))


@wp.func
def depth_of_farthest(rank: wp.uint64):
    """Depth that `rank_farthest` packed."""
    return wp.cast(~wp.uint32(rank >> wp.uint64(32)), wp.float32)


@wp.func
def rank_nearest(depth: wp.float32, index: wp.int32):
    """Rank whose minimum is the nearest pixel, then the lowest index."""
    bits = wp.uint64(wp.cast(depth, wp.uint32))
    return (bits << wp.uint64(32)) | wp.uint64(wp.cast(index, wp.uint32))


@wp.func
def depth_of_nearest(rank: wp.uint64):
    """Depth that `rank_nearest` packed."""
    return wp.cast(wp.uint32(rank >> wp.uint64(32)), wp.float32)


@cache
def dilate_kernels(nearest: bool):
    """Row and column kernel of a dilation that grows the nearest or the farthest surface."""
    rank_of = rank_nearest if nearest else rank_farthest
    depth_of = depth_of_nearest if nearest else depth_of_farthest

    @wp.kernel(module="unique", module_options=EXACT, enable_backward=False)
    def dilate_row(
        # In:
        first_row: wp.int32,
        depth: wp.array3d[wp.float32],
        index: wp.array3d[wp.int32],
        state: wp.array3d[wp.uint8],
        side: wp.int32,
        # Out:
        rank_out: wp.array3d[wp.uint64],
    ):
        i, column = wp.tid()
        v = (first_row + i) // depth.shape[1]
        row = (first_row + i) % depth.shape[1]
        first = wp.max(column - side // 2, 0)
        last = wp.min(column - side // 2 + side, depth.shape[2])
        best = wp.uint64(NO_RANK)
        for c in range(first, last):
            d = depth[v, row, c]
            if d > 0.0 and state[v, row, c] != STATE_ERASED:
                best = wp.min(best, rank_of(d, index[v, row, c]))
        rank_out[v, row, column] = best

    @wp.kernel(module="unique", module_options=EXACT, enable_backward=False)
    def dilate_column(
        # In:
        first_row: wp.int32,
        row_rank: wp.array3d[wp.uint64],
        side: wp.int32,
        # Out:
        depth_out: wp.array3d[wp.float32],
        index_out: wp.array3d[wp.int32],
        state_out: wp.array3d[wp.uint8],
    ):
        i, column = wp.tid()
        v = (first_row + i) // depth_out.shape[1]
        row = (first_row + i) % depth_out.shape[1]
        first = wp.max(row - side // 2, 0)
        last = wp.min(row - side // 2 + side, depth_out.shape[1])
        best = row_rank[v, row, column]
        for r in range(first, last):
            best = wp.min(best, row_rank[v, r, column])
        if best == wp.uint64(NO_RANK):
            return
        d = depth_of(best)
        winner = wp.int32(best & wp.uint64(0xFFFFFFFF))
        own = d == depth_out[v, row, column] and winner == index_out[v, row, column]
        if not own or state_out[v, row, column] == STATE_ERASED:
            depth_out[v, row, column] = d
            index_out[v, row, column] = winner
            state_out[v, row, column] = STATE_FILLED

    return dilate_row, dilate_column
