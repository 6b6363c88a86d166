"""Unit quaternions against Rodrigues' formula, Hamilton's product, and half turns."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from depthwarp.cameras.quaternion import quaternion_from_rotation, rotation_from_quaternion
from depthwarp.errors import InputError

seeds = st.integers(0, 2**32 - 1)


def random_quaternion(seed: int) -> np.ndarray:
    """Length 1; one in four has components that are 0 or tiny, as of half turns."""
    rng = np.random.default_rng(seed)
    quaternion = rng.normal(size=4) * rng.choice([1, 1, 1, 0, 1e-9, 1e-160], size=4)
    quaternion[rng.integers(4)] = rng.normal() + 3
    return quaternion / np.linalg.norm(quaternion)


def hamilton(p: np.ndarray, q: np.ndarray) -> np.ndarray:
    a, b = p[0], p[1:]
    c, d = q[0], q[1:]
    return np.array([a * c - b @ d, *(a * d + c * b + np.cross(b, d))])


@given(seeds)
def test_a_quaternion_is_half_the_angle_and_the_axis(seed: int) -> None:
    """(cos(angle / 2), sin(angle / 2) axis) is OpenCV's rotation about that axis."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    angle = rng.uniform(-math.pi, math.pi)
    quaternion = [math.cos(angle / 2), *(math.sin(angle / 2) * axis)]
    expected = cv2.Rodrigues(axis * angle)[0]
    np.testing.assert_allclose(rotation_from_quaternion(quaternion), expected, rtol=0, atol=1e-14)


def test_the_scalar_comes_first() -> None:
    """A quarter turn about Z takes X to Y and has its cosine in front."""
    half = math.sqrt(0.5)
    rotation = rotation_from_quaternion((half, 0, 0, half))
    np.testing.assert_allclose(rotation @ (1, 0, 0), (0, 1, 0), atol=1e-15)
    np.testing.assert_allclose(
        quaternion_from_rotation([[0, -1, 0], [1, 0, 0], [0, 0, 1]]), (half, 0, 0, half), atol=1e-15
    )


@given(seeds)
def test_rotations_come_back(seed: int) -> None:
    """Quaternion to matrix and back gives the quaternion or its negative, with w not negative."""
    quaternion = random_quaternion(seed)
    back = quaternion_from_rotation(rotation_from_quaternion(quaternion))
    assert back[0] >= 0
    assert min(np.abs(back - quaternion).max(), np.abs(back + quaternion).max()) < 1e-15


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0, -0.8), (0, 0.6, 0.8)])
def test_half_turns_are_stable(axis: tuple[float, float, float]) -> None:
    """At 180 degrees, where w is 0, the axis is found to all digits."""
    turn = 2 * np.outer(axis, axis) - np.eye(3)
    quaternion = quaternion_from_rotation(turn)
    assert abs(quaternion[0]) < 1e-15
    np.testing.assert_allclose(np.abs(quaternion[1:] @ axis), 1, rtol=1e-15)


@given(seeds, seeds)
def test_products_are_rotations_one_after_the_other(first: int, second: int) -> None:
    """The matrix of Hamilton's product is the product of the matrices."""
    p, q = random_quaternion(first), random_quaternion(second)
    product = rotation_from_quaternion(p) @ rotation_from_quaternion(q)
    np.testing.assert_allclose(rotation_from_quaternion(hamilton(p, q)), product, atol=1e-14)


def test_many_at_once_are_as_one_by_one() -> None:
    """Stacks of quaternions and matrices give the stack of the single results."""
    quaternions = np.array([random_quaternion(seed) for seed in range(12)]).reshape(3, 4, 4)
    matrices = rotation_from_quaternion(quaternions)
    backs = quaternion_from_rotation(matrices)
    for index in np.ndindex(3, 4):
        np.testing.assert_array_equal(matrices[index], rotation_from_quaternion(quaternions[index]))
        np.testing.assert_array_equal(backs[index], quaternion_from_rotation(matrices[index]))


def test_rounded_quaternions_are_brought_to_length_one() -> None:
    """Three decimals are enough: the matrix is still a rotation to all digits."""
    rotation = rotation_from_quaternion((0.613, 0.596, -0.331, -0.399))
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-15)


@pytest.mark.parametrize("quaternion", [(1, 0, 0, 0.1), (0.9, 0, 0, 0), (0, 0, 0, 0)])
def test_another_length_is_refused(quaternion: tuple[float, ...]) -> None:
    """A quaternion that is no rotation is refused, with its length."""
    length = f"{np.linalg.norm(quaternion):.6g}"
    with pytest.raises(InputError, match=f"length 1 within 0.001.* of length {length};"):
        rotation_from_quaternion([[1, 0, 0, 0], quaternion])


@pytest.mark.parametrize("quaternion", [(math.nan, 0, 0, 1), (math.inf, 0, 0, 0), (1, 0, 0), 1.0])
def test_what_is_no_quaternion_is_refused(quaternion: object) -> None:
    """Not four finite numbers: an error that says what there is."""
    with pytest.raises(InputError, match="quaternion must be finite numbers of shape"):
        rotation_from_quaternion(quaternion)


def test_what_is_no_matrix_is_refused() -> None:
    """Not 3 x 3: an error that says the shape."""
    with pytest.raises(InputError, match=r"shape \(\.\.\., 3, 3\), got \(4, 4\)"):
        quaternion_from_rotation(np.eye(4))
