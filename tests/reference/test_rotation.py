"""The reference's rotation, by hand: passive turns, their order, and each rounding."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.reference import (
    rotation,
)
from tests.reference.points import DTYPES, INF, NAN


def test_quarter_turns_are_passive():
    """The frame turns: after +90 degrees about Z the camera looks along the world's +Y."""
    x, y, z = np.eye(3)
    np.testing.assert_allclose(rotation.rotation_z(90) @ y, x, atol=1e-15)
    np.testing.assert_allclose(rotation.rotation_z(90) @ x, -y, atol=1e-15)
    np.testing.assert_allclose(rotation.rotation_x(90) @ z, y, atol=1e-15)
    np.testing.assert_allclose(rotation.rotation_y(90) @ x, z, atol=1e-15)


def test_yaw_is_applied_first_then_pitch_then_roll():
    """Facing +Y (yaw 90), then nose down (pitch 90): the camera looks along the world's -Z."""
    r = rotation.camera_from_world((0, 90, 90))
    np.testing.assert_allclose(r @ [0, 0, -1], [1, 0, 0], atol=1e-15)
    r = rotation.camera_from_world((10, 20, 30))
    np.testing.assert_allclose(r @ r.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(r) == pytest.approx(1.0)
    assert r[0, 2] == pytest.approx(-math.sin(math.radians(20)))
    assert r.dtype == np.float64


@pytest.mark.parametrize("dtype", DTYPES)
def test_the_two_readings_of_the_position(dtype):
    """World: R (p - P_C). Rotated: R p - P_C. They agree when nothing is turned."""
    quarter = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    point, position = np.array([[1.0, 2.0, 3.0]]), (0.5, 0.25, 1.0)
    world = rotation.to_camera_world_position(point, quarter, position, dtype)
    rotated = rotation.to_camera_rotated_position(point, quarter, position, dtype)
    assert [c.item() for c in world] == [1.75, -0.5, 2.0]
    assert [c.item() for c in rotated] == [1.5, -1.25, 2.0]
    assert all(c.dtype == dtype for c in (*world, *rotated))

    unturned = [
        reading(point, np.eye(3), position, dtype)
        for reading in (rotation.to_camera_world_position, rotation.to_camera_rotated_position)
    ]
    np.testing.assert_array_equal(*unturned)


def test_products_are_rounded_before_they_are_added():
    """a * a is 1 + 2^-11 + 2^-24: float32 drops the last bit, a fused multiply-add would not."""
    a = 1.0 + 2.0**-12
    r = np.array([[a, -1.0, 0.0]] * 3)
    point = np.array([[a, 1.0 + 2.0**-11, 0.0]])
    X, _, _ = rotation.to_camera(point, r, (0, 0, 0), (0, 0, 0), np.float32)
    assert X.item() == 0.0
    X, _, _ = rotation.to_camera(point, r, (0, 0, 0), (0, 0, 0), np.float64)
    assert X.item() == 2.0**-24


def test_sums_go_from_left_to_right():
    """In float32 (2^24 + 1) + 1 stays at 2^24; another order would give 2^24 + 2."""
    point = np.array([[2.0**24, 1.0, 1.0]])
    X, _, _ = rotation.to_camera(point, np.ones((3, 3)), (0, 0, 0), (0, 0, 0), np.float32)
    assert X.item() == 2.0**24


def test_position_is_rounded_first():
    """0.1 rounded to float32 twice is the same number, so the difference is exactly zero."""
    X, Y, Z = rotation.to_camera([[0.1, 0.1, 0.1]], np.eye(3), (0.1,) * 3, (0,) * 3, np.float32)
    assert (X.item(), Y.item(), Z.item()) == (0.0, 0.0, 0.0)


def test_points_that_are_not_finite_flow_through():
    X, Y, Z = rotation.to_camera(
        [[NAN, 0, 0], [INF, 0, 0], [1e30, 0, 0]], np.eye(3), (0, 0, 0), (0, 0, 0), np.float32
    )
    assert np.isnan(X[0])
    assert X[1] == np.inf and np.isnan(Y[1])
    assert np.isfinite([X[2], Y[2], Z[2]]).all()
