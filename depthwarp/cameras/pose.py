"""Where a camera stands and looks: rotations (3) to (6) and the two readings of P_C."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from depthwarp.checks import check_choice, check_finite_vector, check_matrix
from depthwarp.errors import InputError

__all__ = [
    "OPTICAL_FROM_CAMERA",
    "Pose",
    "PositionFrame",
    "check_pose",
    "rotation_camera_from_world",
]

Float64Array = npt.NDArray[np.float64]
PositionFrame = Literal["world", "rotated"]
Vector3 = tuple[float, float, float]
Matrix3 = tuple[Vector3, Vector3, Vector3]

OPTICAL_FROM_CAMERA: Float64Array = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Camera axes (X forward, Y left, Z up) to OpenCV's optical axes (X right, Y down, Z forward)."""

MAX_ROTATION_ERROR = 1e-4
"""Largest entry of R R^T - I that is taken as rounding of a rotation matrix written to a file."""

MOST_ROTATION_ERROR = 1e-3
"""The same of a pose in memory, which may be the product of several such matrices."""


def check_pose(name: str, value: object) -> None:
    """Refuse what is not a pose.

    Raises:
        InputError: Something else; the message names what makes a pose.
    """
    if not isinstance(value, Pose):
        raise InputError(
            f"{name} must be a Pose, got {type(value).__name__}: "
            "Pose.from_orientation(position, orientation), or Pose.from_optical(matrix) of a "
            "4 x 4 matrix from world to optical axes"
        )


def rotation_camera_from_world(orientation: Sequence[float]) -> Float64Array:
    """The passive rotation `Rx(alpha) @ Ry(beta) @ Rz(gamma)` of equations (4), (5), (6).

    Args:
        orientation: (alpha, beta, gamma) = (roll, pitch, yaw) about X, Y, Z [degrees].

    Returns:
        Rotation from world to camera axes, shape (3, 3), float64.
    """
    alpha, beta, gamma = (
        math.radians(a) for a in check_finite_vector("orientation", orientation, 3)
    )
    ca, sa, cb, sb = math.cos(alpha), math.sin(alpha), math.cos(beta), math.sin(beta)
    cg, sg = math.cos(gamma), math.sin(gamma)
    rotation_x = np.array([[1, 0, 0], [0, ca, sa], [0, -sa, ca]])
    rotation_y = np.array([[cb, 0, -sb], [0, 1, 0], [sb, 0, cb]])
    rotation_z = np.array([[cg, sg, 0], [-sg, cg, 0], [0, 0, 1]])
    rotation: Float64Array = rotation_x @ rotation_y @ rotation_z
    return rotation


