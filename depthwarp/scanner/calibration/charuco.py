"""The ChArUco board: a chessboard with markers, found also where it is seen in part."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from depthwarp.checks import check_positive
from depthwarp.errors import InputError
from depthwarp.scanner.calibration.boards import (
    BoardCorners,
    BoardNotFoundError,
    Image,
    board_grid,
    check_sides,
    grey8,
)
from depthwarp.scanner.calibration.saddles import grey_levels, moved_to_saddles

__all__ = ["CharucoBoard"]

Float64Array = npt.NDArray[np.float64]

MIN_CORNERS = 8
"""Fewest corners of a partly seen board that still give a usable pose."""


@dataclass(frozen=True)
class CharucoBoard:
    """A chessboard with a marker in every white square: it may be seen in part, at any angle.

    Attributes:
        columns: Squares along the board's X.
        rows: Squares along its Y.
        square: Edge of a square [m].
        marker: Edge of a marker [m].
        dictionary: Name of OpenCV's predefined dictionary of markers.

    Raises:
        InputError: Sizes that make no board, an unknown dictionary, or one with too few markers.
    """

    columns: int
    rows: int
    square: float
    marker: float
    dictionary: str = "DICT_5X5_250"

    def __post_init__(self) -> None:
        check_sides("squares", self.columns, self.rows)
        check_positive("square", self.square, "metres")
        check_positive("marker", self.marker, "metres")
        if self.marker >= self.square:
            raise InputError(
                f"marker must be smaller than square, got {self.marker} and {self.square} metres"
            )
        known = [name for name in dir(cv2.aruco) if name.startswith("DICT_")]
        if self.dictionary not in known:
            raise InputError(
                f"unknown dictionary '{self.dictionary}'; there are {', '.join(known)}"
            )
        needed, held = self.columns * self.rows // 2, len(self._markers.bytesList)
        if needed > held:
            raise InputError(
                f"dictionary {self.dictionary} holds {held} markers, this board needs {needed}"
            )

    @property
    def points(self) -> Float64Array:
        """All inner corners [m], row by row, shape (N, 3), the first one a square from the edge."""
        return board_grid(self.columns - 1, self.rows - 1, self.square)

    @property
    def text(self) -> str:
        """The board in one word that `parse_board` reads."""
        return (
            f"charuco:{self.columns}x{self.rows}:{self.square!r}:{self.marker!r}:{self.dictionary}"
        )

    def detect(self, image: Image) -> BoardCorners:
        """Find the visible part of the board; see `Board.detect`."""
        grey = grey8(image)
        corners, ids, _, marker_ids = self._detector.detectBoard(grey)
        count = 0 if ids is None else len(ids)
        if ids is None or count < MIN_CORNERS or _on_one_line(self.points[np.ravel(ids)]):
            markers = 0 if marker_ids is None else len(marker_ids)
            raise BoardNotFoundError(
                f"{count} corners and {markers} markers of the ChArUco board {self.text} in the "
                f"image of {grey.shape[1]} x {grey.shape[0]} px, at least {MIN_CORNERS} corners in "
                "two rows are needed: bring it closer, light it evenly, check its numbers and "
                "dictionary, and switch the laser off"
            )
        # OpenCV 4.10 puts these corners half a pixel to the lower right, 5.0 does not; refined,
        # both agree. The window stays clear of the markers.
        pixels = np.asarray(corners, np.float64).reshape(-1, 2)
        clear = 0.35 * (self.square - self.marker) / self.square
        pixels = moved_to_saddles(grey_levels(image), pixels, clear * _spacing(pixels))
        return BoardCorners(self.points[np.ravel(ids)], pixels)

    def draw(self, pixels_a_square: int) -> npt.NDArray[np.uint8]:
        """The board to print, with a white border of one square, shape (H, W)."""
        size = (pixels_a_square * self.columns, pixels_a_square * self.rows)
        picture = np.asarray(self._board.generateImage(size), np.uint8)
        return np.pad(picture, pixels_a_square, constant_values=255)

    @property
    def _markers(self) -> Any:
        return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))

    @property
    def _board(self) -> Any:
        size = (self.columns, self.rows)
        return cv2.aruco.CharucoBoard(size, self.square, self.marker, self._markers)

    @cached_property
    def _detector(self) -> Any:
        return cv2.aruco.CharucoDetector(self._board)


def _on_one_line(points: Float64Array) -> bool:
    return bool(np.linalg.matrix_rank(points[:, :2] - points[0, :2], tol=1e-9) < 2)


def _spacing(pixels: Float64Array) -> float:
    """Median distance of corners (u, v), shape (N, 2), from their nearest neighbours [px]."""
    apart = np.linalg.norm(pixels[:, None] - pixels, axis=2)
    return float(np.median(np.sort(apart, axis=1)[:, 1]))
