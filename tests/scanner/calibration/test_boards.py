"""Boards: drawn, seen from the side, and found again where they are."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.calibration import (
    Board,
    BoardNotFoundError,
    CharucoBoard,
    Chessboard,
    parse_board,
)

CHESSBOARD = Chessboard(9, 6, 0.04)
CHARUCO = CharucoBoard(10, 7, 0.04, 0.03)
SIZE = (640, 500)


def homography(turn_degrees: float) -> np.ndarray:
    """From squares of a 9 x 6 board to pixels: 40 px a square, seen from the side and turned."""
    cos, sin = np.cos(np.radians(turn_degrees)), np.sin(np.radians(turn_degrees))
    turn = 40 * np.array([[cos, -sin], [sin, cos]])
    matrix = np.eye(3)
    matrix[:2, :2] = turn
    matrix[:2, 2] = np.array([320, 250]) - turn @ [4, 2.5]
    return np.array([[1, 0, 0], [0, 1, 0], [2e-4, -1e-4, 1]]) @ matrix


def photograph(board: Board, to_pixels: np.ndarray) -> np.ndarray:
    """The board as a camera would average it, four by four samples a pixel."""
    drawn, samples = 60, 4
    from_squares = np.array([[drawn, 0, 2 * drawn - 0.5], [0, drawn, 2 * drawn - 0.5], [0, 0, 1.0]])
    middle = (samples - 1) / 2
    fine = np.array([[samples, 0, middle], [0, samples, middle], [0, 0, 1.0]])
    picture = cv2.warpPerspective(
        board.draw(drawn),
        fine @ to_pixels @ np.linalg.inv(from_squares),
        (SIZE[0] * samples, SIZE[1] * samples),
        borderValue=(200,),
    )
    return np.asarray(cv2.resize(picture, SIZE, interpolation=cv2.INTER_AREA))


def error_px(board: Board, turn_degrees: float, image: np.ndarray | None = None) -> np.ndarray:
    to_pixels = homography(turn_degrees)
    found = board.detect(photograph(board, to_pixels) if image is None else image)
    squares = np.column_stack([found.points_board[:, :2] / 0.04, np.ones(len(found.pixels))])
    expected = squares @ to_pixels.T
    return found.pixels - expected[:, :2] / expected[:, 2:]


@pytest.mark.parametrize("board", [CHESSBOARD, CHARUCO], ids=["chessboard", "charuco"])
@pytest.mark.parametrize("turn", [12.0, -25.0, 170.0])
def test_corners_are_found_where_they_are(board: Board, turn: float):
    """Also upside down each corner keeps its place on the board; no half-pixel shift."""
    error = error_px(board, turn)
    print(f"RMS {np.sqrt(np.mean(error**2)):.3f} px, mean {error.mean(axis=0).round(3)}")
    assert len(error) == 54
    assert np.sqrt(np.mean(error**2)) < 0.04
    assert np.abs(error.mean(axis=0)).max() < 0.02


def test_a_board_that_looks_the_same_upside_down_is_read_from_above():
    """With 8 x 6 inner corners the first corner is the upper one, whichever way it hangs."""
    board = Chessboard(8, 6, 0.04)
    for turn in (5.0, 185.0):
        found = board.detect(photograph(board, homography(turn)))
        assert found.pixels[0, 1] < found.pixels[-1, 1]
        x_axis = found.pixels[7] - found.pixels[0]
        y_axis = found.pixels[-8] - found.pixels[0]
        assert x_axis[0] * y_axis[1] - x_axis[1] * y_axis[0] > 0  # not mirrored


def test_half_a_charuco_board_is_enough_but_half_a_chessboard_is_not():
    """Markers tell which corners are seen."""
    half = photograph(CHARUCO, homography(10.0))
    half[:, :280] = 200
    error = error_px(CHARUCO, 10.0, half)
    assert 8 <= len(error) < 40
    assert np.sqrt(np.mean(error**2)) < 0.06
    cut = photograph(CHESSBOARD, homography(10.0))
    cut[:, :280] = 200
    with pytest.raises(BoardNotFoundError, match="no chessboard of 9 x 6 inner corners"):
        CHESSBOARD.detect(cut)


@pytest.mark.parametrize("board", [CHESSBOARD, CHARUCO], ids=["chessboard", "charuco"])
def test_colour_and_16_bit_images_show_the_same_board(board: Board):
    """BGR and deep grey images are brought to 8 bit grey."""
    grey = photograph(board, homography(12.0))
    expected = board.detect(grey).pixels
    np.testing.assert_allclose(board.detect(np.dstack([grey] * 3)).pixels, expected, atol=0.02)
    deep = grey.astype(np.uint16) * 16
    np.testing.assert_allclose(board.detect(deep).pixels, expected, atol=0.05)


@pytest.mark.parametrize("board", [CHESSBOARD, CHARUCO], ids=["chessboard", "charuco"])
def test_an_image_without_the_board_says_what_to_do(board: Board):
    """Nothing, black and noise: not found, never a crash."""
    rng = np.random.default_rng(0)
    for image in (np.zeros((120, 160), np.uint8), rng.integers(0, 256, (120, 160), np.uint8)):
        with pytest.raises(BoardNotFoundError, match="160 x 120 px.*switch the laser off"):
            board.detect(image)
    with pytest.raises(InputError, match="an image must be uint8 or uint16"):
        board.detect(np.zeros((120, 160)))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "board", [CHESSBOARD, CHARUCO, CharucoBoard(5, 4, 0.1, 0.07, "DICT_4X4_50")]
)
def test_the_word_for_a_board_reads_back(board: Board):
    """`text` and `parse_board` are inverse."""
    assert parse_board(board.text) == board


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "a board must be given as"),
        ("checker:8x6:0.04", "got 'checker:8x6:0.04'"),
        ("chessboard:8:0.04", "a board must be given as"),
        ("chessboard:8x6:zero", "a board must be given as"),
        ("chessboard:8x6:-1", "square must be a finite number above 0"),
        ("chessboard:6x6:0.04", "looks the same when turned"),
        ("chessboard:2x6:0.04", "3 to 100 inner corners"),
        ("charuco:11x8:0.06:0.07", "marker must be smaller than square"),
        ("charuco:11x8:0.06:0.04:DICT_NONE", "unknown dictionary 'DICT_NONE'"),
        ("charuco:30x20:0.06:0.04:DICT_4X4_50", "holds 50 markers, this board needs 300"),
    ],
)
def test_boards_that_cannot_be_are_refused(text: str, message: str):
    """The message shows the form, or the number that is wrong."""
    with pytest.raises(InputError, match=message):
        parse_board(text)
