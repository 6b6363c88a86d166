"""What the splat has to know of a camera model, all of it at compile time.

A model's kernels are those that it names here; one that no view uses is never compiled.
"""

from dataclasses import dataclass
from typing import Any

import warp as wp

from depthwarp_kernels.cull import may_meet_all
from depthwarp_kernels.view import View, range_depth, to_camera, z_depth


# Where a model draws a point: column, row [px], and 1 inside its domain, 0 outside. There is no
# branch in it, so that a CPU can look at several points at once.
@wp.func
def drawn_if(inside: bool, u: wp.float32, v: wp.float32):
    """Column and row of a point, if it is inside the domain."""
    return wp.vec3f(u, v, wp.where(inside, 1.0, 0.0))


@wp.func
def nowhere():
    """A point outside a model's domain."""
    return wp.vec3f(0.0, 0.0, 0.0)


@wp.func
def place_still(view: View, lens: Any, tables: wp.array[wp.float32], point: wp.vec3f):
    """A world point in the frame of a camera that stands still."""
    return to_camera(point, view.rotation, view.position, view.shift)


@wp.func
def range_from_center(lens: Any, p: wp.vec3f):
    """Euclidean distance from the camera's centre, through which all rays pass."""
    return range_depth(p)


@wp.func
def range_of_parallel(lens: Any, p: wp.vec3f):
    """Distance along rays that are parallel to the axis."""
    return z_depth(p)


@wp.func
def z_of(lens: Any, p: wp.vec3f):
    """Depth along the optical axis."""
    return z_depth(p)


@dataclass(frozen=True)
class LensModel:
    """The device side of a camera model.

    Attributes:
        struct: `wp.struct` of the model's numbers.
        project: `wp.func (lens, tables, p) -> vec3f`: column and row of a point in the camera
            frame [px], pixel centres at whole numbers; 1 inside the model's domain, 0 outside.
        ahead_only: Whether points with X <= 0 are behind the camera. Of other models, z depth ends
            before that: see `splat.LEAST_Z_COSINE`.
        range_of: `wp.func (lens, p) -> float32`: way from where a ray starts to the point [m].
        place: `wp.func (view, lens, tables, point) -> vec3f`: the point in the camera frame.
        may_meet: `wp.func (view, center, radius) -> bool`, one of `cull`: whether a sphere in the
            camera frame may be in view, by `view.limits`.
        inside: The same for a sphere that is in the image, in the model's domain and ahead, all of
            it; None for models that never say so.
        bounds: `wp.func (lens, center, radius) -> vec4f`: least column and row, greatest column and
            row [px] of a sphere that is ahead by 1.5 times its radius or more; None where nobody
            knows.
    """

    struct: Any
    project: Any
    ahead_only: bool
    range_of: Any = range_from_center
    place: Any = place_still
    may_meet: Any = may_meet_all
    inside: Any = None
    bounds: Any = None
