"""The constructed range view of Figures 5 and 6: the "V" of equation (7), turned both ways."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .rotation import rotation_z


def v_points(v_fov: float, q_line: float, n_lines: int) -> np.ndarray:
    """The upright "V": two lines z = ±tan(V_FOV / 2) x (7) at x_n = n q_L, shape (2, N_L, 3).

    The paper draws it at Z = 0 and stands it up by a quarter turn; here it is drawn standing, in
    the plane Y = 0, so that the quarter turn brings in no rounding. Order: upper line, lower line.
    """
    x = np.arange(1, n_lines + 1) * q_line
    b = 0.0  # the line offset of (7)
    z = math.tan(math.radians(v_fov / 2.0)) * x + b
    zero = np.zeros_like(x)
    return np.stack([np.column_stack([x, zero, z]), np.column_stack([x, zero, -z])])


def range_view_edges(
    fov: Sequence[float],
    q_line: float,
    n_lines: int,
    position: Sequence[float] = (0.0, 0.0, 0.0),
) -> np.ndarray:
    """The "V" turned by H_FOV / 2 to both sides about Z (6), then shifted to P_C: (4, N_L, 3).

    Order: left upper, left lower, right upper, right lower (left is +Y). The printed matrix turns
    the frame, so the point goes left by the negative angle.
    """
    h_fov, v_fov = fov
    v = v_points(v_fov, q_line, n_lines)
    left = v @ rotation_z(-h_fov / 2.0).T
    right = v @ rotation_z(h_fov / 2.0).T
    return np.concatenate([left, right]) + np.asarray(position, dtype=np.float64)


def corner_rectangles(edges: np.ndarray) -> dict[str, np.ndarray]:
    """R_S(n) read off the edges' n-th points, named as (8) does: x, y_min, y_max, z_min, z_max."""
    return {
        "x": edges[0, :, 0],
        "y_min": edges[:, :, 1].min(axis=0),
        "y_max": edges[:, :, 1].max(axis=0),
        "z_min": edges[:, :, 2].min(axis=0),
        "z_max": edges[:, :, 2].max(axis=0),
    }
