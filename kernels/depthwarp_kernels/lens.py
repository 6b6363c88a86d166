"""What the splat has to know of a camera model, all of it at compile time.

A model's kernels are those that it names here; one that no view uses is never compiled.
"""

from dataclasses import dataclass
from typing import Any

import warp as wp

from depthwarp_kernels.view import View, range_depth, to_camera, z_depth

# The pixel of a point outside a model's domain: in no image.
NO_PIXEL = wp.constant(wp.vec2f(-1.0e9, -1.0e9))


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
        project: `wp.func (lens, tables, p) -> vec2f`: column and row of a point in the camera
            frame [px], pixel centres at whole numbers; NO_PIXEL outside the model's domain.
        ahead_only: Whether points with X <= 0 are behind the camera.
        range_of: `wp.func (lens, p) -> float32`: way from where a ray starts to the point [m].
        place: `wp.func (view, lens, tables, point) -> vec3f`: the point in the camera frame.
    """

    struct: Any
    project: Any
    ahead_only: bool
    range_of: Any = range_from_center
    place: Any = place_still
