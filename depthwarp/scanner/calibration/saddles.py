"""A chessboard's corners as exactly as a picture shows them, and the right way round."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from depthwarp.scanner.calibration.boards import (
    Board,
    BoardCorners,
    BoardNotFoundError,
    Chessboard,
)

__all__ = ["grey_levels", "refined_corners"]

SADDLE_WINDOW = 0.4
"""Half the side of the window around a chessboard's corner, as a share of the corners' spacing."""

SADDLE_SHARE = 0.5
"""Least contrast of the squares around a corner, as a share of the median of all corners."""


def refined_corners(board: Board, image: npt.NDArray[Any]) -> BoardCorners:
    """Find a board; a chessboard's corners are moved to the saddles of the grey values.

    OpenCV's chessboard search leaves errors of up to 0.15 px on tilted boards, its saddles a
    fiftieth of a pixel; it may begin at either end, and of a board that leaves the image it may
    take the pattern's outer edge for a row of corners, which is refused. ChArUco corners are
    refined already.

    Args:
        board: The board.
        image: Grey or BGR, see `Board.detect`.

    Raises:
        BoardNotFoundError: See `Board.detect`; or a corner lies on the pattern's edge.
    """
    corners = board.detect(image)
    if not isinstance(board, Chessboard):
        return corners
    grey = grey_levels(image)
    grid = corners.pixels.reshape(board.rows, board.columns, 2)
    if (board.rows + board.columns) % 2 == 1 and _first_square(grey, grid) < _first_square(
        grey, grid[::-1, ::-1]
    ):
        grid = grid[::-1, ::-1]  # the square beside the first corner is the white one
    if not _are_saddles(grey, grid):
        raise BoardNotFoundError(
            f"the chessboard of {board.columns} x {board.rows} inner corners is not in view whole"
        )
    spacing = min(float(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min()) for axis in (0, 1))
    half = max(2, int(SADDLE_WINDOW * spacing))
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 100, 1e-4)
    start = np.ascontiguousarray(grid, np.float32).reshape(-1, 1, 2)
    moved = cv2.cornerSubPix(grey, start, (half, half), (-1, -1), criteria)
    return BoardCorners(corners.points_board, np.asarray(moved, np.float64).reshape(-1, 2))


def grey_levels(image: npt.NDArray[Any]) -> npt.NDArray[np.float32]:
    """An image's grey values, shape (H, W)."""
    grey = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return np.asarray(grey, np.float32)


def _are_saddles(grey: npt.NDArray[np.float32], grid: npt.NDArray[np.float64]) -> bool:
    """Whether dark and bright squares alternate around every corner of a grid, (rows, columns, 2).

    On the edge of the pattern the rim is bright on both sides.
    """
    down, right = np.gradient(grid, axis=(0, 1))
    one = _around(grey, grid + (right + down) / 2) + _around(grey, grid - (right + down) / 2)
    other = _around(grey, grid + (right - down) / 2) + _around(grey, grid - (right - down) / 2)
    contrast = np.abs(one - other) / np.maximum(one + other, 1.0)
    return bool(contrast.min() > SADDLE_SHARE * np.median(contrast))


def _first_square(grey: npt.NDArray[np.float32], grid: npt.NDArray[np.float64]) -> float:
    """Grey value in the middle of the square between the first four corners."""
    return float(_around(grey, grid[:2, :2].mean(axis=(0, 1))))


def _around(
    grey: npt.NDArray[np.float32], pixels: npt.NDArray[np.float64]
) -> npt.NDArray[np.float32]:
    """Mean grey value of 3 x 3 pixels around places (u, v), shape (..., 2)."""
    mean = np.asarray(cv2.blur(grey, (3, 3)), np.float32)
    column, row = np.moveaxis(np.rint(pixels).astype(int), -1, 0)
    height, width = grey.shape
    return np.asarray(mean[row.clip(0, height - 1), column.clip(0, width - 1)])
