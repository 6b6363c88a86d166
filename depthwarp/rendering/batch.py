"""Many views in one call: views that a plan can share are drawn together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from depthwarp.cameras import Camera, DepthKind
from depthwarp.cloud import PointCloud
from depthwarp.depth_maps import DepthMaps
from depthwarp.errors import InputError
from depthwarp.filters import Filter, check_filters
from depthwarp.prepared import PreparedCloud
from depthwarp.range_view import RangeView
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.inputs import device_of
from depthwarp.rendering.stream import looks_of
from depthwarp.rendering.tiles import Look, draw_looks

__all__ = ["render_batch"]


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
    names = tuple(cameras) if isinstance(cameras, Mapping) else None
    looks = looks_of(clouds, cameras, device)
    one = isinstance(clouds, PointCloud | PreparedCloud)
    if not one and len(clouds) != len(cameras):
        raise InputError(
            f"clouds must be one for all cameras or one for each: got {len(clouds)} clouds and "
            f"{len(cameras)} cameras"
        )
    config = RenderConfig(depth, min_range, max_range, check_filters(filters))
    target = device_of(clouds, device)
    # Those that can be drawn together come together, whatever the order of the cameras.
    groups: dict[Any, list[tuple[int, Look]]] = {}
    for number, look in enumerate(looks):
        groups.setdefault(look.group, []).append((number, look))
    together = [pair for group in groups.values() for pair in group]
    if not together:
        raise InputError("cameras must be at least one")
    drawn = draw_looks((look for _, look in together), config, target)
    maps = {number: depth_map for (number, _), depth_map in zip(together, drawn, strict=True)}
    return DepthMaps([maps[number] for number in range(len(maps))], names)
