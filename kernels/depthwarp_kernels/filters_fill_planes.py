"""Planes through samples, by least squares on inverse depth."""

import warp as wp

from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

WEIGHT_AREA = wp.constant(wp.float32(0.25))
RIDGE = wp.constant(wp.float32(0.05))
"""Weights are 1 / (d^2 + 0.25 px^2); 0.05 px^2 added to the spread keeps slopes of lines finite."""


@wp.struct
class Moments:
    """Weighted sums over a layer: of 1, offsets x and y, inverse depth q, and their products."""

    w: wp.float32
    x: wp.float32
    y: wp.float32
    q: wp.float32
    xx: wp.float32
    xy: wp.float32
    yy: wp.float32
    xq: wp.float32
    yq: wp.float32


@wp.func
def add_to(m: Moments, right: wp.int32, down: wp.int32, depth: wp.float32):
    """The sums with one more sample, at an offset in half pixels."""
    x = wp.float32(0.5) * wp.float32(right)
    y = wp.float32(0.5) * wp.float32(down)
    q = wp.float32(1.0) / depth
    w = wp.float32(1.0) / (x * x + y * y + WEIGHT_AREA)
    m.w += w
    m.x += w * x
    m.y += w * y
    m.q += w * q
    m.xx += w * (x * x)
    m.xy += w * (x * y)
    m.yy += w * (y * y)
    m.xq += w * (x * q)
    m.yq += w * (y * q)
    return m


# A plane in space is one in inverse depth: 1/z = a + b x + c y (by least squares).
@wp.func
def plane_of(m: Moments):
    """The fitted plane's (a, b, c)."""
    x = m.x / m.w
    y = m.y / m.w
    q = m.q / m.w
    xx = m.xx / m.w - x * x + RIDGE
    xy = m.xy / m.w - x * y
    yy = m.yy / m.w - y * y + RIDGE
    xq = m.xq / m.w - x * q
    yq = m.yq / m.w - y * q
    determinant = xx * yy - xy * xy
    b = (xq * yy - yq * xy) / determinant
    c = (yq * xx - xq * xy) / determinant
    return wp.vec3f(q - b * x - c * y, b, c)


@wp.func
def depth_of_plane(
    plane: wp.vec3f, right: wp.int32, down: wp.int32, near: wp.float32, far: wp.float32
):
    """Of a plane, at an offset in half pixels, within the depths of its samples."""
    x = wp.float32(0.5) * wp.float32(right)
    y = wp.float32(0.5) * wp.float32(down)
    inverse = plane[0] + plane[1] * x + plane[2] * y
    inverse = wp.clamp(inverse, wp.float32(1.0) / far, wp.float32(1.0) / near)
    return wp.clamp(wp.float32(1.0) / inverse, near, far)
