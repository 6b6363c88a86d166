"""Panoramas: azimuths, elevations, the seam behind and the poles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.errors import InputError
from tests.cameras.device_image import device_image
from tests.cameras.models import IDENTITY, cameras_of
from tests.rendering.strategies import seeds

CLASSES = [dw.EquirectangularCamera, dw.CylindricalCamera]


def exact_image(camera: dw.Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """u, v of points in the camera frame by their angles, in float64."""
    x, y, z = points.astype(np.float64).T
    azimuth, elevation = np.degrees(np.arctan2(y, x)), np.arctan2(z, np.hypot(x, y))
    low, high = np.radians(camera.elevations)
    if isinstance(camera, dw.CylindricalCamera):
        low, high, elevation = np.tan(low), np.tan(high), np.tan(elevation)
    u = (0.5 - azimuth / camera.azimuths) * camera.width - 0.5
    return u, (high - elevation) / (high - low) * camera.height - 0.5


@pytest.mark.parametrize("model", CLASSES)
@given(seed=seeds, size=st.tuples(st.integers(1, 5000), st.integers(1, 3000)))
def test_columns_are_azimuths_and_rows_elevations(model, seed, size):
    """The picture spans the azimuths and elevations that it was asked for, border to border."""
    rng = np.random.default_rng(seed)
    azimuths = float(rng.uniform(10, 360))
    elevations = float(rng.uniform(-85, 0)), float(rng.uniform(1, 85))
    camera = model(*size, IDENTITY, azimuths, elevations)
    points = rng.normal(size=(50, 3))
    u, v, depth, valid = camera.project(points)
    expected = exact_image(camera, points)
    np.testing.assert_allclose((u, v), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(depth, np.linalg.norm(points, axis=1))
    inside = [
        (axis >= -0.5) & (axis < side - 0.5) for axis, side in zip(expected, size, strict=True)
    ]
    np.testing.assert_array_equal(valid, inside[0] & inside[1])


@pytest.mark.parametrize("model", CLASSES)
def test_the_kernel_is_within_a_hundredth_of_a_pixel(device, model):
    """10^5 directions all round, in an image of 8192 columns; printed."""
    rng = np.random.default_rng(1)
    camera = model(8192, 3000, IDENTITY, 360.0, (-80.0, 80.0))
    points = rng.normal(size=(100_000, 3)).astype(np.float32)
    u, v = exact_image(camera, points)
    inside = (v > -1) & (v < 3000)
    ours = device_image(camera, points, device).astype(np.float64)
    away = abs(ours[0] - u)
    error = max(np.minimum(away, 8192 - away)[inside].max(), abs(ours[1] - v)[inside].max())
    print(f"{model.__name__}: at most {error:.5f} px off")
    assert error < 0.01


@pytest.mark.parametrize("model", ["equirectangular", "cylindrical"])
@given(data=st.data())
def test_directions_invert_the_projection(model, data):
    """Every pixel has a unit ray, which is drawn in the pixel's middle."""
    camera = data.draw(cameras_of(model))
    v, u = np.indices((camera.height, camera.width), dtype=np.float64)
    rays = camera.directions(u, v)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=-1), 1, rtol=1e-12)
    again_u, again_v = camera.image_of(rays)
    np.testing.assert_allclose(again_u, u, atol=1e-8)
    np.testing.assert_allclose(again_v, v, atol=1e-8)


def test_a_full_turn_by_hand(device):
    """Ahead is the middle, left of it left, behind both ends; up is the first row."""
    camera = dw.EquirectangularCamera.looking((8, 4))
    points = np.float32(
        [[2, -0.1, 0.1], [0, 3, 0.1], [0, -4, 0.1], [-5, 0.1, 0.1], [-6, -0.1, 0.1], [0.1, 0, 7]]
    )
    depth_map = dw.render(dw.PointCloud(points), camera, device=device)
    assert depth_map.index[1].tolist() == [3, -1, 1, -1, 0, -1, 2, 4] or depth_map.index[
        1
    ].tolist() == [3, -1, -1, 1, -1, 0, 2, 4]
    assert depth_map.index[0, 3] == 5 or depth_map.index[0, 4] == 5
    assert depth_map.stats.drawn == 6


