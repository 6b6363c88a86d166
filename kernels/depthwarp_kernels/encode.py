"""16-bit encoding of depth."""

import warp as wp

from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)


# value = depth / divisor * factor to the nearest integer (halves to even), in float64; a depth that
# would round to the empty value 0 becomes 1. A depth beyond 16 bits is counted, not wrapped.
@wp.kernel
def encode_uint16(
    # In:
    depth: wp.array2d[wp.float32],
    divisor: wp.float64,
    factor: wp.float64,
    # Out:
    value_out: wp.array2d[wp.uint16],
    overflow_out: wp.array[wp.int32],
):
    row, column = wp.tid()
    d = depth[row, column]
    if d == 0.0:
        value_out[row, column] = wp.uint16(0)
        return
    scaled = wp.rint(wp.float64(d) / divisor * factor)
    if scaled > wp.float64(65535.0):
        wp.atomic_add(overflow_out, 0, 1)
        value_out[row, column] = wp.uint16(0)
        return
    value_out[row, column] = wp.uint16(wp.max(scaled, wp.float64(1.0)))
