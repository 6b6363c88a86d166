"""The Z-buffer of section 3.4 as a plain loop over points, with the distance of equation (10)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from .precision import common_dtype, rounded


def depth_range(X: np.ndarray, Y: np.ndarray, Z: np.ndarray, dtype: Any) -> np.ndarray:
    """D_P (10), the Euclidean range: sqrt((X*X + Y*Y) + Z*Z), each operation rounded."""
    X, Y, Z = rounded(X, dtype), rounded(Y, dtype), rounded(Z, dtype)
    with np.errstate(all="ignore"):
        return np.sqrt((X * X + Y * Y) + Z * Z)


def depth_z(X: np.ndarray, Y: np.ndarray, Z: np.ndarray, dtype: Any) -> np.ndarray:
    """Depth along the viewing direction: X."""
    return rounded(X, dtype)


DEPTH_KINDS = {"range": depth_range, "z": depth_z}


def render_loop(
    X: np.ndarray,
    Y: np.ndarray,
    Z: np.ndarray,
    column: np.ndarray,
    row: np.ndarray,
    *,
    width: int,
    height: int,
    depth_kind: str,
    min_range: float = 0.0,
    max_range: float = 15.0,
    selected: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray, dict[str, int]]:
    """Depth map, winner map and counts of the camera points (X, Y, Z), in the caller's order.

    `column`, `row` are what `projection.pixel` returned; `selected` is the mask of (9), or None
    for a plain camera. The depth is computed in the dtype of X, Y, Z, rounded to float32, and only
    then compared: with the limits (also float32) and with the other points.

    Each point is counted once, in the first category that fits: not_finite, behind (X <= 0),
    outside (not selected, or its pixel is not in the image), too_far (depth > max_range), too_near
    (depth < min_range, or depth == 0, which means "empty"), and at last drawn or hidden. The
    nearest point wins a pixel; on equal depth, the one with the lowest index.

    Returns:
        depth (H, W) float32, 0 = empty; index (H, W) int32, -1 = empty; the counts.
    """
    dtype = common_dtype(X, Y, Z)
    depths = rounded(DEPTH_KINDS[depth_kind](X, Y, Z, dtype), np.float32)
    nearest_allowed = float(rounded(min_range, np.float32))
    farthest_allowed = float(rounded(max_range, np.float32))

    depth_map = np.zeros((height, width), dtype=np.float32)
    index_map = np.full((height, width), -1, dtype=np.int32)
    categories = "not_finite behind outside too_near too_far hidden drawn".split()
    counts = {"total": len(X)} | dict.fromkeys(categories, 0)

    # float() of a float32 or float64 is exact, so the comparisons below decide as theirs would.
    for i in range(len(X)):
        x, y, z, depth = float(X[i]), float(Y[i]), float(Z[i]), float(depths[i])
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
            counts["not_finite"] += 1
            continue
        if x <= 0.0:
            counts["behind"] += 1
            continue
        if selected is not None and not selected[i]:
            counts["outside"] += 1
            continue
        if not (0 <= column[i] <= width - 1 and 0 <= row[i] <= height - 1):  # NaN lands here too
            counts["outside"] += 1
            continue
        if depth > farthest_allowed:
            counts["too_far"] += 1
            continue
        if depth < nearest_allowed or depth == 0.0:
            counts["too_near"] += 1
            continue

        pixel = int(row[i]), int(column[i])
        if index_map[pixel] == -1:
            counts["drawn"] += 1
        else:
            counts["hidden"] += 1  # either this point or the one it covers
            if depth >= float(depth_map[pixel]):  # on a tie the earlier, lower index stays
                continue
        depth_map[pixel] = depths[i]
        index_map[pixel] = i
    return depth_map, index_map, counts
