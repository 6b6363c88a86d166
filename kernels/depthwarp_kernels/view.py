"""One view of a cloud: its pose, its size and the geometry of single points.

Frames and equations are those of the paper: camera X forward, Y left, Z up. The order of every
floating-point operation is part of the contract (the NumPy twins repeat it bit for bit).
"""

from typing import Any

import warp as wp

# What culling knows of a lens; the meaning depends on the model, see `cull`.
Limits = wp.types.vector(length=16, dtype=wp.float32)


# position and shift [m] are the two readings of P_C: `position` is subtracted before the rotation
# (world frame), `shift` after it (the paper's own, rotated frame).
# line_count rectangles (8)(9), steps (7) [m]. The lens is apart: its numbers depend on its model.
@wp.struct
class View:
    rotation: wp.mat33f
    position: wp.vec3f
    shift: wp.vec3f
    width: wp.int32
    height: wp.int32
    min_range: wp.float32
    max_range: wp.float32
    line_count: wp.int32
    steps: wp.vec3f
    limits: Limits


@wp.func
def to_camera(point: Any, rotation: Any, position: Any, shift: Any):
    """Rotate a world point into the camera frame, equations (3) to (6)."""
    d = point - position
    x = ((rotation[0, 0] * d[0] + rotation[0, 1] * d[1]) + rotation[0, 2] * d[2]) - shift[0]
    y = ((rotation[1, 0] * d[0] + rotation[1, 1] * d[1]) + rotation[1, 2] * d[2]) - shift[1]
    z = ((rotation[2, 0] * d[0] + rotation[2, 1] * d[1]) + rotation[2, 2] * d[2]) - shift[2]
    return type(point)(x, y, z)


# Not wp.isfinite: a call keeps a CPU from looking at several points at once.
@wp.func
def is_finite(p: Any):
    """Whether all three coordinates are finite: only then does a number less itself give 0."""
    d = p - p
    zero = p.dtype(0.0)
    return d[0] == zero and d[1] == zero and d[2] == zero


# Rectangles grow with n, so only the last one that stands before the point decides (9). The
# division may guess it one off; the comparison is with X_n as the literal union computes it.
@wp.func
def in_range_view(p: Any, steps: Any, line_count: wp.int32):
    """Segmentation (8)(9) in closed form: is a camera-frame point inside the range view?"""
    guess = wp.int32(wp.min(p[0] / steps[0], steps.dtype(line_count)))
    too_far = steps.dtype(guess) * steps[0] >= p[0]
    too_near = guess < line_count and steps.dtype(guess + 1) * steps[0] < p[0]
    m = wp.where(too_far, guess - 1, wp.where(too_near, guess + 1, guess))
    n = steps.dtype(m)
    return m >= 1 and wp.abs(p[1]) < n * steps[1] and wp.abs(p[2]) < n * steps[2]


@wp.func
def pixel_of(seen: wp.vec3f):
    """The pixel that holds (u, v), as floats: floor(u + 0.5), floor(v + 0.5); and the third."""
    return wp.vec3f(wp.floor(seen[0] + 0.5), wp.floor(seen[1] + 0.5), seen[2])


@wp.func
def in_image(view: View, pixel: wp.vec3f):
    """Whether a pixel lies in the image, and the point in the lens's domain; false for NaN."""
    return (
        pixel[0] >= 0.0
        and pixel[1] >= 0.0
        and pixel[0] < wp.float32(view.width)
        and pixel[1] < wp.float32(view.height)
        and pixel[2] > 0.0
    )


@wp.func
def range_depth(p: wp.vec3f):
    """Euclidean range, equation (10) with its squares."""
    return wp.sqrt((p[0] * p[0] + p[1] * p[1]) + p[2] * p[2])


@wp.func
def z_depth(p: wp.vec3f):
    """Depth along the optical axis."""
    return p[0]
