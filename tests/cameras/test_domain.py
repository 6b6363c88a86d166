"""What every model does with points that it cannot draw: behind, outside, at its centre."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import depthwarp as dw
from tests.cameras.models import IDENTITY, MODELS, cameras_of, sees_ahead_only
from tests.rendering.strategies import clouds


def camera_of(model: str) -> dw.Camera:
    """One camera of a model, at the origin, looking along X."""
    return MODELS[model](np.random.default_rng(7), IDENTITY, 24)


@pytest.mark.parametrize("model", MODELS)
def test_the_centre_is_in_no_pixel(device, model):
    """Behind for a model that sees only ahead, too near for the others; valid for none."""
    camera = camera_of(model)
    start = camera.unproject(np.zeros((camera.height, camera.width)))
    assert np.isnan(start).all()
    point = np.zeros((1, 3), np.float32)
    stats = dw.render(dw.PointCloud(point), camera, device=device).stats
    if model == "moving":  # its centre is somewhere else in every column
        assert stats.drawn == 0
        return
    assert (stats.behind if sees_ahead_only(camera, "range") else stats.too_near) == 1
    u, v, depth, valid = camera.project(point)
    assert not valid[0] and np.isnan([u[0], v[0], depth[0]]).all()


@pytest.mark.parametrize("model", ["pinhole", "brown", "rational", "orthographic"])
def test_points_behind_are_counted_so(device, model):
    """X <= 0: none is drawn, none is valid, whatever the formula gives."""
    camera = camera_of(model)
    points = np.random.default_rng(1).uniform((-9, -3, -3), (0, 3, 3), (500, 3)).astype(np.float32)
    points[:20, 0] = 0
    stats = dw.render(dw.PointCloud(points), camera, device=device).stats
    assert stats.behind == 500
    assert not camera.project(points)[3].any()


@pytest.mark.parametrize("model", ["fisheye", "equirectangular", "cylindrical", "spinning"])
def test_wide_models_count_nothing_as_behind(device, model):
    """Behind is a direction like others to them; but z depth ends at X = 0."""
    camera = camera_of(model)
    points = np.random.default_rng(1).uniform((-9, -3, -3), (0, 3, 3), (500, 3)).astype(np.float32)
    assert dw.render(dw.PointCloud(points), camera, device=device).stats.behind == 0
    if "z" in camera.depth_kinds:
        by_z = dw.render(dw.PointCloud(points), camera, depth="z", device=device)
        assert by_z.stats.behind == 500 and not camera.project(points, "z")[3].any()


@pytest.mark.parametrize("model", ["pinhole", "brown", "rational", "fisheye", "double_sphere"])
def test_points_on_the_axis_are_at_the_principal_point(model):
    """However near or far; straight behind is nowhere."""
    camera = camera_of(model)
    points = np.array([[1e-6, 0, 0], [1, 0, 0], [1e6, 0, 0], [-1, 0, 0]])
    u, v, depth, _ = camera.project(points)
    centre = camera.cx, camera.cy
    if model == "rational":  # a tilted sensor: where its own formula puts the axis
        t = camera.lens.tilt
        centre = (
            camera.cx + camera.fx * t[0, 2] / t[2, 2],
            camera.cy + camera.fy * t[1, 2] / t[2, 2],
        )
    np.testing.assert_allclose(u[:3], centre[0], atol=1e-9)
    np.testing.assert_allclose(v[:3], centre[1], atol=1e-9)
    np.testing.assert_allclose(depth[:3], points[:3, 0])
    assert np.isnan([u[3], v[3], depth[3]]).all()


@pytest.mark.parametrize("model", MODELS)
@settings(max_examples=15)
@given(data=st.data())
def test_kernel_and_project_agree_on_what_is_drawn(device, model, data):
    """All but a few points at borders, which float32 may put on the other side."""
    camera = data.draw(cameras_of(model))
    points = data.draw(clouds(camera.pose, min_size=20))
    points = points[(np.abs(points) < 1e3).all(axis=1)]
    # So near to the centre that float32 turns the direction.
    points = points[np.linalg.norm(points - camera.pose.center_world, axis=1) > 0.02]
    u, v, _, valid = camera.project(points)
    borders = np.array([-0.5, camera.width - 0.5]), np.array([-0.5, camera.height - 0.5])
    near = sum(
        (abs(axis[:, None] - border) < 0.01).any(axis=1)
        for axis, border in zip((u, v), borders, strict=True)
    )
    stats = dw.render(dw.PointCloud(points), camera, max_range=np.inf, device=device).stats
    in_image = stats.drawn + stats.hidden + stats.too_near
    # Beside the two, one on the edge of a domain, or between two beams, of which points repeat.
    assert abs(in_image - valid.sum()) <= np.count_nonzero(near) + 2
    assert stats.not_finite == 0
