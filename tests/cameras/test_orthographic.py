"""The orthographic camera: metres to pixels, and depth from the image's plane."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given

import depthwarp as dw
from depthwarp.errors import InputError
from tests.cameras.device_image import device_image
from tests.cameras.models import IDENTITY, cameras_of
from tests.rendering.strategies import seeds


@given(camera=cameras_of("orthographic"), seed=seeds)
def test_pixels_are_metres(camera, seed):
    """One pixel a `pixel_size`, the position in the middle; both kinds of depth are X."""
    points = np.random.default_rng(seed).uniform(-5, 5, (50, 3))
    x, y, z = camera.pose.to_camera(points).T
    for kind in ("range", "z"):
        u, v, depth, valid = camera.project(points, kind)
        ahead = x > 0
        np.testing.assert_array_equal(np.isnan(u), ~ahead)
        middle = (camera.width - 1) / 2, (camera.height - 1) / 2
        np.testing.assert_allclose((middle[0] - u)[ahead] * camera.pixel_size, y[ahead], atol=1e-9)
        np.testing.assert_allclose((middle[1] - v)[ahead] * camera.pixel_size, z[ahead], atol=1e-9)
        np.testing.assert_allclose(depth[ahead], x[ahead])
        assert not valid[~ahead].any()


def test_a_plan_from_above_by_hand(device):
    """Looking down: the highest point wins, columns run along -Y, rows along -X."""
    camera = dw.OrthographicCamera.looking(0.5, (4, 3), (0, 0, 10), (0, 90, 0))
    points = np.float32(
        [[0.5, 0.75, 1], [0.5, 0.75, 4], [-0.5, -0.75, 2], [0.5, -0.75, 11], [0, 1.1, 0]]
    )
    depth_map = dw.render(dw.PointCloud(points), camera, device=device)
    assert depth_map.index.tolist() == [[1, -1, -1, -1], [-1, -1, -1, -1], [-1, -1, -1, 2]]
    assert depth_map.depth[0, 0] == pytest.approx(6) and depth_map.depth[2, 3] == pytest.approx(8)
    assert (depth_map.stats.behind, depth_map.stats.outside) == (1, 1)


def test_the_kernel_is_within_a_hundredth_of_a_pixel(device):
    """A map of 4000 pixels of 1 cm, 10^5 points; printed."""
    pose = dw.Pose.from_orientation((1, -2, 3), (10, 85, -40))
    camera = dw.OrthographicCamera(0.01, 4000, 3000, pose)
    points = np.random.default_rng(1).uniform(-20, 20, (100_000, 3)).astype(np.float32)
    u, v, _, valid = camera.project(points)
    error = abs(device_image(camera, points, device) - np.stack([u, v]))[:, valid].max()
    print(f"orthographic: at most {error:.5f} px off")
    assert error < 0.01


def test_all_rays_are_the_axis():
    """Whatever the pixel."""
    camera = dw.OrthographicCamera(0.1, 4, 3, IDENTITY)
    np.testing.assert_array_equal(camera.directions([[1, 2]], [[3], [4]]), [[[1, 0, 0]] * 2] * 2)


@pytest.mark.parametrize("pixel_size", [0.0, -1.0, math.nan, math.inf])
def test_a_pixel_size_that_is_not_above_0_is_refused(pixel_size):
    """By name."""
    with pytest.raises(InputError, match="pixel_size"):
        dw.OrthographicCamera.looking(pixel_size, (4, 3))
