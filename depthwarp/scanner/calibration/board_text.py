"""A board in one word, as options and files have it."""

from __future__ import annotations

from depthwarp.errors import InputError
from depthwarp.scanner.calibration.boards import Board
from depthwarp.scanner.calibration.charuco import CharucoBoard
from depthwarp.scanner.calibration.chessboard import Chessboard

__all__ = ["parse_board"]


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