@dataclass(frozen=True)
class Pose:
    """A rigid pose: `p_camera = camera_from_world @ (p_world - position) - shift`.

    Attributes:
        camera_from_world: Rotation, 3 x 3, row-major; camera axes are X forward, Y left, Z up.
        position: Subtracted in the world frame, before the rotation [m].
        shift: Subtracted in the rotated frame, after the rotation [m]. One of the two is zero in
            every pose that depthwarp builds; both exist because the paper shifts after rotating.

    Raises:
        InputError: Numbers that are not finite, or a matrix that is not a rotation.
    """

    camera_from_world: Matrix3
    position: Vector3
    shift: Vector3 = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        object.__setattr__(self, "camera_from_world", _checked_rows(self.camera_from_world))
        for name in ("position", "shift"):
            object.__setattr__(self, name, check_finite_vector(name, getattr(self, name), 3))
        _check_rotation("camera_from_world", self.camera_from_world, MOST_ROTATION_ERROR)

    @classmethod
    def from_orientation(
        cls,
        position: Sequence[float],
        orientation: Sequence[float],
        position_frame: PositionFrame = "world",
    ) -> Pose:
        """Pose of the paper's parameters P_C and C_O.

        Args:
            position: P_C [m].
            orientation: C_O = (alpha, beta, gamma) about X, Y, Z [degrees], see
                `rotation_camera_from_world`.
            position_frame: `"world"`: P_C is a point of the cloud's frame. `"rotated"`: the paper's
                own reading, the cloud is rotated about the origin and P_C is a point of the
                rotated frame.

        Raises:
            InputError: A number that is not finite, or an unknown frame.
        """
        check_choice("position_frame", position_frame, ("world", "rotated"))
        rotation = _matrix3(rotation_camera_from_world(orientation))
        point = _vector3(check_finite_vector("position", position, 3))
        if position_frame == "world":
            return cls(rotation, position=point)
        return cls(rotation, position=(0.0, 0.0, 0.0), shift=point)

    @classmethod
    def from_optical(cls, optical_from_world: npt.ArrayLike) -> Pose:
        """Pose of a 4 x 4 matrix that maps world points to OpenCV's optical axes.

        Args:
            optical_from_world: Shape (4, 4), column vectors, rotation and translation [m].

        Raises:
            InputError: Wrong shape, not finite, or the upper 3 x 3 is not a rotation (the message
                says by how much).
        """
        transform = check_matrix("optical_from_world", optical_from_world, 4)
        if not np.allclose(transform[3], (0, 0, 0, 1), rtol=0, atol=1e-9):
            raise InputError(
                "optical_from_world must end in the row (0, 0, 0, 1), got "
                f"{tuple(transform[3].tolist())}; a matrix for row vectors has to be transposed"
            )
        rotation = transform[:3, :3]
        _check_rotation(
            "optical_from_world: the upper 3 x 3", _matrix3(rotation), MAX_ROTATION_ERROR
        )
        # Not -R^T t: a rotation rounded in a file would move a far translation.
        position: Float64Array = -np.linalg.solve(rotation, transform[:3, 3]).astype(np.float64)
        return cls(_matrix3(OPTICAL_FROM_CAMERA.T @ rotation), _vector3(position))

    @property
    def rotation(self) -> Float64Array:
        """`camera_from_world` as an array, shape (3, 3), float64."""
        return np.array(self.camera_from_world)

    @property
    def center_world(self) -> Float64Array:
        """The camera's centre in the world frame [m], shape (3,), float64."""
        center: Float64Array = np.array(self.position) + self.rotation.T @ np.array(self.shift)
        return center

    @property
    def optical_from_world(self) -> Float64Array:
        """World to OpenCV's optical axes, shape (4, 4), column vectors, float64."""
        transform = np.eye(4)
        transform[:3, :3] = OPTICAL_FROM_CAMERA @ self.rotation
        transform[:3, 3] = -transform[:3, :3] @ self.center_world
        return transform

    def to_camera(self, points_world: npt.NDArray[np.floating]) -> Float64Array:
        """World points in the camera frame, float64.

        Args:
            points_world: Points [m], shape (N, 3).

        Returns:
            Points in the camera frame (X forward, Y left, Z up) [m], shape (N, 3).
        """
        offset = points_world.astype(np.float64) - np.array(self.position)
        camera: Float64Array = offset @ self.rotation.T - np.array(self.shift)
        return camera

    def to_world(self, points_camera: npt.NDArray[np.floating]) -> Float64Array:
        """Points of the camera frame in the world frame, float64: the inverse of `to_camera`.

        Args:
            points_camera: Points [m], shape (..., 3).

        Returns:
            Points in the world frame [m], shape (..., 3).
        """
        shifted = points_camera.astype(np.float64) + np.array(self.shift)
        # A rotation rounded in a file is not quite orthogonal, so its inverse is no transpose.
        world: Float64Array = shifted @ np.linalg.inv(self.rotation).T + np.array(self.position)
        return world


def _vector3(values: Sequence[float] | Float64Array) -> Vector3:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _matrix3(matrix: Float64Array) -> Matrix3:
    return _vector3(matrix[0]), _vector3(matrix[1]), _vector3(matrix[2])


def _checked_rows(matrix: object) -> Matrix3:
    """Rows of a 3 x 3 matrix of finite numbers."""
    rows = matrix.tolist() if isinstance(matrix, np.ndarray) else matrix
    if not isinstance(rows, list | tuple) or len(rows) != 3:
        raise InputError(f"camera_from_world must be a 3 x 3 matrix, got {matrix!r}")
    first, second, third = (check_finite_vector("a row of camera_from_world", r, 3) for r in rows)
    return first, second, third  # type: ignore[return-value]


def _check_rotation(name: str, matrix: Matrix3, most: float) -> None:
    """Refuse a matrix whose R R^T differs from the identity by more than `most`, or a mirror.

    Without NumPy: poses are made in great numbers, and of nine numbers this is ten times faster.
    """
    (a, b, c), (d, e, f), (g, h, i) = matrix
    error = max(
        abs(a * a + b * b + c * c - 1),
        abs(d * d + e * e + f * f - 1),
        abs(g * g + h * h + i * i - 1),
        abs(a * d + b * e + c * f),
        abs(a * g + b * h + c * i),
        abs(d * g + e * h + f * i),
    )
    determinant = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)
    if error > most:
        raise InputError(
            f"{name} is not a rotation (R R^T differs from the identity by {error:.3g}, "
            f"determinant {determinant:.6g})"
        )
    if determinant < 0:
        raise InputError(
            f"{name} is not a rotation but a mirror image (determinant {determinant:.6g}): one "
            "axis points the wrong way"
        )
