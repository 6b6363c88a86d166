"""Where the winning points of depth maps stand: smooth functions of points, poses and lens.

Which point wins a pixel has no derivative. The depth and the image position of a given winner have
one, and the adjoint of the one kernel here sums it up.
"""

from typing import Any

import warp as wp

from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT | {"enable_backward": True})


@wp.func
def to_optical(point: Any, pose: Any):
    """A world point in OpenCV's optical axes: X right, Y down, Z forward."""
    return type(point)(
        ((pose[0, 0] * point[0] + pose[0, 1] * point[1]) + pose[0, 2] * point[2]) + pose[0, 3],
        ((pose[1, 0] * point[0] + pose[1, 1] * point[1]) + pose[1, 2] * point[2]) + pose[1, 3],
        ((pose[2, 0] * point[0] + pose[2, 1] * point[1]) + pose[2, 2] * point[2]) + pose[2, 3],
    )


# Launch over (worlds, cameras, lanes). A lane takes every lanes-th pixel of its image: side by side
# with its neighbours, and with one atomic sum into the pose's adjoint for all of its pixels.
# Row s of `static_points` serves worlds / rows worlds one after the other; indices below the length
# of a row are of that row, those from there on of the world's own points. `intrinsics` holds (fx,
# fy, cx, cy) [px]; it and `uv_out` may both be null: then there are no positions. A pixel without a
# winner gets 0, and so does the position of a winner that is not ahead.
@wp.kernel
def winner_depth(
    # In:
    points_world: wp.array2d[Any],
    static_points: wp.array2d[Any],
    poses: wp.array2d[Any],
    intrinsics: wp.array2d[Any],
    index: wp.array4d[wp.int32],
    is_z: wp.bool,
    lanes: wp.int32,
    # Out:
    depth_out: wp.array4d[Any],
    uv_out: wp.array4d[Any],
):
    world, camera, lane = wp.tid()
    columns = index.shape[3]
    pixels = index.shape[2] * columns
    static_count = static_points.shape[1]
    pose = poses[world, camera]
    for pixel in range(lane, pixels, lanes):
        row = pixel / columns
        column = pixel - row * columns
        depth = depth_out.dtype(0.0)
        uv = uv_out.dtype()
        i = index[world, camera, row, column]
        if i >= 0 and i < static_count + points_world.shape[1]:
            if i < static_count:
                worlds_a_row = index.shape[0] / static_points.shape[0]
                p = to_optical(static_points[world / worlds_a_row, i], pose)
            else:
                p = to_optical(points_world[world, i - static_count], pose)
            if is_z:
                depth = p[2]
            else:
                depth = wp.length(p)
            if uv_out.shape[0] > 0 and p[2] > p.dtype(0.0):
                lens = intrinsics[world, camera]
                uv = uv_out.dtype(
                    lens[2] + lens[0] * (p[0] / p[2]), lens[3] + lens[1] * (p[1] / p[2])
                )
        depth_out[world, camera, row, column] = depth
        if uv_out.shape[0] > 0:
            uv_out[world, camera, row, column] = uv


# By the type of the numbers: a null array names no type, so the kernels are chosen by hand.
WINNER_DEPTH = {
    scalar: wp.overload(
        winner_depth,
        {
            "points_world": wp.array2d[vec3],
            "static_points": wp.array2d[vec3],
            "poses": wp.array2d[mat44],
            "intrinsics": wp.array2d[vec4],
            "depth_out": wp.array4d[scalar],
            "uv_out": wp.array4d[vec2],
        },
    )
    for scalar, vec2, vec3, vec4, mat44 in (
        (wp.float32, wp.vec2f, wp.vec3f, wp.vec4f, wp.mat44f),
        (wp.float64, wp.vec2d, wp.vec3d, wp.vec4d, wp.mat44d),
    )
}
