"""Views through every lens model, and clouds in which every count has points."""

from __future__ import annotations

import dataclasses

import numpy as np
import warp as wp

import depthwarp as dw
from depthwarp.rendering import RenderConfig, ViewPlan
from depthwarp.rendering.points import Points, points_of
from depthwarp.rendering.views import DeviceViews
from depthwarp_kernels.point_source import PLAIN, PREPARED
from depthwarp_kernels.splat import SplatConfig
from tests.cameras.models import IDENTITY, MODELS, quietly

POSES = [
    IDENTITY,
    dw.Pose.from_orientation((0.3, -0.4, 0.2), (10, 20, 130)),
    dw.Pose.from_orientation((9.0, 0.0, 0.0), (0, 0, 0)),  # all of the cloud behind it
]

SCENES = [*MODELS, "fisheye z", "range view"]
"""Lens models with their range, one with z beside itself, and segmentation by (8)(9)."""


CULLED = ["pinhole", "fisheye", "fisheye z", "equirectangular", "orthographic", "spinning"]
"""Scenes whose blocks are culled in different ways."""


def views_of(scene: str, device: str = "cpu") -> tuple[DeviceViews, RenderConfig]:
    """Three views of a scene, and bounds that leave some points too near or too far."""
    model, _, kind = scene.partition(" ")
    config = RenderConfig("z" if kind == "z" else "range", 0.8, 4.0)
    if scene == "range view":
        paper = dw.RangeView((0, 0, 0), (0, 0, 0), (70, 50), 0.1, 0.2, depth_plane=5.0)
        lines = paper.line_count(dw.PointCloud(np.zeros((1, 3), np.float32)), device=device)
        camera = paper.camera_of_plane(lines)
        plans = [ViewPlan(camera.with_pose(pose), lines, paper.steps) for pose in POSES]
    else:
        camera = MODELS[model](np.random.default_rng(3), IDENTITY, 24)
        if not isinstance(camera, dw.SpinningLidar):
            camera = quietly(dataclasses.replace, camera, width=20, height=16)
        plans = [ViewPlan(camera.with_pose(pose)) for pose in POSES]
    return DeviceViews(plans, config, wp.get_device(device)), config


def splat_configs(scene: str) -> list[SplatConfig]:
    """What the splat's kernels of a scene are made from: a plain cloud, then a prepared one."""
    views, config = views_of(scene)
    kinds = [PLAIN] if views.has_range_views else [PLAIN, PREPARED]
    return [SplatConfig(kind, views.model, config.depth, views.has_range_views) for kind in kinds]


def points_world(count: int) -> np.ndarray:
    """Points all round the origin, some of them not finite, the last third copies of the first."""
    rng = np.random.default_rng(count)
    points = rng.uniform(-4, 4, (count, 3)).astype(np.float32)
    points[rng.random(count) < 0.02, 1] = np.nan
    points[count - count // 3 :] = points[: count // 3]
    return points


def cloud_of(points: np.ndarray, prepared: bool, device: str = "cpu") -> Points:
    """A cloud as the splat takes it."""
    if prepared:
        return points_of(dw.PointCloud(points).prepare(device=device))
    return points_of(wp.array(points, dtype=wp.vec3f, device=device))
