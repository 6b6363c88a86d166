"""The same bits on two devices: every lens model, prepared clouds, filters, replayed graphs."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Iterator
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

import depthwarp as dw
from benchmarks.lenses import cameras
from benchmarks.scenes import RoomScene

__all__ = ["compare", "poses_inside"]


def compare(
    device: Any, points: int, models: Collection[str] | None = None
) -> Iterator[tuple[str, int]]:
    """Render on a device and on the CPU.

    Args:
        device: Warp device.
        points: Points of the cloud.
        models: Names of the lens models, as in `benchmarks.lenses`; None for all, and range views.

    Yields:
        What was compared, and how many pixels and counts differ.
    """
    yield from _compare_views(device, points, models)
    if device.is_cuda:
        yield "replayed graph", _graph_difference(device, points)


def difference(ours: dw.DepthMap, theirs: dw.DepthMap) -> int:
    """Pixels whose depth bits, index or state differ, and one more for other counts."""
    depth = ours.depth.view(np.uint32) != theirs.depth.view(np.uint32)
    other = (ours.index != theirs.index) | (ours.state != theirs.state)
    return int(np.count_nonzero(depth | other)) + int(ours.stats != theirs.stats)


def poses_inside(count: int, seed: int) -> npt.NDArray[np.float32]:
    """Poses in the room, world to OpenCV's axes, shape (count, 4, 4)."""
    rng = np.random.default_rng(seed)
    inside = rng.uniform((1, 1, 1), (5, 4, 2), (count, 3))
    turns = rng.uniform(-180, 180, count)
    poses = [
        dw.Pose.from_orientation(tuple(place), (0, 0, turn)).optical_from_world
        for place, turn in zip(inside.tolist(), turns.tolist(), strict=True)
    ]
    return np.array(poses, np.float32)


def _views(scene: RoomScene) -> Iterator[tuple[str, Any, dict[str, Any]]]:
    """Names, views and options of `render`: each model, then filters, z and a range view."""
    models: dict[str, Any] = dict(cameras(scene))
    lidar = models["spinning LiDAR"]
    away = tuple(np.add(lidar.pose.position, 0.2).tolist())
    models["moving LiDAR"] = dataclasses.replace(
        lidar, pose_end=dataclasses.replace(lidar.pose, position=away)
    )
    for name, camera in models.items():
        yield name, camera, {"max_range": 4.0, "min_range": 0.5}
    yield "pinhole, filters", models["pinhole"], {"filters": dw.filters.paper()}
    yield "fisheye, z", models["fisheye"], {"depth": "z"}
    yield "range view", dw.RangeView(scene.position_m, (0, 0, -30), (60, 60), 0.02, 0.02), {}


def _compare_views(
    device: Any, points: int, models: Collection[str] | None
) -> Iterator[tuple[str, int]]:
    """Each view of the plain cloud, and of the prepared one where it has no range view."""
    scene = RoomScene(points, image_size=(181, 166))
    points_world = scene.points_world()
    points_world[::997, 1] = np.nan
    cloud = dw.PointCloud(points_world)
    prepared = cloud.prepare(device=device.alias)
    for name, view, options in _views(scene):
        if models is not None and name.partition(",")[0] not in models:
            continue
        theirs = dw.render(cloud, view, device="cpu", **options)
        ours = dw.render(cloud, view, device=device.alias, **options)
        yield name, difference(ours, theirs)
        if not isinstance(view, dw.RangeView):
            ours = dw.render(prepared, view, device=device.alias, **options)
            yield f"{name}, prepared", difference(ours, theirs)


def _graph_difference(device: Any, points: int) -> int:
    """A captured call of three views, replayed on other points and poses."""
    clouds = [RoomScene(points, seed=seed).points_world() for seed in (1, 2)]
    poses = [poses_inside(3, seed) for seed in (1, 2)]
    renderers = [
        dw.Renderer(
            [RoomScene(0).camera()] * 3,
            max_points=points,
            filters=dw.filters.paper(),
            device=name,
        )
        for name in (device.alias, "cpu")
    ]
    cloud = wp.array(clouds[0], dtype=wp.vec3f, device=device)
    matrices = wp.array(poses[0], dtype=wp.mat44f, device=device)
    renderers[0].render(cloud, matrices)  # loads the kernels
    with wp.ScopedCapture(device=device) as capture:
        renderers[0].render(cloud, matrices)
    differing = 0
    for turn in (1, 0, 1):
        cloud.assign(clouds[turn])
        matrices.assign(poses[turn])
        wp.capture_launch(capture.graph)
        renderers[1].render(clouds[turn], wp.array(poses[turn], dtype=wp.mat44f, device="cpu"))
        ours, theirs = (renderer.depth_maps() for renderer in renderers)
        differing += sum(map(difference, ours, theirs))
    return differing
