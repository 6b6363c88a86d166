"""Pixels that a lens has no ray for: kept, and put back where a filter has filled them.

The kernel takes `first_row`: rows of all views counted on.
"""

import warp as wp

from depthwarp_kernels.filters_fill import STATE_FILLED, STATE_FILLED_BORDER
from depthwarp_kernels.filters_layers import WORD, lowest_bit
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)


# Kept in a map of their own, and put back where the state says filled. Launch over (rows, words).
@wp.kernel
def copy_blind(
    # In:
    first_row: wp.int32,
    only_filled: wp.int32,
    blind: wp.array3d[wp.uint32],
    depth: wp.array3d[wp.float32],
    index: wp.array3d[wp.int32],
    state: wp.array3d[wp.uint8],
    # Out:
    depth_out: wp.array3d[wp.float32],
    index_out: wp.array3d[wp.int32],
    state_out: wp.array3d[wp.uint8],
):
    i, word = wp.tid()
    rows = depth.shape[1]
    v = (first_row + i) // rows
    row = (first_row + i) - v * rows
    bits = blind[v, row, word]
    while bits != wp.uint32(0):
        column = word * WORD + lowest_bit(bits)
        bits = bits & (bits - wp.uint32(1))
        old = state_out[v, row, column]
        if only_filled == 0 or old == STATE_FILLED or old == STATE_FILLED_BORDER:
            depth_out[v, row, column] = depth[v, row, column]
            index_out[v, row, column] = index[v, row, column]
            state_out[v, row, column] = state[v, row, column]
