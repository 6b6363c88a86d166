"""Calibration boards: what they look like, where their corners are, and how they are found."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from depthwarp.checks import check_positive
from depthwarp.errors import InputError
from depthwarp.scanner.calibration.saddles import (
    are_saddles,
    grey_levels,
    moved_to_saddles,
    starts_on_white,
)

__all__ = [
    "Board",
    "BoardCorners",
    "BoardNotFoundError",
    "CharucoBoard",
    "Chessboard",
    "parse_board",
]

Float64Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

SADDLE_WINDOW = 0.4
"""Half the side of the window around a chessboard's corner, as a share of the corners' spacing."""

MAX_SADDLE_MOVE_PX = 0.7
"""A chessboard's corner whose saddle is farther stays: a shadow or a lit line crosses it."""

MIN_CORNERS = 8
"""Fewest corners of a partly seen board that still give a usable pose."""


class BoardNotFoundError(InputError):
    """The board cannot be found in an image: the message says what to change."""


@dataclass(frozen=True, eq=False)
class BoardCorners:
    """The corners of a board that one image shows.

    Attributes:
        points_board: Where they are on the board [m], shape (N, 3), z = 0.
        pixels: Where they are seen, (u, v) [px], shape (N, 2).
    """

    points_board: Float64Array
    pixels: Float64Array

    def __post_init__(self) -> None:
        if self.points_board.shape != (len(self.pixels), 3) or self.pixels.shape[1:] != (2,):
            raise InputError(
                "points_board and pixels must have shapes (N, 3) and (N, 2), got "
                f"{self.points_board.shape} and {self.pixels.shape}"
            )


class Board(Protocol):
    """A flat pattern of known size. Its frame: X along the columns, Y along the rows, Z = 0."""

    @property
    def points(self) -> Float64Array:
        """All inner corners [m], row by row, shape (N, 3)."""
        ...

    @property
    def text(self) -> str:
        """The board in one word that `parse_board` reads."""
        ...

    def detect(self, image: Image) -> BoardCorners:
        """Find the board.

        Args:
            image: Grey or BGR, uint8 or uint16, shape (H, W) or (H, W, 3).

        Raises:
            BoardNotFoundError: It is not there, too dark, too small, blurred or cut off.
            InputError: Not an image.
        """
        ...

    def draw(self, pixels_a_square: int) -> npt.NDArray[np.uint8]:
        """The board to print, with a white border of one square, shape (H, W)."""
        ...


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
        _check_sides("inner corners", self.columns, self.rows)
        check_positive("square", self.square, "metres")
        if self.columns == self.rows:
            raise InputError(
                f"a chessboard of {self.columns} x {self.rows} inner corners looks the same when "
                "turned: use one with different numbers, or a ChArUco board"
            )

    @property
    def points(self) -> Float64Array:
        """All inner corners [m], row by row, shape (N, 3)."""
        return _grid(self.columns, self.rows, self.square)

    @property
    def text(self) -> str:
        """The board in one word that `parse_board` reads."""
        return f"chessboard:{self.columns}x{self.rows}:{self.square!r}"

    def detect(self, image: Image) -> BoardCorners:
        """Find the whole board; see `Board.detect`."""
        searched = _grey8(image)
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
        _check_sides("squares", self.columns, self.rows)
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
        return _grid(self.columns - 1, self.rows - 1, self.square)

    @property
    def text(self) -> str:
        """The board in one word that `parse_board` reads."""
        return (
            f"charuco:{self.columns}x{self.rows}:{self.square!r}:{self.marker!r}:{self.dictionary}"
        )

    def detect(self, image: Image) -> BoardCorners:
        """Find the visible part of the board; see `Board.detect`."""
        grey = _grey8(image)
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


def parse_board(text: str) -> Board:
    """Read a board from one word.

    Args:
        text: `chessboard:8x6:0.04` (inner corners, square [m]) or
            `charuco:11x8:0.06:0.045:DICT_5X5_250` (squares, square [m], marker [m], dictionary).

    Raises:
        InputError: Another form.
    """
    kind, _, rest = text.partition(":")
    parts = rest.split(":")
    try:
        columns, rows = (int(number) for number in parts[0].split("x"))
        if kind == "chessboard" and len(parts) == 2:
            return Chessboard(columns, rows, float(parts[1]))
        if kind == "charuco" and len(parts) in (3, 4):
            return CharucoBoard(columns, rows, float(parts[1]), float(parts[2]), *parts[3:])
    except InputError:
        raise
    except ValueError:
        pass
    raise InputError(
        f"a board must be given as chessboard:8x6:0.04 (inner corners, square in metres) or "
        f"charuco:11x8:0.06:0.045:DICT_5X5_250 (squares, square and marker in metres, dictionary), "
        f"got '{text}'"
    )


def _grid(columns: int, rows: int, square: float) -> Float64Array:
    row, column = np.indices((rows, columns))
    points = np.zeros((row.size, 3))
    points[:, 0], points[:, 1] = column.ravel() * square, row.ravel() * square
    return points


def _check_sides(what: str, columns: int, rows: int) -> None:
    if not (3 <= columns <= 100 and 3 <= rows <= 100):
        raise InputError(f"a board must have 3 to 100 {what} a side, got {columns} x {rows}")


def _on_one_line(points: Float64Array) -> bool:
    return bool(np.linalg.matrix_rank(points[:, :2] - points[0, :2], tol=1e-9) < 2)


def _spacing(pixels: Float64Array) -> float:
    """Median distance of corners (u, v), shape (N, 2), from their nearest neighbours [px]."""
    apart = np.linalg.norm(pixels[:, None] - pixels, axis=2)
    return float(np.median(np.sort(apart, axis=1)[:, 1]))


def _grey8(image: Image) -> npt.NDArray[np.uint8]:
    """An image as 8 bit grey, deeper ones stretched to their brightest pixel."""
    if image.dtype not in (np.uint8, np.uint16) or not (
        image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)
    ):
        raise InputError(
            "an image must be uint8 or uint16 with shape (H, W) or (H, W, 3), got "
            f"{image.dtype} {image.shape}"
        )
    if image.dtype == np.uint16:
        image = (image * (255.0 / max(int(image.max()), 1))).astype(np.uint8)
    if image.ndim == 3:
        image = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
    return np.ascontiguousarray(image, np.uint8)
