"""Many views, one after the other: as many as there are, in the memory of a tile."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np
import warp as wp

from depthwarp.cameras import Camera, DepthKind
from depthwarp.cloud import PointCloud
from depthwarp.depth_map import DepthMap
from depthwarp.errors import InputError
from depthwarp.filters import Filter, check_filters
from depthwarp.prepared import PreparedCloud
from depthwarp.range_view import RangeView
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.inputs import device_of, view_plan
from depthwarp.rendering.tiles import Look, draw_looks

__all__ = ["looks_of", "render_stream"]

AnyCloud = PointCloud | PreparedCloud


def render_stream(
    clouds: AnyCloud | Iterable[AnyCloud],
    cameras: Iterable[Camera | RangeView] | Mapping[str, Camera],
    *,
    depth: DepthKind = "range",
    filters: Sequence[Filter] | None = None,
    min_range: float = 0.0,
    max_range: float = 15.0,
    device: str | None = None,
) -> Iterator[DepthMap]:
    """Render any number of views in turn; each map is, bit for bit, what `render` gives alone.

    Views are taken and drawn a tile at a time: some hundreds of small images, some few large ones.
    Memory is that of one tile (about 100 MB) and of the maps that the caller keeps, for any number
    of views; the buffers are used again while models and sizes stay the same. A cloud that all
    cameras see should be prepared, `cloud.prepare()`, unless it is small.

    Args:
        clouds: One cloud, which all cameras see; or one for each camera, also from a generator.
        cameras: Cameras of any models and sizes, also from a generator; or a rig.
        depth: As in `render`.
        filters: As in `render`.
        min_range: As in `render` [m].
        max_range: As in `render` [m].
        device: As in `render`.

    Returns:
        The maps in the order of the cameras. Nothing is drawn before the first is asked for. The
        arrays of a map are the caller's: later views do not change them.

    Raises:
        InputError: At once, what `render` refuses of the settings. In turn, a camera or a cloud
            that `render` refuses, with its number, or another number of clouds than of cameras; the
            maps before it that were not yet drawn are lost.
        DeviceError: The device is not on this machine.
        CapacityError: A view or a cloud does not fit the device's memory.

    Example:
        >>> import numpy as np, depthwarp as dw
        >>> cloud = dw.PointCloud(np.array([[2.0, 0.0, 0.0]], np.float32))
        >>> ahead = dw.PinholeCamera.from_fov((70, 45), (4, 3))
        >>> turns = (ahead.with_pose(dw.Pose.from_orientation((0, 0, 0), (0, 0, yaw)))
        ...          for yaw in range(0, 360, 10))
        >>> sum(depth_map.stats.drawn for depth_map in dw.render_stream(cloud, turns, device="cpu"))
        7
    """
    config = RenderConfig(depth, min_range, max_range, check_filters(filters))
    target = device_of(clouds, device)
    return draw_looks(looks_of(clouds, cameras, device), config, target)


def looks_of(
    clouds: AnyCloud | Iterable[AnyCloud],
    cameras: Iterable[Camera | RangeView] | Mapping[str, Camera],
    device: str | None,
) -> Iterator[Look]:
    """Pairs of a cloud and a view of it, made as they are taken.

    Raises:
        InputError: One camera instead of several, or points that are no cloud; and later, with its
            number, a camera that cannot be used, or another number of clouds than of cameras.
    """
    if isinstance(cameras, Camera | RangeView):
        raise InputError(
            "cameras must be several, in a list or a rig, got one "
            f"{type(cameras).__name__}: [camera], or dw.render(cloud, camera)"
        )
    if not isinstance(cameras, Iterable):
        raise InputError(
            f"cameras must be several, in a list or a rig, got {type(cameras).__name__}"
        )
    each = cameras.values() if isinstance(cameras, Mapping) else cameras
    if isinstance(clouds, PointCloud | PreparedCloud):
        return (_look(clouds, camera, n, device) for n, camera in enumerate(each))
    # Arrays of points are iterable too, row by row.
    is_points = isinstance(clouds, wp.array | np.ndarray) and clouds.dtype != object
    if is_points or not isinstance(clouds, Iterable):
        raise InputError(
            f"clouds must be a PointCloud or several, got {type(clouds).__name__}: "
            "dw.PointCloud(points)"
        )
    return _pairs(clouds, each, device)


def _pairs(
    clouds: Iterable[AnyCloud], cameras: Iterable[Camera | RangeView], device: str | None
) -> Iterator[Look]:
    rest = iter(clouds)
    number = -1
    for number, camera in enumerate(cameras):
        try:
            cloud = next(rest)
        except StopIteration:
            raise InputError(
                f"clouds must be one for all cameras or one for each: there are {number} clouds "
                "and more cameras"
            ) from None
        yield _look(cloud, camera, number, device)
    for _ in rest:
        raise InputError(
            "clouds must be one for all cameras or one for each: there are more clouds than the "
            f"{number + 1} cameras"
        )


def _look(cloud: AnyCloud, camera: Camera | RangeView, number: int, device: str | None) -> Look:
    if not isinstance(cloud, PointCloud | PreparedCloud):
        raise InputError(
            f"clouds[{number}] must be a PointCloud, got {type(cloud).__name__}: "
            "dw.PointCloud(points)"
        )
    try:
        return Look(cloud, view_plan(camera, cloud, device))
    except InputError as error:
        raise InputError(f"cameras[{number}]: {error}") from error
