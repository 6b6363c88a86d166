"""Packs a prepared cloud: how many planes each block needs, and the words of its points."""

import warp as wp

from depthwarp_kernels.options import EXACT
from depthwarp_kernels.packed_points import (
    LONG_BITS,
    SHORT_BITS,
    PackedBlock,
    decode,
    pack_long,
    pack_short,
)
from depthwarp_kernels.point_source import BLOCK

wp.set_module_options(EXACT)

SHORT_STEPS = wp.constant(wp.float32((1 << SHORT_BITS) - 1))
LONG_STEPS = wp.constant(wp.float32((1 << LONG_BITS) - 1))


# Where a block has no extent, or one that overflows, the quotient is not a number: then 0, so that
# it can become a whole one.
@wp.func
def whole_steps(x: wp.float32, low: wp.float32, step: wp.float32, most: wp.float32):
    """The nearest number of steps from the corner, from 0 to `most`."""
    steps = (x - low) / step + 0.5
    return wp.floor(wp.where(steps > 0.0, wp.min(steps, most), 0.0))


@wp.func
def encode(p: wp.vec3f, box: PackedBlock, most: wp.float32):
    """Steps of a point on all three axes."""
    return wp.vec3f(
        whole_steps(p[0], box.low[0], box.step[0], most),
        whole_steps(p[1], box.low[1], box.step[1], most),
        whole_steps(p[2], box.low[2], box.step[2], most),
    )


@wp.func
def is_near(p: wp.vec3f, q: wp.vec3f, bound: wp.float32):
    """Whether all coordinates differ by less than a bound; false for what is not a number."""
    d = p - q
    return wp.abs(d[0]) < bound and wp.abs(d[1]) < bound and wp.abs(d[2]) < bound


@wp.func
def points_near(
    x: wp.array[wp.float32],
    y: wp.array[wp.float32],
    z: wp.array[wp.float32],
    begin: wp.int32,
    box: PackedBlock,
    most: wp.float32,
    bound: wp.float32,
):
    """Points of a block that are drawn nearer than a bound to where they are."""
    near = int(0)
    for k in range(wp.static(BLOCK)):
        p = wp.vec3f(x[begin + k], y[begin + k], z[begin + k])
        near += wp.where(is_near(p, decode(box.low, box.step, encode(p, box, most)), bound), 1, 0)
    return near


# Launch over blocks from `first` on. Tried, not computed: each point is decoded as it will be when
# it is drawn, so all rounding is in the comparison. The difference is rounded too, but never to the
# other side of a float32, so it is below the bound only if the true one is.
# The last block, where it is not full, keeps its coordinates: what fills it up is not finite.
@wp.kernel
def choose_planes(
    # In:
    x: wp.array[wp.float32],
    y: wp.array[wp.float32],
    z: wp.array[wp.float32],
    first: wp.int32,
    bound: wp.float32,
    # Out:
    boxes_out: wp.array[PackedBlock],
):
    block = first + wp.tid()
    begin = block * wp.static(BLOCK)
    low = wp.vec3f(x[begin], y[begin], z[begin])
    high = low
    for k in range(wp.static(BLOCK)):
        p = wp.vec3f(x[begin + k], y[begin + k], z[begin + k])
        low = wp.min(low, p)
        high = wp.max(high, p)
    box = PackedBlock()
    box.low = low
    box.step = (high - low) / SHORT_STEPS
    box.planes = 1
    if points_near(x, y, z, begin, box, SHORT_STEPS, bound) < wp.static(BLOCK):
        box.step = (high - low) / LONG_STEPS
        box.planes = 2
        if points_near(x, y, z, begin, box, LONG_STEPS, bound) < wp.static(BLOCK):
            box.planes = 3
    boxes_out[block] = box


# Launch over blocks from `first` on. The coordinates become those that the words stand for.
@wp.kernel
def pack_blocks(
    # In:
    boxes: wp.array[PackedBlock],
    first: wp.int32,
    # Out:
    x_out: wp.array[wp.float32],
    y_out: wp.array[wp.float32],
    z_out: wp.array[wp.float32],
    first_out: wp.array[wp.uint32],
    second_out: wp.array[wp.uint32],
    third_out: wp.array[wp.uint32],
):
    block = first + wp.tid()
    box = boxes[block]
    begin = block * wp.static(BLOCK)
    at_second = box.second * wp.static(BLOCK)
    at_third = box.third * wp.static(BLOCK)
    for k in range(wp.static(BLOCK)):
        i = begin + k
        p = wp.vec3f(x_out[i], y_out[i], z_out[i])
        if box.planes == 1:
            steps = encode(p, box, SHORT_STEPS)
            first_out[i] = pack_short(steps)
        elif box.planes == 2:
            steps = encode(p, box, LONG_STEPS)
            word, more = pack_long(steps)
            first_out[i] = word
            second_out[at_second + k] = more
        else:
            first_out[i] = wp.cast(p[0], wp.uint32)
            second_out[at_second + k] = wp.cast(p[1], wp.uint32)
            third_out[at_third + k] = wp.cast(p[2], wp.uint32)
        if box.planes < 3:
            q = decode(box.low, box.step, steps)
            x_out[i] = q[0]
            y_out[i] = q[1]
            z_out[i] = q[2]
