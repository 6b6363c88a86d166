"""Many views in one call: views that a plan can share are drawn together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Sized
from typing import Any

from depthwarp.cameras import Camera, DepthKind
from depthwarp.cloud import PointCloud
from depthwarp.depth_maps import DepthMaps
from depthwarp.devices import check_memory, resolve_device
from depthwarp.errors import InputError
from depthwarp.filters import Filter, check_filters
from depthwarp.prepared import PreparedCloud
from depthwarp.range_view import RangeView
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.inputs import device_of
from depthwarp.rendering.stream import looks_of
from depthwarp.rendering.tiles import Look, draw_looks

__all__ = ["render_batch"]

HOST_BYTES = 4 + 4 + 1
"""A pixel of the maps that are returned: depth, index, state [bytes]."""


def render_batch(
    clouds: PointCloud | PreparedCloud | Iterable[PointCloud | PreparedCloud],
    cameras: Iterable[Camera | RangeView] | Mapping[str, Camera],
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
        CapacityError: A view or a cloud does not fit the device's memory, or all maps together do
            not fit the host's: `render_stream` gives them one by one. Nothing is drawn then.

    Example:
        >>> import numpy as np, depthwarp as dw
        >>> cloud = dw.PointCloud(np.array([[2.0, 0.0, 0.0]], np.float32))
        >>> turns = [dw.PinholeCamera.from_fov((60, 45), (4, 3), orientation=(0, 0, yaw))
        ...          for yaw in (0, 90)]
        >>> dw.render_batch(cloud, turns, device="cpu").depth.shape
        (2, 3, 4)
    """
    names = tuple(map(str, cameras)) if isinstance(cameras, Mapping) else None
    looks = looks_of(clouds, cameras, device)
    if not isinstance(clouds, PointCloud | PreparedCloud):
        _check_counts(clouds, cameras)
    config = RenderConfig(depth, min_range, max_range, check_filters(filters))
    target = device_of(clouds, device)
    # Those that can be drawn together come together, whatever the order of the cameras.
    groups: dict[Any, list[tuple[int, Look]]] = {}
    for number, look in enumerate(looks):
        groups.setdefault(look.group, []).append((number, look))
    together = [pair for group in groups.values() for pair in group]
    if not together:
        raise InputError("cameras must be at least one")
    _check_maps([look for _, look in together])
    drawn = draw_looks((look for _, look in together), config, target)
    maps = {number: depth_map for (number, _), depth_map in zip(together, drawn, strict=True)}
    return DepthMaps([maps[number] for number in range(len(maps))], names)


def _check_counts(clouds: Iterable[Any], cameras: Iterable[Any]) -> None:
    """Refuse lists of different lengths; of generators it is seen when one of them ends."""
    if isinstance(clouds, Sized) and isinstance(cameras, Sized) and len(clouds) != len(cameras):
        raise InputError(
            f"clouds must be one for all cameras or one for each: got {len(clouds)} clouds and "
            f"{len(cameras)} cameras"
        )


def _check_maps(looks: Sequence[Look]) -> None:
    """Refuse views whose maps would not fit the host's memory together."""
    sizes = [look.view.camera.size for look in looks]
    check_memory(
        f"a batch of {len(looks)} views",
        HOST_BYTES * sum(width * height for width, height in sizes),
        resolve_device("cpu"),
        "use dw.render_stream, which gives the maps one by one",
    )
