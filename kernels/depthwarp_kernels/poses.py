"""Poses that are on the device already: written into the views without the host."""

import warp as wp

from depthwarp_kernels.options import EXACT
from depthwarp_kernels.view import View

wp.set_module_options(EXACT)


# Launch over views. A pose takes world points to OpenCV's optical axes (X right, Y down, Z
# forward): the camera's X, Y and Z are its third row, and its first and second turned round. The
# position is -R^T t.
@wp.kernel
def look_from(
    # In:
    optical_from_world: wp.array[wp.mat44f],
    # Out:
    views_out: wp.array[View],
):
    v = wp.tid()
    t = optical_from_world[v]
    rotation = wp.mat33f(
        t[2, 0], t[2, 1], t[2, 2],
        -t[0, 0], -t[0, 1], -t[0, 2],
        -t[1, 0], -t[1, 1], -t[1, 2],
    )  # fmt: skip
    x = (t[0, 0] * t[0, 3] + t[1, 0] * t[1, 3]) + t[2, 0] * t[2, 3]
    y = (t[0, 1] * t[0, 3] + t[1, 1] * t[1, 3]) + t[2, 1] * t[2, 3]
    z = (t[0, 2] * t[0, 3] + t[1, 2] * t[1, 3]) + t[2, 2] * t[2, 3]
    views_out[v].rotation = rotation
    views_out[v].position = wp.vec3f(-x, -y, -z)
    views_out[v].shift = wp.vec3f(0.0, 0.0, 0.0)
