"""Rigid motions of twists in NumPy, and gradients by twists."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from depthwarp.errors import InputError
from depthwarp.sim.se3 import SERIES_BELOW, se3_exp, twist_gradient

from .winner_scenes import make_scene

ANGLES = (0.0, 1e-9, 1e-4, np.sqrt(SERIES_BELOW) - 1e-9, np.sqrt(SERIES_BELOW) + 1e-9, 2.0, 3.5)


def generator(twist: Any) -> Any:
    """The 4 x 4 matrix whose exponential is the motion."""
    moved, (x, y, z) = twist[:3], twist[3:]
    matrix = np.zeros((4, 4))
    matrix[:3, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    matrix[:3, 3] = moved
    return matrix


def twist_of(angle: float) -> Any:
    axis = np.array([2.0, -1.0, 2.0]) / 3
    return np.concatenate([[0.3, -0.7, 1.1], angle * axis])


@pytest.mark.parametrize("angle", ANGLES)
def test_motions_are_the_sums_of_the_exponential_series(angle):
    """At 0, near it, on both sides of where the formula changes, and beyond half a turn."""
    term, total = np.eye(4), np.eye(4)
    for k in range(1, 60):
        term = term @ generator(twist_of(angle)) / k
        total = total + term
    np.testing.assert_allclose(se3_exp(twist_of(angle)), total, rtol=0, atol=2e-14)


def test_motions_of_float32_stay_rigid():
    """Type and leading shape are the twist's; the rotation is orthonormal to float32."""
    motions = se3_exp(np.array([[twist_of(angle) for angle in ANGLES]], np.float32))
    assert motions.dtype == np.float32 and motions.shape == (1, len(ANGLES), 4, 4)
    turned = motions[..., :3, :3]
    np.testing.assert_allclose(turned @ turned.swapaxes(-1, -2) - np.eye(3), 0, atol=1e-6)


def test_the_gradient_by_a_twist_is_that_of_small_steps():
    """Central differences along each of the six generators, for several poses."""
    poses = make_scene().poses
    weights = np.random.default_rng(4).normal(size=poses.shape)
    found = twist_gradient(weights, poses)
    for k in range(6):
        step = 1e-6 * np.eye(6)[k]
        ahead, behind = (weights * (se3_exp(sign * step) @ poses) for sign in (1, -1))
        expected = (ahead - behind).sum(axis=(-2, -1)) / 2e-6
        np.testing.assert_allclose(found[..., k], expected, atol=1e-8)


def test_other_shapes_are_refused():
    """The message names the shape that is needed."""
    with pytest.raises(InputError, match=r"twist must have the shape \(..., 6\), got \(5,\)"):
        se3_exp(np.zeros(5))
    with pytest.raises(InputError, match=r"must both have the shape \(..., 4, 4\)"):
        twist_gradient(np.zeros((4, 4)), np.zeros((2, 4, 4)))
