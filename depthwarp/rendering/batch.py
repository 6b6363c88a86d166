"""Many views in one call: views that a plan can share are drawn together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from depthwarp.cameras import Camera, DepthKind
from depthwarp.cloud import PointCloud
from depthwarp.depth_map import DepthMap
from depthwarp.depth_maps import DepthMaps
from depthwarp.errors import InputError
from depthwarp.filters import Filter, check_filters
from depthwarp.prepared import PreparedCloud
from depthwarp.range_view import RangeView
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.inputs import device_of, device_points, view_plan
from depthwarp.rendering.plan import MAP_BYTES, RenderPlan

__all__ = ["render_batch"]

TILE_BYTES = 1 << 28
"""Buffers of the views that are drawn together [bytes]."""


def render_batch(
    clouds: PointCloud | PreparedCloud | Sequence[PointCloud | PreparedCloud],
    cameras: Sequence[Camera | RangeView] | Mapping[str, Camera],
    *,
    depth: DepthKind = "range",
    filters: Sequence[Filter] | None = None,
    min_range: float = 0.0,
    max_range: float = 15.0,
    device: str | None = None,
) -> DepthMaps:
    """Render many views; each map is, bit for bit, what `render` gives for its view alone.

    Args:
        clouds: One cloud, which all cameras see; or one for each camera.
        cameras: Cameras of any models and sizes, each with its own pose and lens; or a rig
            (`dw.cameras.load_rig`), in the order of its names.
        depth: As in `render`.
        filters: As in `render`.
        min_range: As in `render` [m].
        max_range: As in `render` [m].
        device: As in `render`.

    Returns:
        The maps in the order of the cameras; of one size, `depth`, `index` and `state` stack them.
        Those of a rig or a mapping have its names: `maps["left"]`.

    Raises:
        InputError: No camera, another number of clouds than of cameras, or what `render` refuses.
        DeviceError: The device is not on this machine.
        CapacityError: Maps or clouds do not fit the device's memory.

    Example:
        >>> import numpy as np, depthwarp as dw
        >>> cloud = dw.PointCloud(np.array([[2.0, 0.0, 0.0]], np.float32))
        >>> turns = [dw.PinholeCamera.from_fov((60, 45), (4, 3), orientation=(0, 0, yaw))
        ...          for yaw in (0, 90)]
        >>> dw.render_batch(cloud, turns, device="cpu").depth.shape
        (2, 3, 4)
    """
    if isinstance(cameras, Camera | RangeView):
        raise InputError(
            "cameras must be several, in a list or a rig, got one "
            f"{type(cameras).__name__}: [camera], or dw.render(cloud, camera)"
        )
    names = tuple(cameras) if isinstance(cameras, Mapping) else None
    views = list(cameras.values() if isinstance(cameras, Mapping) else cameras)
    if not views:
        raise InputError("cameras must be at least one")
    seen = [clouds] * len(views) if isinstance(clouds, PointCloud | PreparedCloud) else list(clouds)
    if len(seen) != len(views):
        raise InputError(
            f"clouds must be one for all cameras or one for each: got {len(seen)} clouds and "
            f"{len(views)} cameras"
        )
    config = RenderConfig(depth, min_range, max_range, check_filters(filters))
    target = device_of(clouds, device)
    plans = [view_plan(camera, cloud, device) for camera, cloud in zip(views, seen, strict=True)]
    groups: dict[Any, list[int]] = {}
    for number, (plan, cloud) in enumerate(zip(plans, seen, strict=True)):
        camera = plan.camera
        key = id(cloud), camera.device_lens().model, camera.size, plan.line_count > 0
        groups.setdefault(key, []).append(number)
    maps: dict[int, DepthMap] = {}
    for numbers in groups.values():
        points = device_points(seen[numbers[0]], target)
        for tile in _tiles(numbers, plans[numbers[0]].camera.size):
            together = RenderPlan([plans[number] for number in tile], config, target)
            together.render(points)
            maps.update(zip(tile, together.depth_maps(), strict=True))
    return DepthMaps([maps[number] for number in range(len(views))], names)


def _tiles(numbers: Sequence[int], size: tuple[int, int]) -> Iterator[Sequence[int]]:
    """Views in groups whose buffers stay small beside their results."""
    most = max(1, TILE_BYTES // (MAP_BYTES * size[0] * size[1]))
    for first in range(0, len(numbers), most):
        yield numbers[first : first + most]
