"""What a calibration board is: a flat pattern of known size, and how its corners are handed on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError

__all__ = [
    "Board",
    "BoardCorners",
    "BoardNotFoundError",
    "Image",
    "board_grid",
    "check_sides",
    "grey8",
]

Float64Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


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


def board_grid(columns: int, rows: int, square: float) -> Float64Array:
    """The inner corners of a board [m], row by row, shape (N, 3)."""
    row, column = np.indices((rows, columns))
    points = np.zeros((row.size, 3))
    points[:, 0], points[:, 1] = column.ravel() * square, row.ravel() * square
    return points


def check_sides(what: str, columns: int, rows: int) -> None:
    """Refuse sides that make no board.

    Raises:
        InputError: Fewer than 3 or more than 100 a side.
    """
    if not (3 <= columns <= 100 and 3 <= rows <= 100):
        raise InputError(f"a board must have 3 to 100 {what} a side, got {columns} x {rows}")


def grey8(image: Image) -> npt.NDArray[np.uint8]:
    """An image as 8 bit grey, deeper ones stretched to their brightest pixel.

    Raises:
        InputError: Not an image.
    """
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
