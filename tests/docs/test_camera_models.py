"""The sentences of `docs/conventions.md` under "Camera models"."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import depthwarp as dw
from tests.docs.sentences import (
    DISTORTION,
    ORIGIN,
    PANORAMAS,
    drawn,
    pixel,
    says,
)


@says("A point outside a model's domain has no pixel: nothing folds back into the image.")
def test_domain():
    """With k1 = -0.39 growing angles turn back at r = 0.92: beyond that nothing is drawn."""
    camera = dw.PinholeCamera(20.0, 20.0, 5.0, 5.0, 11, 11, ORIGIN, (-0.39, 0, 0, 0))
    u, _, _, valid = camera.project(np.array([[1, -0.2, 0], [1, -1.6, 0]]))
    assert valid.tolist() == [True, False] and np.isnan(u).tolist() == [False, True]
    # The polynomial alone would draw the second point at 5 + 20 * 1.6 * (1 - 0.39 * 1.6^2) = 5.05.
    assert drawn(camera, (1, -1.6, 0)).stats.outside == 1


@says(
    "Distortion coefficients have OpenCV's order: k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, "
    "tau_x, tau_y."
)
def test_distortion_order():
    """All fourteen against `cv2.projectPoints`."""
    camera = dw.PinholeCamera(500.0, 510.0, 320.0, 240.0, 640, 480, ORIGIN, DISTORTION)
    optical = np.array([[0.3, 0.2, 1.0], [-0.4, 0.1, 1.5], [0.1, -0.3, 0.8]])
    expected, _ = cv2.projectPoints(
        optical, np.zeros(3), np.zeros(3), camera.K, np.array(DISTORTION)
    )
    u, v, _, _ = camera.project(optical[:, [2, 0, 1]] * (1, -1, -1))
    np.testing.assert_allclose(np.stack([u, v], axis=1), expected[:, 0], atol=1e-9)


@says(
    "A fisheye draws a ray at the angle theta from the axis at the distance "
    "theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)."
)
def test_fisheye():
    """To the right, 1.2 rad from the axis."""
    camera = dw.FisheyeCamera(
        100.0, 100.0, 200.0, 200.0, 401, 401, ORIGIN, (0.01, 0.02, -0.003, 0.001)
    )
    theta = 1.2
    bent = theta + 0.01 * theta**3 + 0.02 * theta**5 - 0.003 * theta**7 + 0.001 * theta**9
    u, v = pixel(camera, (np.cos(theta), -np.sin(theta), 0))
    assert (u, v) == pytest.approx((200 + 100 * bent, 200))


@says("The middle column of a panorama looks along the camera's X axis.")
def test_panorama_middle():
    """Of 360 columns the middle is between 179 and 180."""
    for camera in PANORAMAS:
        u, v = pixel(camera, (np.cos(np.pi / 6), np.sin(np.pi / 6), 0))
        assert (u, v) == pytest.approx((179.5, (camera.height - 1) / 2))


@says("Columns of a panorama to the left of the middle see what is to the left.")
def test_panorama_left():
    """A quarter of the turn to the left is a quarter of the width."""
    for camera in PANORAMAS:
        assert pixel(camera, (-np.sin(np.pi / 6), np.cos(np.pi / 6), 0))[0] == pytest.approx(89.5)


@says("The first and the last column of a full turn meet behind the camera.")
def test_panorama_seam():
    """A little to either side of straight behind."""
    for camera in PANORAMAS:
        u = [pixel(camera.with_pose(ORIGIN), (-1, side, 0))[0] for side in (0.001, -0.001)]
        assert u == pytest.approx([-0.5 + 0.18 / np.pi, 359.5 - 0.18 / np.pi], abs=1e-3)
        assert drawn(camera.with_pose(ORIGIN), (-1, 0, 0), (-1, -0.0, 0)).stats.outside == 0


@says(
    "An equirectangular image has equal angles between its rows, a cylindrical one equal tangents."
)
def test_panorama_rows():
    """30 and 45 degrees up."""
    angles = np.radians((0, 30, 45))
    rays = np.stack([np.cos(angles), np.zeros(3), np.sin(angles)], axis=1)
    _, v = PANORAMAS[0].image_of(rays)
    assert v == pytest.approx(89.5 - np.array((0, 30, 45)))
    _, v = PANORAMAS[1].image_of(rays)
    assert v == pytest.approx(44.5 - 45 * np.tan(angles))


@says(
    "The middle pixel of an orthographic image looks along the axis through the camera's position."
)
def test_orthographic():
    """Half a metre to the left is two pixels of a quarter metre."""
    camera = dw.OrthographicCamera.looking(0.25, (11, 11), (1, 2, 3))
    assert pixel(camera, (9, 2, 3)) == (5, 5)
    assert pixel(camera, (9, 2.5, 3)) == (3, 5) == pixel(camera, (2, 2.5, 3))


LIDAR = dw.SpinningLidar(8, (10.0, 0.0, -10.0), ORIGIN, azimuth_zero=4.0)


@says("A spinning LiDAR has one row for each beam and one column for each moment of a turn.")
def test_lidar_size():
    """Three beams, eight moments; a point falls to the nearest beam."""
    assert LIDAR.size == (8, 3)
    slopes = np.tan(np.radians((9, 6, 4, -4, -14)))
    _, v = LIDAR.image_of(np.stack([np.ones(5), np.zeros(5), slopes], axis=1))
    assert v.tolist() == [0, 0, 1, 1, 2]


@says("Seen from above a spinning LiDAR turns clockwise.")
def test_lidar_turns():
    """After straight ahead comes what is on the right."""
    u = [pixel(LIDAR, point)[0] for point in ((1, 0, 0), (0, -1, 0), (-1, -1e-9, 0))]
    assert u == pytest.approx([4, 6, 0], abs=1e-6)


@says("A LiDAR that moves has a pose of its own for every column.")
def test_lidar_moves():
    """Moving ahead by 0.8 m a turn: ranges are those of the moment."""
    end = dw.Pose.from_orientation((0.8, 0, 0), (0, 0, 0))
    lidar = dw.SpinningLidar(8, (0.0, -9.0), ORIGIN, azimuth_zero=4.0, pose_end=end)
    ahead, behind = drawn(lidar, (5, 0, 0)), drawn(lidar, (-5, 0, 0))
    assert ahead.depth[0, 4] == pytest.approx(5 - 0.8 * 4 / 8)
    assert behind.depth[0, 0] == pytest.approx(5)


@says(
    "A moving LiDAR that turns on with its spin sees a part of the world twice, and one that turns "
    "against it misses a part, which is not drawn."
)
def test_lidar_seam():
    """Clockwise by 90 degrees a turn it sees 450 degrees of the world, else 270."""
    circle = np.radians(np.arange(0, 360, 2))
    points = 5 * np.stack([np.cos(circle), np.sin(circle), 0 * circle], axis=1)
    for yaw, seen in ((-90, 450), (90, 270)):
        end = dw.Pose.from_orientation((0, 0, 0), (0, 0, yaw))
        lidar = dw.SpinningLidar(360, (0.0, -9.0), ORIGIN, pose_end=end)
        x, y, _ = np.moveaxis(lidar.unproject(np.full((2, 360), 5.0))[0], -1, 0)
        turned = np.degrees(np.unwrap(np.arctan2(y, x)))
        assert turned[0] - turned[-1] == pytest.approx(seen, abs=2)
        outside = drawn(lidar, *map(tuple, points)).stats.outside
        assert outside == pytest.approx(max(0, 360 - seen) / 2, abs=1)
