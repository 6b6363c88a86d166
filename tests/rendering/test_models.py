"""Rendering through every camera model: the kernels against the references, bit by bit."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp import arrays
from depthwarp.devices import resolve_device
from depthwarp.errors import InputError
from depthwarp.rendering import RenderConfig, RenderPlan, ViewPlan
from tests.cameras.models import (
    IDENTITY,
    MODELS,
    cameras_of,
    least_z_cosine,
    poses,
    quietly,
    sees_ahead_only,
    twin_camera_points,
    twin_depth,
    twin_image,
)
from tests.reference import lenses
from tests.rendering.strategies import clouds, seeds
from tests.rendering.twin import FLOAT32_MAX, assert_is_twin, render

MODEL_NAMES = [name for name in MODELS if name != "pinhole"]  # that one has a loop of its own
WITH_Z = ["fisheye"]  # z depth beside range: once more to compile, so for one model only


def twin(points: np.ndarray, camera: dw.Camera, options: dict):
    """Depth, winners and counts of the references."""
    xyz = twin_camera_points(camera, points)
    u, v = twin_image(camera, xyz)
    return lenses.render_sorted(
        xyz,
        u,
        v,
        twin_depth(camera, xyz, options["depth_kind"]),
        size=camera.size,
        ahead_only=sees_ahead_only(camera, options["depth_kind"]),
        min_range=options["min_range"],
        max_range=min(options["max_range"], FLOAT32_MAX),
        least_cosine=least_z_cosine(camera, options["depth_kind"]),
    )


@st.composite
def bounds(draw: st.DrawFn, depths: np.ndarray, kind: str) -> dict:
    """Depth kind and range bounds; often the exact depth of a point."""
    depths = np.sort(depths[np.isfinite(depths) & (depths > 0)])
    some = depths[:: max(1, len(depths) // 8)].tolist()
    near = draw(st.sampled_from([0.0, 0.0, 0.1, *some[:3]]))
    far = draw(st.sampled_from([15.0, math.inf, *some[3:]]))
    if not near < far:
        near, far = 0.0, math.inf
    return {"depth_kind": kind, "min_range": near, "max_range": far}


@pytest.mark.parametrize(
    ("model", "kind"), [(m, "range") for m in MODEL_NAMES] + [(m, "z") for m in WITH_Z]
)
@settings(max_examples=25)
@given(data=st.data())
def test_a_model_renders_as_its_reference(device, model, kind, data):
    """Any lens, pose, cloud and bounds: depth bits, winners and counts are the reference's."""
    camera = data.draw(cameras_of(model))
    points = data.draw(clouds(camera.pose))
    depths = twin_depth(camera, twin_camera_points(camera, points), kind)
    options = data.draw(bounds(depths, kind))
    depth_map = render(points, camera, options, device)
    assert_is_twin(depth_map, twin(points, camera, options))


# --- several views ---


@pytest.mark.parametrize("model", MODEL_NAMES)
def test_views_of_one_plan_are_those_of_single_ones(device, model):
    """Other lenses, poses and, of LiDARs, beams in each view: the bits of one-by-one rendering."""
    rng = np.random.default_rng(9)
    target = resolve_device(device)
    drawn = [MODELS[model](rng, pose, 24) for pose in (IDENTITY, *random_poses(rng, 3))]
    if model in ("spinning", "moving"):
        cameras = [of_size(lidar, 20, 6) for lidar in drawn]
    else:
        cameras = [quietly(dataclasses.replace, camera, width=20, height=16) for camera in drawn]
    points = rng.uniform(-6, 6, (2000, 3)).astype(np.float32)
    plan = RenderPlan([ViewPlan(camera) for camera in cameras], RenderConfig(), target)
    plan.render(arrays.share_points(points, target))
    for ours, camera in zip(plan.depth_maps(), cameras, strict=True):
        single = dw.render(dw.PointCloud(points), camera, device=device)
        np.testing.assert_array_equal(ours.depth.view(np.uint32), single.depth.view(np.uint32))
        np.testing.assert_array_equal(ours.index, single.index)
        assert ours.stats == single.stats and ours.camera == camera


def random_poses(rng: np.random.Generator, count: int) -> list[dw.Pose]:
    """Poses within 2 m, turned in any way."""
    return [
        dw.Pose.from_orientation(rng.uniform(-2, 2, 3), rng.uniform(-180, 180, 3))
        for _ in range(count)
    ]


def of_size(lidar: dw.SpinningLidar, width: int, beams: int) -> dw.SpinningLidar:
    """A LiDAR of as many columns and beams; the elevations are its own first and last ones."""
    elevations = np.linspace(max(lidar.beam_elevations), min(lidar.beam_elevations), beams)
    return dataclasses.replace(
        lidar, width=width, beam_elevations=tuple(elevations.tolist()), beam_azimuths=None
    )


@settings(max_examples=10)
@given(pose=poses(), seed=seeds)
def test_views_of_different_models_are_refused(pose, seed):
    """Whichever two models: one plan has one."""
    rng = np.random.default_rng(seed)
    first, second = rng.choice(MODEL_NAMES[:7], 2, replace=False)
    views = [
        ViewPlan(quietly(dataclasses.replace, MODELS[name](rng, pose, 24), width=9, height=7))
        for name in (first, second)
    ]
    with pytest.raises(InputError, match="one camera model"):
        RenderPlan(views, RenderConfig(), resolve_device("cpu"))
