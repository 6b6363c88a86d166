"""Range view data segmentation, equations (8) and (9), literally: every point, every rectangle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from .precision import common_dtype, rounded

Rectangles = tuple[np.ndarray, np.ndarray, np.ndarray]


def steps(fov: Sequence[float], q_line: float) -> tuple[float, float, float]:
    """(q_L cos h, q_L sin h, q_L tan v) in float64, from fov = (H_FOV, V_FOV) degrees, (2), (7)."""
    h, v = math.radians(fov[0] / 2.0), math.radians(fov[1] / 2.0)
    return q_line * math.cos(h), q_line * math.sin(h), q_line * math.tan(v)


def max_x_ahead(X: np.ndarray, Y: np.ndarray, Z: np.ndarray) -> float:
    """The largest X of the finite points ahead of the camera (X > 0), 0.0 where there is none."""
    ahead = np.isfinite(X) & np.isfinite(Y) & np.isfinite(Z) & (X > 0)
    return float(np.max(X[ahead], initial=0.0))


def line_count(max_x_ahead: float, step_x64: float) -> int:
    """N_L = ceil(max X / (q_L cos h)) in float64, at least 1: the last rectangle ends the cloud."""
    return max(1, math.ceil(float(max_x_ahead) / float(step_x64)))


def rectangles(n_lines: int, steps: Sequence[float], dtype: Any) -> Rectangles:
    """X_n, half width Y_n, half height Z_n of R_S(n), n = 1..N_L: each dtype(n) * dtype(step)."""
    n = rounded(np.arange(1, n_lines + 1), dtype)
    step_x, step_y, step_z = rounded(steps, dtype)
    return n * step_x, n * step_y, n * step_z


def depth_plane(n_lines: int, steps: Sequence[float]) -> tuple[float, float, float]:
    """The last rectangle in float64: (D_PD, half width, half height)."""
    step_x, step_y, step_z = steps
    return n_lines * step_x, n_lines * step_y, n_lines * step_z


def segment_union(
    X: np.ndarray, Y: np.ndarray, Z: np.ndarray, rectangles: Rectangles
) -> np.ndarray:
    """The union (9) of PC(x) > R_S(n, x) & R_SYZ(n) (8) over n: a boolean mask of the points.

    All inequalities are strict. A point with a coordinate that is not finite is never selected.
    """
    common_dtype(X, Y, Z, *rectangles)
    selected = np.zeros(X.shape, dtype=bool)
    for x_n, y_n, z_n in zip(*rectangles, strict=True):
        inside_rectangle = (Y > -y_n) & (Y < y_n) & (Z > -z_n) & (Z < z_n)  # (8)
        selected |= (X > x_n) & inside_rectangle  # (9)
    return selected & np.isfinite(X) & np.isfinite(Y) & np.isfinite(Z)
