"""Which blocks of points a view cannot see, and which it sees whole, both conservatively.

A block is a sphere, its radius grown by what rounding can move a point. Each kind of limits is a
function (view, center, radius) -> bool, in the camera frame: `may_meet_*` whether the sphere may be
in view, `inside_*` whether all of it is for certain.
"""

import warp as wp

from depthwarp_kernels.view import View


# view.limits from `k` on: four planes through the camera's centre, as (y or z part, x part) of the
# inward normals, length 1: left, right, upper, lower. The first four hold the image, the others
# lie inside it.
@wp.func
def depth_in_planes(view: View, center: wp.vec3f, k: wp.int32):
    """Distance of a point from the nearest of four planes, negative outside."""
    x = center[0]
    left = view.limits[k] * center[1] + view.limits[k + 1] * x
    right = view.limits[k + 2] * center[1] + view.limits[k + 3] * x
    upper = view.limits[k + 4] * center[2] + view.limits[k + 5] * x
    lower = view.limits[k + 6] * center[2] + view.limits[k + 7] * x
    return wp.min(wp.min(left, right), wp.min(upper, lower))


@wp.func
def may_meet_planes(view: View, center: wp.vec3f, radius: wp.float32):
    """Whether a sphere may lie inside the planes round the image's borders."""
    return depth_in_planes(view, center, 0) >= -radius


@wp.func
def inside_planes(view: View, center: wp.vec3f, radius: wp.float32):
    """Whether a sphere lies ahead and inside the planes within the image's borders."""
    return depth_in_planes(view, center, 8) >= radius and center[0] > radius


# view.limits: cosine and sine of the greatest angle from the axis. The sphere is seen under the
# half angle a, sin a = radius / distance; cos(limit + a) decides while limit + a is below pi.
@wp.func
def may_meet_cone(view: View, center: wp.vec3f, radius: wp.float32):
    """Whether a sphere may lie inside a cone about the camera's axis."""
    distance = wp.length(center)
    if distance <= radius:
        return True
    sin_a = radius / distance
    cos_a = wp.sqrt(wp.max(1.0 - sin_a * sin_a, 0.0))
    if view.limits[1] * cos_a + view.limits[0] * sin_a <= 0.0:
        return True
    return center[0] >= distance * (view.limits[0] * cos_a - view.limits[1] * sin_a)


# view.limits: cosine and sine of the lowest and of the highest elevation.
@wp.func
def may_meet_band(view: View, center: wp.vec3f, radius: wp.float32):
    """Whether a sphere may lie between two elevations."""
    distance = wp.length(center)
    if distance <= radius:
        return True
    sin_a = radius / distance
    cos_a = wp.sqrt(wp.max(1.0 - sin_a * sin_a, 0.0))
    height = center[2] / distance
    low_cos = view.limits[0] * cos_a + view.limits[1] * sin_a
    if low_cos > 0.0 and height < view.limits[1] * cos_a - view.limits[0] * sin_a:
        return False
    high_cos = view.limits[2] * cos_a - view.limits[3] * sin_a
    return high_cos <= 0.0 or height <= view.limits[3] * cos_a + view.limits[2] * sin_a


# view.limits: least and greatest y, least and greatest z [m].
@wp.func
def may_meet_box(view: View, center: wp.vec3f, radius: wp.float32):
    """Whether a sphere may lie in the image of parallel rays."""
    return (
        center[1] >= view.limits[0] - radius
        and center[1] <= view.limits[1] + radius
        and center[2] >= view.limits[2] - radius
        and center[2] <= view.limits[3] + radius
    )


@wp.func
def may_meet_all(view: View, center: wp.vec3f, radius: wp.float32):
    """A model without limits sees everything."""
    return True
