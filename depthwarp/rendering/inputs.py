"""What callers hand to a renderer, checked and brought to a device."""

from __future__ import annotations

from typing import Any

from depthwarp import arrays
from depthwarp.cameras import Camera
from depthwarp.cloud import PointCloud
from depthwarp.devices import check_memory
from depthwarp.errors import InputError
from depthwarp.range_view import RangeView
from depthwarp.rendering.views import ViewPlan

__all__ = ["device_points", "view_plan"]


def device_points(cloud: PointCloud, device: Any) -> Any:
    """A cloud's points on a device, `wp.array` of `wp.vec3f`.

    Raises:
        InputError: Not a point cloud.
        CapacityError: The points do not fit the device's memory.
    """
    if not isinstance(cloud, PointCloud):
        raise InputError(
            f"cloud must be a PointCloud, got {type(cloud).__name__}: dw.PointCloud(points)"
        )
    if device.is_cuda:
        check_memory(
            f"a cloud of {len(cloud)} points", 12 * len(cloud), device, "render it in parts"
        )
    return arrays.share_points(cloud.points_world, device)


def view_plan(camera: Camera | RangeView, cloud: PointCloud, device: str | None) -> ViewPlan:
    """The view of a camera; of a range view, whose depth plane comes from the cloud.

    Raises:
        InputError: Neither a camera nor a range view, or a range view with no point ahead.
    """
    if isinstance(camera, RangeView):
        line_count = camera.line_count(cloud, device=device)
        return ViewPlan(camera.camera_of_plane(line_count), line_count, camera.steps)
    if isinstance(camera, Camera):
        return ViewPlan(camera)
    raise InputError(
        f"camera must be a camera, e.g. a PinholeCamera or a RangeView, got {type(camera).__name__}"
    )
