"""Panoramas: columns are azimuths about the camera's Z axis."""

import warp as wp

from depthwarp_kernels.angles import angle_of
from depthwarp_kernels.cull import may_meet_band
from depthwarp_kernels.lens import LensModel


# fx: pixels a radian of azimuth. fy: pixels a radian of elevation, or a unit of its tangent.
# cx, cy: pixel of azimuth and elevation 0. period: columns of a full turn, 0 for less than that.
# least_v, most_v: a pole, where the image ends in one, belongs to the row at its border.
@wp.struct
class PanoramaLens:
    fx: wp.float32
    fy: wp.float32
    cx: wp.float32
    cy: wp.float32
    period: wp.float32
    least_v: wp.float32
    most_v: wp.float32


@wp.func
def azimuth_column(lens: PanoramaLens, p: wp.vec3f):
    """Column of an azimuth; behind, a full turn goes on at its other end."""
    u = lens.cx - lens.fx * angle_of(p[1], p[0])
    u = wp.where(u < -0.5, u + lens.period, u)
    return wp.where(lens.period > 0.0 and u + 0.5 >= lens.period, u - lens.period, u)


@wp.func
def project_equirectangular(lens: PanoramaLens, tables: wp.array[wp.float32], p: wp.vec3f):
    """Column and row of a camera-frame point: azimuth and elevation."""
    level = wp.sqrt(p[0] * p[0] + p[1] * p[1])
    v = wp.clamp(lens.cy - lens.fy * angle_of(p[2], level), lens.least_v, lens.most_v)
    return wp.vec3f(azimuth_column(lens, p), v, 1.0)


@wp.func
def project_cylindrical(lens: PanoramaLens, tables: wp.array[wp.float32], p: wp.vec3f):
    """Column and row of a camera-frame point: azimuth, and height on a cylinder of radius 1."""
    level = wp.sqrt(p[0] * p[0] + p[1] * p[1])
    return wp.vec3f(azimuth_column(lens, p), lens.cy - lens.fy * (p[2] / level), 1.0)


EQUIRECTANGULAR = LensModel(
    PanoramaLens, project_equirectangular, ahead_only=False, may_meet=may_meet_band
)
CYLINDRICAL = LensModel(PanoramaLens, project_cylindrical, ahead_only=False, may_meet=may_meet_band)
