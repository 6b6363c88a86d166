"""Poses in the form of most files: optical axes, and where the camera stands."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.pose import MAX_ROTATION_ERROR, OPTICAL_FROM_CAMERA, Pose
from depthwarp.errors import InputError

__all__ = ["check_rotation", "optical_of_pose", "pose_of_optical"]

Float64Array = npt.NDArray[np.float64]


def pose_of_optical(world_from_optical: Float64Array, center: Float64Array) -> Pose:
    """Pose of a camera with optical axes (X right, Y down, Z forward).

    Args:
        world_from_optical: Rotation, shape (3, 3); its columns are the axes in the world.
        center: Where the camera stands in the world [m], shape (3,).
    """
    # The inverse, not the transpose: a rotation rounded in a file is not quite orthogonal.
    rotation = OPTICAL_FROM_CAMERA.T @ np.linalg.inv(world_from_optical)
    rows = [tuple(row) for row in rotation.tolist()]
    x, y, z = center.tolist()
    return Pose((rows[0], rows[1], rows[2]), (x, y, z))


def optical_of_pose(pose: Pose) -> tuple[Float64Array, Float64Array]:
    """The inverse of `pose_of_optical`: rotation world_from_optical (3, 3), centre (3,) [m]."""
    rotation = np.linalg.inv(OPTICAL_FROM_CAMERA @ pose.rotation)
    return np.asarray(rotation, dtype=np.float64), pose.to_world(np.zeros(3))


def check_rotation(name: str, rotation: Float64Array) -> None:
    """Refuse a matrix, shape (3, 3), that is no rotation.

    Raises:
        InputError: Numbers that are not finite, scale, shear or a mirror image; says by how much.
    """
    if not np.isfinite(rotation).all():
        raise InputError(f"{name} must be finite numbers, got {rotation.tolist()}")
    error = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
    determinant = float(np.linalg.det(rotation))
    if error > MAX_ROTATION_ERROR or determinant < 0:
        raise InputError(
            f"{name}: its 3 x 3 numbers are not a rotation (R R^T differs from the identity by "
            f"{error:.3g}, determinant {determinant:.6g})"
        )
