"""Emptying pixels that a lens has no ray for."""

import warp as wp

from depthwarp_kernels.filters_fill import STATE_FILLED, STATE_FILLED_BORDER
from depthwarp_kernels.filters_layers import WORD, lowest_bit
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

STATE_EMPTY = wp.constant(wp.uint8(0))


# It takes `first_row`: rows of all views counted on. Launch over (rows, words).
@wp.kernel
def empty_blind(
    # In:
    first_row: wp.int32,
    blind: wp.array3d[wp.uint32],
    # Out:
    depth_out: wp.array3d[wp.float32],
    index_out: wp.array3d[wp.int32],
    state_out: wp.array3d[wp.uint8],
):
    i, word = wp.tid()
    rows = depth_out.shape[1]
    v = (first_row + i) // rows
    row = (first_row + i) - v * rows
    bits = blind[v, row, word]
    while bits != wp.uint32(0):
        column = word * WORD + lowest_bit(bits)
        bits = bits & (bits - wp.uint32(1))
        state = state_out[v, row, column]
        if state == STATE_FILLED or state == STATE_FILLED_BORDER:
            depth_out[v, row, column] = 0.0
            index_out[v, row, column] = -1
            state_out[v, row, column] = STATE_EMPTY
