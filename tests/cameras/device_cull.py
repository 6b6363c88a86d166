"""What a model's kernels say of points and of spheres that hold them."""

from functools import cache

import numpy as np
import warp as wp

import depthwarp as dw
from depthwarp.rendering import RenderConfig, ViewPlan
from depthwarp.rendering.views import DeviceViews
from depthwarp_kernels import lens_fisheye, lens_panorama, lens_pinhole, lens_spinning
from depthwarp_kernels.lens import LensModel
from depthwarp_kernels.options import EXACT
from depthwarp_kernels.view import View, in_image, pixel_of

wp.set_module_options(EXACT)


@cache
def meeting_kernel(model: LensModel):
    """Kernel: of points whether the image shows them, of spheres whether it may and must."""
    Lens = model.struct
    project = model.project
    may_meet, inside = model.may_meet, model.inside
    ahead_only = model.ahead_only

    @wp.kernel
    def meeting(
        # In:
        views: wp.array[View],
        lenses: wp.array[Lens],
        tables: wp.array[wp.float32],
        points_camera: wp.array[wp.vec3f],
        spheres: wp.array[wp.vec4f],
        # Out:
        shown_out: wp.array[wp.bool],
        may_out: wp.array[wp.bool],
        inside_out: wp.array[wp.bool],
    ):
        i = wp.tid()
        view = views[0]
        p = points_camera[i]
        shown = in_image(view, pixel_of(project(lenses[0], tables, p)))
        if wp.static(ahead_only):
            shown = shown and p[0] > 0.0
        shown_out[i] = shown
        sphere = spheres[i]
        center = wp.vec3f(sphere[0], sphere[1], sphere[2])
        may_out[i] = may_meet(view, center, sphere[3])
        if wp.static(inside is not None):
            inside_out[i] = inside(view, center, sphere[3])

    return meeting


# All of them before the first is launched: then they are one compilation.
for known in (
    lens_pinhole.PINHOLE,
    lens_pinhole.BROWN,
    lens_pinhole.RATIONAL,
    lens_pinhole.ORTHOGRAPHIC,
    lens_fisheye.FISHEYE,
    lens_fisheye.DOUBLE_SPHERE,
    lens_panorama.EQUIRECTANGULAR,
    lens_panorama.CYLINDRICAL,
    lens_spinning.SPINNING,
    lens_spinning.MOVING,
):
    meeting_kernel(known)


def device_meeting(
    camera: dw.Camera, points_camera: np.ndarray, spheres: np.ndarray, device: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of points (N, 3) whether the image shows them; of spheres (N, 4) whether it may or must."""
    views = DeviceViews([ViewPlan(camera)], RenderConfig(), wp.get_device(device))
    count = len(points_camera)
    given = [
        wp.array(np.ascontiguousarray(values, np.float32), dtype=dtype, device=device)
        for values, dtype in ((points_camera, wp.vec3f), (spheres, wp.vec4f))
    ]
    results = [wp.zeros(count, dtype=wp.bool, device=device) for _ in range(3)]
    wp.launch(
        meeting_kernel(views.model),
        dim=count,
        inputs=[*views.arrays, *given],
        outputs=results,
        device=device,
    )
    shown, may, inside = (array.numpy() for array in results)
    return shown, may, inside
