"""A chessboard's corners as exactly as a picture shows them: the saddles of its grey values."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

__all__ = ["are_saddles", "grey_levels", "moved_to_saddles", "starts_on_white"]

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]

SADDLE_SHARE = 0.5
"""Least contrast of the squares around a corner, as a share of the median of all corners."""

MIN_HALF_WINDOW = 2


def grey_levels(image: npt.NDArray[Any]) -> Float32Array:
    """An image's grey values in its own unit, shape (H, W)."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return np.ascontiguousarray(grey, np.float32)


def moved_to_saddles(grey: Float32Array, pixels: Float64Array, half_window: float) -> Float64Array:
    """Corners moved to the saddles of the grey values.

    OpenCV's chessboard search leaves errors of up to 0.15 px on tilted boards, the saddles a
    fiftieth of a pixel.

    Args:
        grey: See `grey_levels`.
        pixels: Corners as detected, (u, v) [px], shape (N, 2).
        half_window: Half the side of the window around a corner [px], clear of other corners.

    Returns:
        The corners [px], shape (N, 2).
    """
    half = max(MIN_HALF_WINDOW, int(half_window))
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-4)
    start = np.ascontiguousarray(pixels, np.float32).reshape(-1, 1, 2)
    moved = cv2.cornerSubPix(grey, start, (half, half), (-1, -1), criteria)
    return np.asarray(moved, np.float64).reshape(-1, 2)


def are_saddles(grey: Float32Array, grid: Float64Array) -> bool:
    """Whether dark and bright squares alternate around every corner of a grid.

    On the edge of the pattern the rim is bright on both sides.

    Args:
        grey: See `grey_levels`.
        grid: Corners (u, v) [px], shape (rows, columns, 2).
    """
    down, right = np.gradient(grid, axis=(0, 1))
    one = _around(grey, grid + (right + down) / 2) + _around(grey, grid - (right + down) / 2)
    other = _around(grey, grid + (right - down) / 2) + _around(grey, grid - (right - down) / 2)
    contrast = np.abs(one - other) / np.maximum(one + other, 1.0)
    return bool(contrast.min() > SADDLE_SHARE * np.median(contrast))


def starts_on_white(grey: Float32Array, grid: Float64Array) -> bool:
    """Whether the square beside the first corner of a grid is brighter than that of the last."""
    first, last = (corner.mean(axis=(0, 1)) for corner in (grid[:2, :2], grid[-2:, -2:]))
    return bool(_around(grey, first) >= _around(grey, last))


def _around(grey: Float32Array, pixels: Float64Array) -> Float32Array:
    """Mean grey value of 3 x 3 pixels around places (u, v), shape (..., 2)."""
    mean = np.asarray(cv2.blur(grey, (3, 3)), np.float32)
    column, row = np.moveaxis(np.rint(pixels).astype(int), -1, 0)
    height, width = grey.shape
    return np.asarray(mean[row.clip(0, height - 1), column.clip(0, width - 1)])
