"""The exponential map of rigid motions, for NumPy, torch and JAX, and gradients by its twist.

Source: Barfoot, State Estimation for Robotics, 2017, section 7.1.3, equations (7.14), (7.16) and
(7.37).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from depthwarp.errors import InputError

__all__ = ["exponential", "se3_exp", "twist_gradient"]

SERIES_BELOW = 0.25
"""Square of the angle [rad^2] below which series replace quotients that go to 0 / 0."""

SERIES_TERMS = 8
"""Below it the first term that is left out is less than 1e-19 of the sum."""


def se3_exp(twist: Any) -> Any:
    """Rigid motions of twists, as NumPy arrays.

    `se3_exp(twist) @ pose` moves a pose optical_from_world by a small step in the camera's optical
    axes; its derivatives by the twist at 0 are the six generators of rigid motion. The functions of
    this name in `torch_gradients` and `jax_gradients` are the same, and differentiable everywhere,
    at 0 too.

    Args:
        twist: Translation part [m], then rotation vector [rad], shape (..., 6).

    Returns:
        Matrices of the shape (..., 4, 4), of the type of `twist`.

    Raises:
        InputError: Another shape.
    """
    return exponential(np, np.asarray(twist))


def twist_gradient(pose_gradient: Any, poses: Any) -> Any:
    """The gradient by `twist` at 0 of a function of `se3_exp(twist) @ poses`, as NumPy arrays.

    For gradients that come from Warp's tape as matrices; torch and JAX differentiate through their
    own `se3_exp`. By generator k of rigid motion it is the sum of `pose_gradient * (E_k @ poses)`.

    Args:
        pose_gradient: Gradient by the numbers of the matrices, shape (..., 4, 4).
        poses: optical_from_world, shape (..., 4, 4).

    Returns:
        Gradient by the translation part, then by the rotation vector, shape (..., 6).

    Raises:
        InputError: Other shapes.
    """
    gradient, matrices = np.asarray(pose_gradient), np.asarray(poses)
    if gradient.shape != matrices.shape or gradient.shape[-2:] != (4, 4):
        raise InputError(
            "pose_gradient and poses must both have the shape (..., 4, 4), got "
            f"{gradient.shape} and {matrices.shape}"
        )
    by_entry = gradient @ np.swapaxes(matrices, -1, -2)
    turned = by_entry - np.swapaxes(by_entry, -1, -2)
    parts = [by_entry[..., k, 3] for k in range(3)]
    return np.stack([*parts, turned[..., 2, 1], turned[..., 0, 2], turned[..., 1, 0]], axis=-1)


def exponential(namespace: Any, twist: Any) -> Any:
    """Rigid motions of twists, with the functions of `numpy`, `torch` or `jax.numpy`."""
    shape = tuple(twist.shape)
    if not shape or shape[-1] != 6:
        raise InputError(f"twist must have the shape (..., 6), got {shape}")
    moved_x, moved_y, moved_z, x, y, z = (twist[..., k] for k in range(6))
    sine, cosine, rest = _series_and_quotients(namespace, x * x + y * y + z * z)
    zero, one = namespace.zeros_like(x), namespace.ones_like(x)
    # Cosines on the diagonal are 1 - cosine (w^2 - w_i^2), without a difference of large numbers.
    rotation = (
        (1 - cosine * (y * y + z * z), cosine * x * y - sine * z, cosine * x * z + sine * y),
        (cosine * x * y + sine * z, 1 - cosine * (x * x + z * z), cosine * y * z - sine * x),
        (cosine * x * z - sine * y, cosine * y * z + sine * x, 1 - cosine * (x * x + y * y)),
    )
    # t = (1 + cosine [w] + rest [w]^2) moved
    across = _cross((x, y, z), (moved_x, moved_y, moved_z))
    twice = _cross((x, y, z), across)
    moved = (moved_x, moved_y, moved_z)
    translation = [moved[k] + cosine * across[k] + rest * twice[k] for k in range(3)]
    entries = [entry for k in range(3) for entry in (*rotation[k], translation[k])]
    return namespace.stack([*entries, zero, zero, zero, one], -1).reshape((*shape[:-1], 4, 4))


def _series_and_quotients(namespace: Any, square: Any) -> tuple[Any, Any, Any]:
    """sin(w) / w, (1 - cos(w)) / w^2 and (w - sin(w)) / w^3 of the square of an angle w."""
    small = square < SERIES_BELOW
    # Both sides of a `where` are differentiated: neither may meet a number that it cannot take.
    near = namespace.where(small, square, namespace.zeros_like(square))
    far = namespace.where(small, namespace.ones_like(square), square)
    angle = namespace.sqrt(far)
    half_sine = namespace.sin(angle / 2)
    quotients = (
        namespace.sin(angle) / angle,
        2 * half_sine * half_sine / far,
        (angle - namespace.sin(angle)) / (far * angle),
    )
    sine, cosine, rest = (
        namespace.where(small, _series(near, first), quotient)
        for first, quotient in zip((1, 2, 3), quotients, strict=True)
    )
    return sine, cosine, rest


def _series(square: Any, first: int) -> Any:
    """1 / first! - w^2 / (first + 2)! + w^4 / (first + 4)! - ..., by Horner."""
    total: Any = 0.0
    for k in reversed(range(SERIES_TERMS)):
        total = (-1) ** k / math.factorial(first + 2 * k) + square * total
    return total


def _cross(a: tuple[Any, Any, Any], b: tuple[Any, Any, Any]) -> tuple[Any, Any, Any]:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
