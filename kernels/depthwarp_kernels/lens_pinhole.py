"""Projection onto a plane: the ideal pinhole and its distorted forms, and parallel rays.

(a, b) are the coordinates on the plane at distance 1, a to the right and b down.
"""

import warp as wp

from depthwarp_kernels.cull import inside_planes, may_meet_box, may_meet_planes
from depthwarp_kernels.lens import LensModel, drawn_if, range_of_parallel


# fx, fy, cx, cy [px]; pixel centres at whole numbers.
@wp.struct
class PinholeLens:
    fx: wp.float32
    fy: wp.float32
    cx: wp.float32
    cy: wp.float32


@wp.func
def project_pinhole(lens: PinholeLens, tables: wp.array[wp.float32], p: wp.vec3f):
    """Column and row of a camera-frame point ahead."""
    return wp.vec3f(lens.cx - lens.fx * (p[1] / p[0]), lens.cy - lens.fy * (p[2] / p[0]), 1.0)


@wp.func
def slopes_of(x: wp.float32, across: wp.float32, radius: wp.float32):
    """Least and greatest across / x in a sphere: those of the tangents through the camera."""
    middle = x * across
    reach = radius * wp.sqrt(wp.max(x * x + across * across - radius * radius, 0.0))
    below = x * x - radius * radius
    return wp.vec2f((middle - reach) / below, (middle + reach) / below)


@wp.func
def bounds_pinhole(lens: PinholeLens, center: wp.vec3f, radius: wp.float32):
    """Least column and row, greatest column and row of a sphere ahead."""
    left = slopes_of(center[0], center[1], radius)
    up = slopes_of(center[0], center[2], radius)
    return wp.vec4f(
        lens.cx - lens.fx * left[1],
        lens.cy - lens.fy * up[1],
        lens.cx - lens.fx * left[0],
        lens.cy - lens.fy * up[0],
    )


PINHOLE = LensModel(
    PinholeLens,
    project_pinhole,
    ahead_only=True,
    may_meet=may_meet_planes,
    inside=inside_planes,
    bounds=bounds_pinhole,
)


# Brown-Conrady with OpenCV's names: radial k1, k2, k3, tangential p1, p2. No point farther from the
# axis than `max_square` = a^2 + b^2 is drawn: there the lens would fold back.
@wp.struct
class BrownLens:
    fx: wp.float32
    fy: wp.float32
    cx: wp.float32
    cy: wp.float32
    k1: wp.float32
    k2: wp.float32
    k3: wp.float32
    p1: wp.float32
    p2: wp.float32
    max_square: wp.float32


@wp.func
def tangential(a: wp.float32, b: wp.float32, square: wp.float32, p1: wp.float32, p2: wp.float32):
    """Brown's decentring terms of (a, b)."""
    twice = 2.0 * (a * b)
    return wp.vec2f(
        p1 * twice + p2 * (square + 2.0 * (a * a)), p1 * (square + 2.0 * (b * b)) + p2 * twice
    )


@wp.func
def project_brown(lens: BrownLens, tables: wp.array[wp.float32], p: wp.vec3f):
    """Column and row of a camera-frame point ahead; nowhere beyond the lens's domain."""
    a = -(p[1] / p[0])
    b = -(p[2] / p[0])
    square = a * a + b * b
    radial = 1.0 + square * (lens.k1 + square * (lens.k2 + square * lens.k3))
    shift = tangential(a, b, square, lens.p1, lens.p2)
    return drawn_if(
        square <= lens.max_square,
        lens.cx + lens.fx * (a * radial + shift[0]),
        lens.cy + lens.fy * (b * radial + shift[1]),
    )


BROWN = LensModel(
    BrownLens, project_brown, ahead_only=True, may_meet=may_meet_planes, inside=inside_planes
)


# OpenCV's full model: the radial part divided by 1 + k4 r^2 + k5 r^4 + k6 r^6, thin prism s1 to s4,
# and `tilt`, the homography of a tilted sensor.
@wp.struct
class RationalLens:
    brown: BrownLens
    k4: wp.float32
    k5: wp.float32
    k6: wp.float32
    prism: wp.vec4f
    tilt: wp.mat33f


@wp.func
def project_rational(lens: RationalLens, tables: wp.array[wp.float32], p: wp.vec3f):
    """Column and row of a camera-frame point ahead; nowhere beyond the lens's domain."""
    brown = lens.brown
    a = -(p[1] / p[0])
    b = -(p[2] / p[0])
    square = a * a + b * b
    above = 1.0 + square * (brown.k1 + square * (brown.k2 + square * brown.k3))
    below = 1.0 + square * (lens.k4 + square * (lens.k5 + square * lens.k6))
    radial = above / below
    shift = tangential(a, b, square, brown.p1, brown.p2)
    x = (a * radial + shift[0]) + square * (lens.prism[0] + square * lens.prism[1])
    y = (b * radial + shift[1]) + square * (lens.prism[2] + square * lens.prism[3])
    t = lens.tilt
    scale = (t[2, 0] * x + t[2, 1] * y) + t[2, 2]
    return drawn_if(
        square <= brown.max_square and scale > 0.0,
        brown.cx + brown.fx * (((t[0, 0] * x + t[0, 1] * y) + t[0, 2]) / scale),
        brown.cy + brown.fy * (((t[1, 0] * x + t[1, 1] * y) + t[1, 2]) / scale),
    )


RATIONAL = LensModel(
    RationalLens, project_rational, ahead_only=True, may_meet=may_meet_planes, inside=inside_planes
)


@wp.func
def project_orthographic(lens: PinholeLens, tables: wp.array[wp.float32], p: wp.vec3f):
    """Column and row of a camera-frame point ahead; fx, fy are pixels a metre."""
    return wp.vec3f(lens.cx - lens.fx * p[1], lens.cy - lens.fy * p[2], 1.0)


ORTHOGRAPHIC = LensModel(
    PinholeLens,
    project_orthographic,
    ahead_only=True,
    range_of=range_of_parallel,
    may_meet=may_meet_box,
)
