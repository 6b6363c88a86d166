"""The one-call rendering of a cloud: build a plan, use it once."""

from __future__ import annotations

from collections.abc import Sequence

from depthwarp.cameras import Camera, DepthKind
from depthwarp.cloud import PointCloud
from depthwarp.depth_map import DepthMap
from depthwarp.filters import Filter, check_filters
from depthwarp.prepared import PreparedCloud
from depthwarp.range_view import RangeView
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.inputs import device_of, device_points, view_plan
from depthwarp.rendering.plan import RenderPlan

__all__ = ["render"]


def render(
    cloud: PointCloud | PreparedCloud,
    camera: Camera | RangeView,
    *,
    depth: DepthKind = "range",
    filters: Sequence[Filter] | None = None,
    min_range: float = 0.0,
    max_range: float = 15.0,
    device: str | None = None,
) -> DepthMap:
    """Render a point cloud into a depth map, section 3 of the paper.

    The nearest point of a pixel wins, on equal depth the one with the lowest index; the result is
    the same, bit for bit, on every device.

    Args:
        cloud: Points in the world frame; or a prepared cloud, `cloud.prepare()`.
        camera: A camera of any model; or a `RangeView`, which selects the points by (8)(9) first
            and projects them onto its depth plane: the paper's own process.
        depth: `"range"`: Euclidean distance, the paper's (10). `"z"`: along the optical axis, for
            models that have one.
        filters: Applied in order after the splat, e.g. `dw.filters.paper()`; None for none.
        min_range: Nearer points are not drawn [m].
        max_range: Farther points are not drawn [m]; `math.inf` for no bound.
        device: Where to compute, e.g. `"cpu"`, `"cuda:0"`; None is Warp's default device.

    Returns:
        The depth map; `DepthMap.stats` says what became of every point.

    Raises:
        InputError: An argument out of its range, or a `RangeView` with no point ahead.
        DeviceError: The device is not on this machine.
        CapacityError: The map or the cloud does not fit the device's memory.

    Example:
        >>> import numpy as np, depthwarp as dw
        >>> cloud = dw.PointCloud(np.array([[2.0, 0.0, 0.0]], np.float32))
        >>> camera = dw.PinholeCamera.from_fov(fov=(60, 45), size=(3, 3))
        >>> float(dw.render(cloud, camera, device="cpu").depth[1, 1])
        2.0
    """
    config = RenderConfig(depth, min_range, max_range, check_filters(filters))
    target = device_of(cloud, device)
    points = device_points(cloud, target)
    plan = RenderPlan([view_plan(camera, cloud, device)], config, target)
    plan.render(points)
    return plan.depth_maps()[0]
