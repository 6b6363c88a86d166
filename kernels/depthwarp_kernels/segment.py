"""Range view segmentation, equations (8) and (9), as a mask, and the depth plane's distance."""

from functools import cache

import warp as wp

from depthwarp_kernels.options import EXACT
from depthwarp_kernels.view import in_range_view, is_finite, to_camera

wp.set_module_options(EXACT)


@cache
def segment_kernel(dtype: type):
    """Kernel that marks the points inside a range view, computed in float32 or float64."""
    vec3 = wp.types.vector(length=3, dtype=dtype)
    mat33 = wp.types.matrix(shape=(3, 3), dtype=dtype)

    @wp.kernel(module="unique", module_options=EXACT, enable_backward=False)
    def segment(
        # In:
        points_world: wp.array[wp.vec3f],
        rotation: mat33,
        position: vec3,
        shift: vec3,
        steps: vec3,
        line_count: wp.int32,
        # Out:
        selected_out: wp.array[wp.uint8],
    ):
        i = wp.tid()
        p = to_camera(vec3(points_world[i]), rotation, position, shift)
        selected = is_finite(p) and p[0] > dtype(0.0) and in_range_view(p, steps, line_count)
        selected_out[i] = wp.where(selected, wp.uint8(1), wp.uint8(0))

    return segment


# The bits of a positive float order like its value: the maximum is an integer one.
@wp.kernel
def farthest_ahead(
    # In:
    points_world: wp.array[wp.vec3f],
    rotation: wp.mat33f,
    position: wp.vec3f,
    shift: wp.vec3f,
    # Out:
    farthest_bits_out: wp.array[wp.uint32],
):
    p = to_camera(points_world[wp.tid()], rotation, position, shift)
    if is_finite(p) and p[0] > 0.0:
        bits = wp.cast(p[0], wp.uint32)
        if bits > farthest_bits_out[0]:
            wp.atomic_max(farthest_bits_out, 0, bits)
