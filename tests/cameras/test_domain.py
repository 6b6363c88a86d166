"""What every model does with points that it cannot draw: behind, outside, at its centre."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.errors import InputError
from tests.cameras.models import IDENTITY, MODELS, cameras_of, quietly, sees_ahead_only
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


@pytest.mark.parametrize("model", ["pinhole", "moving"])
@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([1, 2, 3], r"shape \(N, 3\), got \(3,\): one point is \[\[x, y, z\]\]"),
        (np.ones((3, 4)), r"shape \(N, 3\), got \(3, 4\)$"),
        (np.ones((2, 2, 3)), r"got \(2, 2, 3\)$"),
        ("points", "must be numbers"),
    ],
)
def test_points_of_another_shape_are_refused(model, points, message):
    """The message says the shape, and of one point how to write it."""
    with pytest.raises(InputError, match=f"^points_world.*{message}"):
        camera_of(model).project(points)


def test_two_numbers_are_no_size():
    """`looking(720, 360)`: the size is one argument."""
    with pytest.raises(InputError, match=r"one tuple \(width, height\), got 720"):
        dw.EquirectangularCamera.looking(720, 360)


def test_models_without_z_are_named_without_an_article():
    """Whatever letter the model begins with."""
    for camera in (camera_of("equirectangular"), camera_of("cylindrical")):
        with pytest.raises(InputError, match=f"^{type(camera).__name__} has no optical axis"):
            camera.check_kind("z")


# --- z depth beside the axis ---

WIDE = {
    "fisheye": quietly(dw.FisheyeCamera, 60.0, 60.0, 127.5, 127.5, 256, 256, IDENTITY),
    "double_sphere": quietly(
        dw.DoubleSphereCamera, 60.0, 60.0, 127.5, 127.5, 0.2, 0.6, 256, 256, IDENTITY
    ),
}


@pytest.mark.parametrize("model", WIDE)
def test_z_ends_at_85_degrees(device, model):
    """Rays at 84.9 degrees are drawn by z, those at 85.1 are behind; by range both are drawn."""
    camera = WIDE[model]
    turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    points = np.concatenate(
        [
            3
            * np.stack(
                [np.full(12, np.cos(a)), np.sin(a) * np.cos(turn), np.sin(a) * np.sin(turn)], axis=1
            )
            for a in np.radians((84.9, 85.1, 95.0))
        ]
    ).astype(np.float32)
    by_z = dw.render(dw.PointCloud(points), camera, depth="z", device=device).stats
    assert (by_z.behind, by_z.drawn + by_z.hidden) == (24, 12)
    assert camera.project(points, "z")[3].tolist() == [True] * 12 + [False] * 24
    assert np.isnan(camera.project(points, "z")[2][12:]).all()
    by_range = dw.render(dw.PointCloud(points), camera, device=device).stats
    assert by_range.behind == 0 and by_range.drawn + by_range.hidden == 36


@pytest.mark.parametrize("model", WIDE)
def test_z_maps_of_wide_lenses_come_back(device, model):
    """render, unproject, render by z: no point runs away, and pixels and depths stay."""
    camera = WIDE[model]
    points = np.random.default_rng(5).uniform(-6, 6, (100_000, 3)).astype(np.float32)
    first = dw.render(dw.PointCloud(points), camera, depth="z", device=device)
    depth = np.where(np.isfinite(camera.unproject(first)[..., 0]), first.depth, 0)
    assert np.count_nonzero(depth) > 0.98 * np.count_nonzero(first.depth)  # but for the rim
    cloud = first.unproject()
    assert np.abs(cloud.points_world).max() < 100
    again = dw.render(cloud, camera, depth="z", max_range=16.0, device=device)
    np.testing.assert_array_equal(again.depth > 0, depth > 0)
    np.testing.assert_allclose(again.depth, depth, rtol=2e-5)


@pytest.mark.parametrize("model", WIDE)
def test_prepared_clouds_count_what_z_cannot_see(device, model):
    """Blocks that are passed over as a whole are counted as their points would be."""
    camera = WIDE[model].with_pose(dw.Pose.from_orientation((0.3, -0.2, 0.1), (10, 20, 30)))
    cloud = dw.PointCloud(np.random.default_rng(6).uniform(-6, 6, (50_000, 3)).astype(np.float32))
    plain = dw.render(cloud, camera, depth="z", device=device)
    prepared = dw.render(cloud.prepare(device=device), camera, depth="z", device=device)
    assert plain.stats == prepared.stats
    np.testing.assert_array_equal(plain.index, prepared.index)
