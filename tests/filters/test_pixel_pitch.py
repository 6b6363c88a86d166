"""What filters know of a lens: how far neighbouring pixels are apart, and whether columns wrap."""

from __future__ import annotations

import math

import numpy as np
import pytest

import depthwarp as dw

POSE = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))


def test_a_pinhole_has_one_over_its_focal_length():
    """The wider of columns and rows counts."""
    camera = dw.PinholeCamera(600.0, 500.0, 361.5, 330.5, 724, 662, POSE)
    assert camera.pixel_pitch == pytest.approx((1 / 500, 0), rel=1e-4)
    assert not camera.wraps


def test_an_orthographic_camera_has_its_pixel_size_at_every_depth():
    """Nothing for each metre of depth."""
    assert dw.OrthographicCamera(0.05, 40, 30, POSE).pixel_pitch == (0.0, 0.05)


def test_a_panorama_has_its_angle():
    """Of 2 degrees a column; a full turn wraps, a part of one does not."""
    full = dw.EquirectangularCamera(180, 45, POSE)
    assert full.pixel_pitch[0] == pytest.approx(math.radians(4), rel=1e-3)  # rows are wider
    assert full.wraps and dw.CylindricalCamera(360, 90, POSE).wraps
    assert not dw.EquirectangularCamera(90, 90, POSE, azimuths=180.0).wraps


def test_a_spinning_sensor_has_that_of_its_beams():
    """Beams 2 degrees apart are farther apart than its columns."""
    lidar = dw.SpinningLidar(1024, tuple(np.linspace(15, -15, 16)), POSE)
    assert lidar.pixel_pitch == pytest.approx((math.radians(2), 0), rel=1e-3)
    assert lidar.wraps


def test_images_of_one_pixel_or_row_have_a_pitch():
    """Nothing to compare with, or only along the row: still a finite number."""
    for size in ((1, 1), (9, 1), (1, 9)):
        pitch = dw.PinholeCamera.from_fov((60, 45), size).pixel_pitch
        assert np.isfinite(pitch).all() and pitch[0] > 0