@pytest.mark.parametrize("model", CLASSES)
@pytest.mark.parametrize("width", [1, 2, 7, 1024, 3000, 4096])
def test_nothing_is_lost_at_the_seam(device, model, width):
    """Azimuths of +-180 degrees and all floats beside them are in the first or last column."""
    camera = model(width, 3, IDENTITY)
    y = np.concatenate([[0.0, -0.0], np.float32(2.0) ** np.arange(-40, -5)]).astype(np.float32)
    points = np.concatenate([[[-1, side * value, 0.0] for side in (1, -1)] for value in y])
    depth_map = dw.render(dw.PointCloud(points.astype(np.float32)), camera, device=device)
    assert depth_map.stats.outside == 0
    columns = np.nonzero(depth_map.index >= 0)[1]
    near = abs(points[:, 1]) * camera.fx < 0.4
    assert near.sum() > 10
    drawn = depth_map.index[depth_map.index >= 0]
    assert set(columns[near[drawn]]) <= {0, width - 1}
    assert camera.project(points)[3].all()


@pytest.mark.parametrize("height", [1, 2, 5, 100, 720, 1024, 4001])
def test_the_poles_belong_to_the_image(device, height):
    """Straight up is in the first row, straight down in the last, and all floats beside them."""
    camera = dw.EquirectangularCamera.looking((16, height))
    level = np.concatenate([[0.0], np.float32(2.0) ** np.arange(-40, -8)])
    points = np.concatenate([[[x, 0, 1], [-x, x, 1], [x, x, -1]] for x in level])
    for point in points.astype(np.float32)[::7]:
        depth_map = dw.render(dw.PointCloud(point[None]), camera, device=device)
        assert depth_map.stats.drawn == 1
        row = np.nonzero(depth_map.index >= 0)[0][0]
        if math.atan2(math.hypot(*point[:2]), abs(point[2])) < 0.4 / camera.fy:
            assert row == (0 if point[2] > 0 else height - 1)
    assert camera.project(points)[3].all()


def test_straight_up_is_on_no_cylinder(device):
    """A cylinder has no poles: those points are outside, in the kernel and in `project`."""
    camera = dw.CylindricalCamera.looking((16, 8))
    points = np.float32([[0, 0, 1], [0, 0, -1], [-0.0, 0.0, 2]])
    assert dw.render(dw.PointCloud(points), camera, device=device).stats.outside == 3
    assert not camera.project(points)[3].any()


@pytest.mark.parametrize("model", CLASSES)
def test_less_than_a_turn_does_not_wrap(device, model):
    """Azimuths beyond the borders are outside, those behind too."""
    camera = model(10, 3, IDENTITY, 100.0)
    azimuth = np.radians([49, -49, 51, -51, 180, -179, 130])
    points = np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], axis=1).astype(np.float32)
    depth_map = dw.render(dw.PointCloud(points), camera, device=device)
    assert (depth_map.index[1, 0], depth_map.index[1, 9]) == (0, 1)
    assert depth_map.stats.outside == 5
    assert camera.project(points)[3].tolist() == [True, True] + [False] * 5


@pytest.mark.parametrize("model", CLASSES)
def test_z_depth_is_refused(model):
    """A panorama has no optical axis: in a rendering, in `project` and in `unproject`."""
    camera = model.looking((8, 4))
    cloud = dw.PointCloud(np.ones((1, 3), np.float32))
    for call in (
        lambda: dw.render(cloud, camera, depth="z", device="cpu"),
        lambda: camera.project(cloud.points_world, depth="z"),
        lambda: camera.unproject(np.ones((4, 8)), "z"),
    ):
        with pytest.raises(InputError, match="optical axis.*depth='range'"):
            call()


@pytest.mark.parametrize("azimuths", [0.0, -1.0, 361.0, math.nan])
def test_azimuths_out_of_range_are_refused(azimuths):
    """Above 0, at most 360."""
    with pytest.raises(InputError, match="^azimuths"):
        dw.EquirectangularCamera.looking((8, 4), azimuths=azimuths)


@pytest.mark.parametrize("elevations", [(10, 10), (20, -20), (-91, 0), (math.nan, 3), (0,)])
@pytest.mark.parametrize("model", CLASSES)
def test_elevations_out_of_range_are_refused(model, elevations):
    """(lowest, highest) within the sphere; 90 degrees are on no cylinder."""
    with pytest.raises((InputError, ValueError)):
        model.looking((8, 4), elevations=elevations)
    with pytest.raises(InputError, match="^elevations"):
        dw.CylindricalCamera.looking((8, 4), elevations=(-90, 90))
