"""Where the splat takes its points from: a plain array, or a prepared cloud in blocks."""

from dataclasses import dataclass
from typing import Any

import warp as wp

from depthwarp_kernels.view import View, to_camera

BLOCK = 512
"""Points of a block: their pixels and depths stay in a processor's nearest cache."""

GROUP = 32
"""Blocks of a group, over which one verdict may hold."""

# Verdicts over a block.
SEEN = wp.constant(0)
ALL_BEHIND = wp.constant(1)
ALL_OUTSIDE = wp.constant(2)
NONE_IN_VIEW = wp.constant(3)  # some of it behind, the rest outside
ALL_DRAWN = wp.constant(4)

# What rounding can move a point by in the camera frame, in parts of the numbers that go in.
ROUNDING = wp.constant(wp.float32(4.0e-6))

# Sizes [m] whose squares float32 cannot hold: lenses draw such points anywhere, so a block below
# the one is never smaller, and a block beyond the other has no end.
SMALLEST = wp.constant(wp.float32(1.0e-15))
LARGEST = wp.constant(wp.float32(1.0e18))


@dataclass(frozen=True)
class PointSource:
    """The device side of a kind of cloud.

    Attributes:
        struct: `wp.struct` of its arrays.
        point_at: `wp.func (source, i) -> vec3f`: a point in the world frame [m].
        index_at: `wp.func (source, i) -> int32`: its row in the caller's cloud.
        sphere_of: `wp.func (source, block) -> vec4f`: centre in the world frame and radius [m] of
            a block's points; None where points come in no order.
        group_of: The same of a group of `GROUP` blocks.
    """

    struct: Any
    point_at: Any
    index_at: Any
    sphere_of: Any = None
    group_of: Any = None


@wp.struct
class PlainPoints:
    points_world: wp.array[wp.vec3f]


@wp.func
def plain_point(source: PlainPoints, i: wp.int32):
    """A point of a plain array."""
    return source.points_world[i]


@wp.func
def plain_index(source: PlainPoints, i: wp.int32):
    """Its own place."""
    return i


PLAIN = PointSource(PlainPoints, plain_point, plain_index)


# Coordinates apart, in spatial order; `original` is a point's row in the caller's cloud.
@wp.struct
class PreparedPoints:
    x: wp.array[wp.float32]
    y: wp.array[wp.float32]
    z: wp.array[wp.float32]
    original: wp.array[wp.int32]
    spheres: wp.array[wp.vec4f]
    groups: wp.array[wp.vec4f]


@wp.func
def prepared_point(source: PreparedPoints, i: wp.int32):
    """A point of a prepared cloud."""
    return wp.vec3f(source.x[i], source.y[i], source.z[i])


@wp.func
def prepared_index(source: PreparedPoints, i: wp.int32):
    """Its row in the caller's cloud."""
    return source.original[i]


@wp.func
def prepared_sphere(source: PreparedPoints, block: wp.int32):
    """The sphere round a block."""
    return source.spheres[block]


@wp.func
def prepared_group(source: PreparedPoints, group: wp.int32):
    """The sphere round a group of blocks."""
    return source.groups[group]


PREPARED = PointSource(
    PreparedPoints, prepared_point, prepared_index, prepared_sphere, prepared_group
)


@wp.func
def largest(v: wp.vec3f):
    """Largest absolute coordinate."""
    return wp.max(wp.max(wp.abs(v[0]), wp.abs(v[1])), wp.abs(v[2]))


@wp.func
def camera_sphere(view: View, sphere: wp.vec4f):
    """A sphere of the world frame in the camera frame, its radius grown by rounding."""
    center_world = wp.vec3f(sphere[0], sphere[1], sphere[2])
    center = to_camera(center_world, view.rotation, view.position, view.shift)
    size = largest(center_world) + largest(view.position) + largest(view.shift) + sphere[3]
    radius = wp.where(size < LARGEST, sphere[3] + (ROUNDING * size + SMALLEST), wp.inf)
    return wp.vec4f(center[0], center[1], center[2], radius)
