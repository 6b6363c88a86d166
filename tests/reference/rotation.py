"""Camera orientation, equations (3) to (6): world points to camera points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from .precision import rounded


def rotation_x(degrees: float) -> np.ndarray:
    """R_x(alpha), equation (4), as printed: passive, it turns the frame and not the point."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[1.0, 0.0, 0.0], [0.0, c, s], [0.0, -s, c]])


def rotation_y(degrees: float) -> np.ndarray:
    """R_y(beta), equation (5), as printed."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])


def rotation_z(degrees: float) -> np.ndarray:
    """R_z(gamma), equation (6), as printed."""
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])


def camera_from_world(orientation: Sequence[float]) -> np.ndarray:
    """R = R_x(alpha) R_y(beta) R_z(gamma) of C_O (3), degrees: yaw first, then pitch, then roll."""
    alpha, beta, gamma = orientation
    return rotation_x(alpha) @ rotation_y(beta) @ rotation_z(gamma)


def to_camera(
    points: np.ndarray,
    rotation: np.ndarray,
    position: Sequence[float],
    shift: Sequence[float],
    dtype: Any,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Camera coordinates X, Y, Z of `points` (N, 3): R (p - position) - shift.

    All inputs are rounded to `dtype` first. Then, one rounding an operation and no fused
    multiply-add: d = p - position; X = ((r00*dx + r01*dy) + r02*dz) - shift_x; Y and Z likewise
    with rows 1 and 2.
    """
    p = rounded(points, dtype).reshape(-1, 3)
    r = rounded(rotation, dtype)
    position, shift = rounded(position, dtype), rounded(shift, dtype)
    with np.errstate(all="ignore"):  # NaN and infinite points flow through; later steps count them
        dx = p[:, 0] - position[0]
        dy = p[:, 1] - position[1]
        dz = p[:, 2] - position[2]
        X = ((r[0, 0] * dx + r[0, 1] * dy) + r[0, 2] * dz) - shift[0]
        Y = ((r[1, 0] * dx + r[1, 1] * dy) + r[1, 2] * dz) - shift[1]
        Z = ((r[2, 0] * dx + r[2, 1] * dy) + r[2, 2] * dz) - shift[2]
    return X, Y, Z


def to_camera_world_position(
    points: np.ndarray, rotation: np.ndarray, position: Sequence[float], dtype: Any
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """P_C (1) given in the world frame: p_cam = R (p - P_C)."""
    return to_camera(points, rotation, position, (0.0, 0.0, 0.0), dtype)


def to_camera_rotated_position(
    points: np.ndarray, rotation: np.ndarray, position: Sequence[float], dtype: Any
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """P_C (1) given in the rotated frame, the paper's own reading: p_cam = R p - P_C."""
    return to_camera(points, rotation, (0.0, 0.0, 0.0), position, dtype)
