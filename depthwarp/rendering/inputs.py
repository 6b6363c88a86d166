"""What callers hand to a renderer, checked and brought to a device."""

from __future__ import annotations

from typing import Any

from depthwarp import arrays
from depthwarp.cameras import Camera
from depthwarp.cloud import PointCloud
from depthwarp.devices import check_memory, resolve_device
from depthwarp.errors import InputError
from depthwarp.prepared import PreparedCloud
from depthwarp.range_view import RangeView
from depthwarp.rendering.views import ViewPlan

__all__ = ["device_of", "device_points", "view_plan"]


def device_of(clouds: Any, device: str | None) -> Any:
    """The device of a name; without one that of a prepared cloud, or Warp's default device.

    Raises:
        DeviceError: The device is not on this machine.
    """
    if device is None and isinstance(clouds, PreparedCloud):
        return clouds.device
    return resolve_device(device)


def device_points(cloud: PointCloud | PreparedCloud, device: Any) -> Any:
    """A cloud's points on a device: `wp.array` of `wp.vec3f`, or the prepared cloud itself.

    Raises:
        InputError: Not a point cloud, or one that was prepared on another device.
        CapacityError: The points do not fit the device's memory.
    """
    if isinstance(cloud, PreparedCloud):
        if cloud.device != device:
            raise InputError(
                f"the cloud was prepared on {cloud.device.alias} and cannot be rendered on "
                f"{device.alias}: cloud.prepare(device='{device.alias}')"
            )
        return cloud
    if not isinstance(cloud, PointCloud):
        raise InputError(
            f"cloud must be a PointCloud, got {type(cloud).__name__}: dw.PointCloud(points)"
        )
    if device.is_cuda:
        check_memory(
            f"a cloud of {len(cloud)} points", 12 * len(cloud), device, "render it in parts"
        )
    return arrays.share_points(cloud.points_world, device)


def view_plan(
    camera: Camera | RangeView, cloud: PointCloud | PreparedCloud, device: str | None
) -> ViewPlan:
    """The view of a camera; of a range view, whose depth plane comes from the cloud.

    Raises:
        InputError: Neither a camera nor a range view, or a range view with no point ahead.
    """
    if isinstance(camera, RangeView):
        if isinstance(cloud, PreparedCloud):
            raise InputError(
                "a RangeView takes its depth plane from the cloud itself, not from a prepared one: "
                "pass view.camera(cloud) to render what it sees of the prepared cloud"
            )
        line_count = camera.line_count(cloud, device=device)
        return ViewPlan(camera.camera_of_plane(line_count), line_count, camera.steps)
    if isinstance(camera, Camera):
        return ViewPlan(camera)
    raise InputError(
        f"camera must be a camera, e.g. a PinholeCamera or a RangeView, got {type(camera).__name__}"
    )
