"""Spatial order of a cloud: places along a curve, coordinates apart, spheres round blocks."""

from functools import cache

import warp as wp

from depthwarp_kernels.options import EXACT
from depthwarp_kernels.point_source import BLOCK, GROUP, PointSource
from depthwarp_kernels.view import is_finite

wp.set_module_options(EXACT)

AXIS_BITS = 10
LAST_CODE = wp.constant(0x7FFFFFFF)  # behind all codes: points that are not finite


@wp.func
def spread(bits: wp.int32):
    """Ten bits with two zeros between each."""
    b = bits & 0x3FF
    b = (b | (b << 16)) & 0x030000FF
    b = (b | (b << 8)) & 0x0300F00F
    b = (b | (b << 4)) & 0x030C30C3
    return (b | (b << 2)) & 0x09249249


# Skilling 2004, "Programming the Hilbert curve". Unlike Morton's, this curve never jumps, so that a
# block of points along it is compact.
@wp.func
def hilbert_code(x: wp.int32, y: wp.int32, z: wp.int32):
    """Place of a cell along the Hilbert curve through a cube of 2^AXIS_BITS cells a side."""
    for step in range(wp.static(AXIS_BITS - 1)):
        bit = wp.static(1 << (AXIS_BITS - 1)) >> step
        below = bit - 1
        # Each axis in turn either turns the first one round below this bit or swaps with it.
        x = wp.where((x & bit) != 0, x ^ below, x)
        swap = wp.where((y & bit) != 0, 0, (x ^ y) & below)
        x = wp.where((y & bit) != 0, x ^ below, x ^ swap)
        y = y ^ swap
        swap = wp.where((z & bit) != 0, 0, (x ^ z) & below)
        x = wp.where((z & bit) != 0, x ^ below, x ^ swap)
        z = z ^ swap
    # From Gray code to a number.
    y = y ^ x
    z = z ^ y
    turn = int(0)
    for step in range(wp.static(AXIS_BITS - 1)):
        bit = wp.static(1 << (AXIS_BITS - 1)) >> step
        turn = wp.where((z & bit) != 0, turn ^ (bit - 1), turn)
    return (spread(x ^ turn) << 2) | (spread(y ^ turn) << 1) | spread(z ^ turn)


# Launch over points from `first` on. `scale`: cells a metre, the same for all axes.
@wp.kernel
def curve_codes(
    # In:
    points_world: wp.array[wp.vec3f],
    lowest: wp.vec3f,
    scale: wp.float32,
    first: wp.int32,
    # Out:
    codes_out: wp.array[wp.int32],
    order_out: wp.array[wp.int32],
):
    i = first + wp.tid()
    p = points_world[i]
    cell = (p - lowest) * scale
    code = hilbert_code(wp.int32(cell[0]), wp.int32(cell[1]), wp.int32(cell[2]))
    codes_out[i] = wp.where(is_finite(p), code, LAST_CODE)
    order_out[i] = i


# Neighbours along the curve fall into one pixel, where each minimum would wait for the one before.
@wp.func
def apart(place: wp.int32, count: wp.int32):
    """The same place of another point of its block, neighbours 16 apart; not in the last block."""
    k = place % wp.static(BLOCK)
    begin = place - k
    return begin + wp.where(begin + wp.static(BLOCK) <= count, (k % 32) * 16 + k / 32, k)


# Launch over the places of a prepared cloud of `count` points from `first` on.
@wp.kernel
def take_apart(
    # In:
    points_world: wp.array[wp.vec3f],
    order: wp.array[wp.int32],
    first: wp.int32,
    count: wp.int32,
    # Out:
    x_out: wp.array[wp.float32],
    y_out: wp.array[wp.float32],
    z_out: wp.array[wp.float32],
    original_out: wp.array[wp.int32],
):
    place = first + wp.tid()
    original = order[place]
    i = apart(place, count)
    p = points_world[original]
    x_out[i] = p[0]
    y_out[i] = p[1]
    z_out[i] = p[2]
    original_out[i] = original


@wp.func
def center_of(sphere: wp.vec4f):
    """Its first three numbers."""
    return wp.vec3f(sphere[0], sphere[1], sphere[2])


# Launch over blocks from `first` on. The half diagonal of the box, rounded up.
@wp.kernel
def block_spheres(
    # In:
    x: wp.array[wp.float32],
    y: wp.array[wp.float32],
    z: wp.array[wp.float32],
    first: wp.int32,
    count: wp.int32,
    # Out:
    spheres_out: wp.array[wp.vec4f],
):
    block = first + wp.tid()
    begin = block * wp.static(BLOCK)
    low = wp.vec3f(x[begin], y[begin], z[begin])
    high = low
    for i in range(begin + 1, wp.min(begin + wp.static(BLOCK), count)):
        p = wp.vec3f(x[i], y[i], z[i])
        low = wp.min(low, p)
        high = wp.max(high, p)
    center = 0.5 * low + 0.5 * high
    reach = wp.max(high - center, center - low)
    radius = wp.length(reach) * 1.00001
    spheres_out[block] = wp.vec4f(center[0], center[1], center[2], radius)


# Launch over groups of blocks from `first` on; there are `blocks` of them.
@wp.kernel
def group_spheres(
    # In:
    spheres: wp.array[wp.vec4f],
    first: wp.int32,
    blocks: wp.int32,
    # Out:
    groups_out: wp.array[wp.vec4f],
):
    group = first + wp.tid()
    begin = group * wp.static(GROUP)
    end = wp.min(begin + wp.static(GROUP), blocks)
    low = center_of(spheres[begin])
    high = low
    for block in range(begin + 1, end):
        center = center_of(spheres[block])
        low = wp.min(low, center)
        high = wp.max(high, center)
    middle = 0.5 * low + 0.5 * high
    radius = float(0.0)
    for block in range(begin, end):
        reach = wp.length(center_of(spheres[block]) - middle) + spheres[block][3]
        radius = wp.max(radius, reach)
    groups_out[group] = wp.vec4f(middle[0], middle[1], middle[2], radius * 1.00001)


@cache
def restore_kernel(source: PointSource):
    """Kernel that brings points to the caller's rows; launch over those from `first` on."""
    Source = source.struct
    point_at, index_at = source.point_at, source.index_at

    @wp.kernel(module="unique", module_options=EXACT, enable_backward=False)
    def restore_points(
        # In:
        points: Source,
        first: wp.int32,
        # Out:
        points_world_out: wp.array[wp.vec3f],
    ):
        i = first + wp.tid()
        points_world_out[index_at(points, i)] = point_at(points, i)

    return restore_points
