"""The columns and rows that a model's kernel computes, before they are rounded to pixels."""

from functools import cache

import numpy as np
import warp as wp

from depthwarp.rendering import RenderConfig, ViewPlan
from depthwarp.rendering.views import DeviceViews
from depthwarp_kernels import lens_fisheye, lens_panorama, lens_pinhole, lens_spinning
from depthwarp_kernels.angles import angle_of
from depthwarp_kernels.lens import LensModel
from depthwarp_kernels.options import EXACT
from depthwarp_kernels.view import View

wp.set_module_options(EXACT)


@wp.kernel
def angles_of(
    # In:
    y: wp.array[wp.float32],
    x: wp.array[wp.float32],
    # Out:
    angle_out: wp.array[wp.float32],
):
    """One angle a thread."""
    i = wp.tid()
    angle_out[i] = angle_of(y[i], x[i])


@cache
def image_kernel(model: LensModel):
    """Kernel that computes u and v of world points, -1e9 outside the domain."""
    Lens = model.struct
    place = model.place
    project = model.project

    @wp.kernel
    def image(
        # In:
        views: wp.array[View],
        lenses: wp.array[Lens],
        tables: wp.array[wp.float32],
        points_world: wp.array[wp.vec3f],
        # Out:
        uv_out: wp.array[wp.vec2f],
    ):
        i = wp.tid()
        lens = lenses[0]
        p = place(views[0], lens, tables, points_world[i])
        seen = project(lens, tables, p)
        nowhere = wp.vec2f(-1.0e9, -1.0e9)
        uv_out[i] = wp.where(seen[2] > 0.0, wp.vec2f(seen[0], seen[1]), nowhere)

    return image


# All of them before the first is launched: then they are one compilation.
for known in (
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
    image_kernel(known)


def device_image(camera, points_world, device):
    """u and v, float32, of world points (N, 3) float32."""
    views = DeviceViews([ViewPlan(camera)], RenderConfig(), wp.get_device(device))
    points = wp.array(np.ascontiguousarray(points_world, np.float32), dtype=wp.vec3f, device=device)
    uv = wp.empty(len(points_world), dtype=wp.vec2f, device=device)
    wp.launch(
        image_kernel(views.model),
        dim=len(points_world),
        inputs=[*views.arrays, points],
        outputs=[uv],
        device=device,
    )
    return uv.numpy().T


def device_angles(y, x, device):
    """The angles of (x, y) in float32, computed on a device."""
    y, x = (wp.array(np.asarray(values, np.float32), device=device) for values in (y, x))
    angles = wp.empty(len(x), dtype=wp.float32, device=device)
    wp.launch(angles_of, dim=len(x), inputs=[y, x], outputs=[angles], device=device)
    return angles.numpy()
