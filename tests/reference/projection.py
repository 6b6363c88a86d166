"""Points depth image transformation, section 3.4 and Figure 10: camera points to pixels."""

from __future__ import annotations

from typing import Any

import numpy as np

from .precision import common_dtype, rounded


def depth_map_size(half_width: float, half_height: float, q_depth_map: float) -> tuple[int, int]:
    """(W, H) of a depth plane: round(2 Y_NL / q_DM), round(2 Z_NL / q_DM), ties to even."""
    return round(2.0 * half_width / q_depth_map), round(2.0 * half_height / q_depth_map)


def project_trigonometric(
    X: np.ndarray,
    Y: np.ndarray,
    Z: np.ndarray,
    depth_plane: float,
    q_depth_map: float,
    width: int,
    height: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Pixel coordinates u, v by the angles of Figure 10, in float64, for points ahead (X > 0).

    Seen from above, the line to the point makes phi_y with the viewing direction and meets the
    depth plane, D_PD away, after the horizontal distance D_PDH, hypotenuse of (D_PD, d_y). In the
    upright plane through the line, the point's triangle (d_PH, d_Pz, D_P) and the depth plane's
    (D_PDH, d_z, the line up to the plane) share the angle phi_z.
    """
    d_px, d_py, d_pz = (np.asarray(a, dtype=np.float64) for a in (X, Y, Z))  # P_t - P_C
    d_ph = np.hypot(d_px, d_py)
    phi_y = np.arctan2(d_py, d_px)
    phi_z = np.arctan2(d_pz, d_ph)

    d_pdh = depth_plane / np.cos(phi_y)
    d_y = depth_plane * np.tan(phi_y)
    d_z = d_pdh * np.tan(phi_z)

    u = (width - 1) / 2.0 - d_y / q_depth_map
    v = (height - 1) / 2.0 - d_z / q_depth_map
    return u, v


def project_pinhole(
    X: np.ndarray,
    Y: np.ndarray,
    Z: np.ndarray,
    fx: float,
    fy: float,
    cx: float,
    cy: float,
    dtype: Any,
) -> tuple[np.ndarray, np.ndarray]:
    """u = cx - fx * (Y / X), v = cy - fy * (Z / X): division, product, difference, each rounded."""
    X, Y, Z = rounded(X, dtype), rounded(Y, dtype), rounded(Z, dtype)
    fx, fy, cx, cy = (rounded(value, dtype) for value in (fx, fy, cx, cy))
    with np.errstate(all="ignore"):  # X = 0, NaN and infinite points give NaN or infinite pixels
        u = cx - fx * (Y / X)
        v = cy - fy * (Z / X)
    return u, v


def pixel(u: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(column, row) = (floor(u + 0.5), floor(v + 0.5)), still in the dtype of u and v."""
    half = rounded(0.5, common_dtype(u, v))
    with np.errstate(all="ignore"):
        return np.floor(u + half), np.floor(v + half)


def inside(u: np.ndarray, v: np.ndarray, width: int, height: int) -> np.ndarray:
    """Whether the pixel of (u, v) is in 0..W-1 and 0..H-1; NaN and infinite ones are not."""
    column, row = pixel(u, v)
    return (column >= 0) & (column <= width - 1) & (row >= 0) & (row <= height - 1)
