"""Lenses that bend wide angles onto a plane: Kannala-Brandt and double sphere."""

import warp as wp

from depthwarp_kernels.angles import angle_of
from depthwarp_kernels.cull import may_meet_cone
from depthwarp_kernels.lens import LensModel, drawn_if


# OpenCV's fisheye: an angle theta from the axis is drawn at the distance theta (1 + k1 theta^2 +
# k2 theta^4 + k3 theta^6 + k4 theta^8) from the principal point, up to `max_angle` [rad].
@wp.struct
class FisheyeLens:
    fx: wp.float32
    fy: wp.float32
    cx: wp.float32
    cy: wp.float32
    k1: wp.float32
    k2: wp.float32
    k3: wp.float32
    k4: wp.float32
    max_angle: wp.float32


@wp.func
def project_fisheye(lens: FisheyeLens, tables: wp.array[wp.float32], p: wp.vec3f):
    """Column and row of a camera-frame point; nowhere beyond the greatest angle."""
    aside = wp.sqrt(p[1] * p[1] + p[2] * p[2])
    theta = angle_of(aside, p[0])
    # Straight behind, at 180 degrees, a ray has no direction in the image.
    inside = theta <= lens.max_angle and (aside > 0.0 or p[0] >= 0.0)
    square = theta * theta
    series = lens.k1 + square * (lens.k2 + square * (lens.k3 + square * lens.k4))
    bent = theta * (1.0 + square * series)
    scale = bent / wp.where(aside > 0.0, aside, 1.0)
    return drawn_if(inside, lens.cx - lens.fx * (p[1] * scale), lens.cy - lens.fy * (p[2] * scale))


FISHEYE = LensModel(FisheyeLens, project_fisheye, ahead_only=False, may_meet=may_meet_cone)


# Double sphere (Usenko, Demmel, Cremers 2018): the unit sphere, a second one displaced by xi, and a
# pinhole displaced by alpha / (1 - alpha). Points with X > -least_cosine * distance are drawn.
@wp.struct
class DoubleSphereLens:
    fx: wp.float32
    fy: wp.float32
    cx: wp.float32
    cy: wp.float32
    xi: wp.float32
    alpha: wp.float32
    least_cosine: wp.float32


@wp.func
def project_double_sphere(lens: DoubleSphereLens, tables: wp.array[wp.float32], p: wp.vec3f):
    """Column and row of a camera-frame point; nowhere beyond the model's domain."""
    aside = p[1] * p[1] + p[2] * p[2]
    distance = wp.sqrt(aside + p[0] * p[0])
    inside = p[0] > lens.least_cosine * distance
    forward = lens.xi * distance + p[0]
    second = wp.sqrt(aside + forward * forward)
    below = lens.alpha * second + (1.0 - lens.alpha) * forward
    return drawn_if(inside, lens.cx - lens.fx * (p[1] / below), lens.cy - lens.fy * (p[2] / below))


DOUBLE_SPHERE = LensModel(
    DoubleSphereLens, project_double_sphere, ahead_only=False, may_meet=may_meet_cone
)
