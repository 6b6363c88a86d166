"""Unit quaternions (w, x, y, z), scalar first as in COLMAP, and the rotations that they stand for.

q and -q are the same rotation. The rotation matrix of q takes a vector v to q v q*. Source:
Shepperd 1978, "Quaternion from rotation matrix".
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError

__all__ = ["UNIT_TOLERANCE", "quaternion_from_rotation", "rotation_from_quaternion"]

Float64Array = npt.NDArray[np.float64]

UNIT_TOLERANCE = 1e-3
"""Largest | |q| - 1 | of a quaternion that was rounded, as to three decimals, and not wrong."""


def quaternion_from_rotation(rotation: npt.ArrayLike) -> Float64Array:
    """Quaternions of rotation matrices, stable for every angle.

    Args:
        rotation: Shape (..., 3, 3); rotations, up to rounding, which is not checked.

    Returns:
        (w, x, y, z) of length 1 with w >= 0, shape (..., 4), float64.

    Raises:
        InputError: Another shape.
    """
    matrix = np.asarray(rotation, dtype=np.float64)
    if matrix.shape[-2:] != (3, 3):
        raise InputError(f"rotation must have shape (..., 3, 3), got {matrix.shape}")
    products = _products(matrix)
    # Each row is q times one of its components: the largest of the four loses no digits.
    largest = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)
    row = np.take_along_axis(products, largest[..., None, None], axis=-2)[..., 0, :]
    quaternion = row / np.linalg.norm(row, axis=-1, keepdims=True)
    return np.asarray(np.where(quaternion[..., :1] < 0, -quaternion, quaternion))


def rotation_from_quaternion(quaternion: npt.ArrayLike) -> Float64Array:
    """Rotation matrices of quaternions, which are first brought to length 1.

    Args:
        quaternion: (w, x, y, z), shape (..., 4), of length 1 within `UNIT_TOLERANCE`.

    Returns:
        Shape (..., 3, 3), float64.

    Raises:
        InputError: Another shape, a number that is not finite, or another length (the message says
            by how much).
    """
    given = np.asarray(quaternion, dtype=np.float64)
    if given.shape[-1:] != (4,) or not np.isfinite(given).all():
        raise InputError(
            f"quaternion must be finite numbers of shape (..., 4), got shape {given.shape}"
            + (f": {given.tolist()}" if given.size <= 4 else "")
        )
    length = np.linalg.norm(given, axis=-1, keepdims=True)
    error = np.abs(length - 1)
    if (error > UNIT_TOLERANCE).any():
        worst = np.unravel_index(int(np.argmax(error)), error.shape)
        # By their names: files have w first or last.
        named = zip("wxyz", given[worst[:-1]].tolist(), strict=True)
        raise InputError(
            f"quaternion must have length 1 within {UNIT_TOLERANCE:g}, got "
            f"{', '.join(f'{name} = {value}' for name, value in named)} of length "
            f"{length[worst]:.6g}; check the order of its numbers and the column that it begins in"
        )
    w, x, y, z = np.moveaxis(given / length, -1, 0)
    entries = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in entries], axis=-2)


def _products(r: Float64Array) -> Float64Array:
    """The matrix 4 q q^T of rotations, shape (..., 4, 4): sums of their entries."""
    trace = r[..., 0, 0] + r[..., 1, 1] + r[..., 2, 2]
    square = [1 + trace, *(1 - trace + 2 * r[..., k, k] for k in range(3))]
    wx, wy, wz = (
        r[..., 2, 1] - r[..., 1, 2],
        r[..., 0, 2] - r[..., 2, 0],
        r[..., 1, 0] - r[..., 0, 1],
    )
    xy, xz, yz = (
        r[..., 0, 1] + r[..., 1, 0],
        r[..., 0, 2] + r[..., 2, 0],
        r[..., 1, 2] + r[..., 2, 1],
    )
    rows = [
        [square[0], wx, wy, wz],
        [wx, square[1], xy, xz],
        [wy, xy, square[2], yz],
        [wz, xz, yz, square[3]],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
