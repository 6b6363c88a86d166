"""The chessboard: found as a whole, its corners moved to the saddles of the image."""

from __future__ import annotations

from dataclasses import dataclass

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
from depthwarp.scanner.calibration.saddles import (
    are_saddles,
    grey_levels,
    moved_to_saddles,
    starts_on_white,
)

__all__ = ["Chessboard"]

Float64Array = npt.NDArray[np.float64]

SADDLE_WINDOW = 0.4
"""Half the side of the window around a chessboard's corner, as a share of the corners' spacing."""

MAX_SADDLE_MOVE_PX = 0.7
"""A chessboard's corner whose saddle is farther stays: a shadow or a lit line crosses it."""


@dataclass(frozen=True)
class Chessboard:
    """A chessboard pattern, told apart by its number of inner corners; it must be seen whole.

    The first corner is the one beside a white square. A board whose two numbers add up to an even
    one looks the same upside down: its corners are then ordered so that the last one is seen below
    the first, right as long as the board stands upright.

    Attributes:
        columns: Inner corners along the board's X.
        rows: Inner corners along its Y.
        square: Edge of a square [m].

    Raises:
        InputError: Fewer than 3 corners a side, as many columns as rows, or a square without size.
    """

    columns: int
    rows: int
    square: float

    def __post_init__(self) -> None:
        check_sides("inner corners", self.columns, self.rows)
        check_positive("square", self.square, "metres")
        if self.columns == self.rows:
            raise InputError(
                f"a chessboard of {self.columns} x {self.rows} inner corners looks the same when "
                "turned: use one with different numbers, or a ChArUco board"
            )

    @property
    def points(self) -> Float64Array:
        """All inner corners [m], row by row, shape (N, 3)."""
        return board_grid(self.columns, self.rows, self.square)

    @property
    def text(self) -> str:
        """The board in one word that `parse_board` reads."""
        return f"chessboard:{self.columns}x{self.rows}:{self.square!r}"

    def detect(self, image: Image) -> BoardCorners:
        """Find the whole board; see `Board.detect`."""
        searched = grey8(image)
        # No other flags: with a normalized image the corners are off by 0.2 px, not by 0.02 px.
        size = (self.columns, self.rows)
        found, corners = cv2.findChessboardCornersSB(searched, size, flags=cv2.CALIB_CB_ACCURACY)
        if not found:
            raise self._not_found(searched, "no chessboard")
        grid = np.asarray(corners, np.float64).reshape(self.rows, self.columns, 2)
        grey = grey_levels(image)
        # The search may begin at either end.
        is_ambiguous = (self.columns + self.rows) % 2 == 0
        is_upright = grid[-1, -1, 1] >= grid[0, 0, 1]
        if not (is_upright if is_ambiguous else starts_on_white(grey, grid)):
            grid = grid[::-1, ::-1]
        # Of a board that leaves the image it may take the pattern's outer edge for corners.
        if not are_saddles(grey, grid):
            raise self._not_found(searched, "no whole chessboard")
        spacing = min(
            float(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min()) for axis in (0, 1)
        )
        found_at = grid.reshape(-1, 2)
        saddles = moved_to_saddles(grey, found_at, SADDLE_WINDOW * spacing)
        is_near = np.linalg.norm(saddles - found_at, axis=1) <= MAX_SADDLE_MOVE_PX
        return BoardCorners(self.points, np.where(is_near[:, None], saddles, found_at))

    def _not_found(self, image: npt.NDArray[np.uint8], what: str) -> BoardNotFoundError:
        return BoardNotFoundError(
            f"{what} of {self.columns} x {self.rows} inner corners in the image of "
            f"{image.shape[1]} x {image.shape[0]} px: all of it must be in view with its white "
            "border, sharp, evenly lit, its squares wider than about 10 px; check the numbers "
            "of inner corners, and switch the laser off"
        )

    def draw(self, pixels_a_square: int) -> npt.NDArray[np.uint8]:
        """The board to print, with a white border of one square, shape (H, W)."""
        row, column = np.indices((self.rows + 1, self.columns + 1))
        # The colours that make OpenCV's first corner this board's first one, where it can tell.
        dark = (row + column + self.rows + self.columns) % 2 == 0
        squares = np.where(dark, 0, 255).astype(np.uint8)
        side = (pixels_a_square, pixels_a_square)
        return np.pad(np.kron(squares, np.ones(side, np.uint8)), side[0], constant_values=255)
