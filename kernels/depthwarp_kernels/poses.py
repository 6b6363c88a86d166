"""Poses that are on the device already: written into the views without the host."""

import warp as wp

from depthwarp_kernels.options import EXACT
from depthwarp_kernels.view import View

wp.set_module_options(EXACT)


BAD_POSE = wp.constant(4)
"""Flag of a world: a pose is no rotation and position, or not finite; its image is empty."""

ROTATION_TOLERANCE = wp.constant(wp.float32(1.0e-3))
"""How far the rows of a rotation may be from unit length and right angles."""

NOWHERE = wp.constant(wp.float32(1.0e30))
"""Where a camera without a pose stands: it sees nothing, and no check has to know of it."""


# A pose takes world points to OpenCV's optical axes (X right, Y down, Z forward): the camera's X, Y
# and Z are its third row, and its first and second turned round. The position is -R^T t.
@wp.func
def write_pose(views: wp.array[View], v: wp.int32, t: wp.mat44f):
    """Let a view look from a pose."""
    rotation = wp.mat33f(
        t[2, 0], t[2, 1], t[2, 2],
        -t[0, 0], -t[0, 1], -t[0, 2],
        -t[1, 0], -t[1, 1], -t[1, 2],
    )  # fmt: skip
    x = (t[0, 0] * t[0, 3] + t[1, 0] * t[1, 3]) + t[2, 0] * t[2, 3]
    y = (t[0, 1] * t[0, 3] + t[1, 1] * t[1, 3]) + t[2, 1] * t[2, 3]
    z = (t[0, 2] * t[0, 3] + t[1, 2] * t[1, 3]) + t[2, 2] * t[2, 3]
    views[v].rotation = rotation
    views[v].position = wp.vec3f(-x, -y, -z)
    views[v].shift = wp.vec3f(0.0, 0.0, 0.0)


# Launch over views.
@wp.kernel
def look_from(
    # In:
    optical_from_world: wp.array[wp.mat44f],
    # Out:
    views_out: wp.array[View],
):
    v = wp.tid()
    write_pose(views_out, v, optical_from_world[v])


# Of a number that is not finite no comparison holds, so such a pose is none either.
@wp.func
def is_pose(t: wp.mat44f):
    """Whether a matrix is a rotation, within the tolerance, and a finite position."""
    a = wp.vec3f(t[0, 0], t[0, 1], t[0, 2])
    b = wp.vec3f(t[1, 0], t[1, 1], t[1, 2])
    c = wp.vec3f(t[2, 0], t[2, 1], t[2, 2])
    fits = wp.abs(wp.dot(a, a) - 1.0) <= ROTATION_TOLERANCE
    fits = fits and wp.abs(wp.dot(b, b) - 1.0) <= ROTATION_TOLERANCE
    fits = fits and wp.length(wp.cross(a, b) - c) <= ROTATION_TOLERANCE
    fits = fits and wp.abs(wp.dot(a, b)) <= ROTATION_TOLERANCE
    way = wp.abs(t[0, 3]) + wp.abs(t[1, 3]) + wp.abs(t[2, 3])
    last = t[3, 0] == 0.0 and t[3, 1] == 0.0 and t[3, 2] == 0.0 and t[3, 3] == 1.0
    return fits and last and way < NOWHERE


# Cameras of one world follow one another. Launch over views.
@wp.kernel
def look_from_worlds(
    # In:
    optical_from_world: wp.array[wp.mat44f],
    cameras: wp.int32,
    # Out:
    views_out: wp.array[View],
    flags_out: wp.array[wp.int32],
):
    v = wp.tid()
    pose = optical_from_world[v]
    if is_pose(pose):
        write_pose(views_out, v, pose)
    else:
        write_pose(views_out, v, wp.identity(4, dtype=wp.float32))
        views_out[v].position = wp.vec3f(NOWHERE, NOWHERE, NOWHERE)
        world = v / cameras
        # Whoever else writes it now, writes the same: another camera of this world.
        flags_out[world] = flags_out[world] | BAD_POSE
