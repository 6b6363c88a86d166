"""The nearer of two depth maps: what a renderer of points and another one see."""

from functools import cache

import warp as wp

from depthwarp_kernels.filters_layers import STATE_ERASED
from depthwarp_kernels.options import EXACT
from depthwarp_kernels.resolve import STATE_MEASURED

wp.set_module_options(EXACT)


@cache
def compose_kernel(outputs: frozenset[str]):
    """Kernel that writes another depth where it is nearer; launch over (rows, columns).

    Arrays of maps that are not among the outputs are not touched.
    """

    # A depth that is not positive, not finite or not within the bounds is no depth.
    @wp.kernel(module="unique", module_options=EXACT, enable_backward=False)
    def compose(
        # In:
        first_row: wp.int32,
        other: wp.array3d[wp.float32],
        least: wp.float32,
        greatest: wp.float32,
        # Out:
        depth_out: wp.array3d[wp.float32],
        index_out: wp.array3d[wp.int32],
        state_out: wp.array3d[wp.uint8],
    ):
        i, column = wp.tid()
        rows = depth_out.shape[1]
        v = (first_row + i) // rows
        row = (first_row + i) % rows
        theirs = other[v, row, column]
        ours = depth_out[v, row, column]
        if wp.static("state" in outputs):
            if state_out[v, row, column] == STATE_ERASED:
                ours = wp.float32(0.0)  # an erased pixel may have kept its depth
        seen = theirs > 0.0 and theirs >= least and theirs <= greatest
        if seen and (ours == 0.0 or theirs < ours):
            depth_out[v, row, column] = theirs
            if wp.static("index" in outputs):
                index_out[v, row, column] = -1
            if wp.static("state" in outputs):
                state_out[v, row, column] = STATE_MEASURED

    return compose
