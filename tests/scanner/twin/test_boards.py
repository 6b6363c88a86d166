"""Printed boards: OpenCV finds them in rendered frames, with the corners where they truly are."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.frames import PixelFormat
from depthwarp.scanner.geometry import reference_geometry
from depthwarp.scanner.twin import (
    Board,
    Scene,
    Sensor,
    Shot,
    TwinRenderer,
    board_pose,
    charuco,
    chessboard,
    wall_scene,
)

HALF = reference_geometry(0.5)
POSES = [((1.0, 0.4, 0.0), (0.0, 0.5, 0.0), 0.0), ((1.0, 0.5, 0.0), (0.0, 0.6, 0.2), 12.0)]
SENSOR = Sensor(PixelFormat.BGR, read_noise=1.0)


def picture(board: Board) -> tuple[np.ndarray, np.ndarray]:
    """A grey picture of a board before a wall, and where its corners truly are [px]."""
    scene = Scene(wall_scene(4.0).room, (board,))
    renderer = TwinRenderer(scene, HALF, sensor=SENSOR)
    frame = renderer.render(Shot(0.0, False, 18_000.0))
    return cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY), renderer.project(board.corners_world, 0.0)


@pytest.mark.parametrize(("center", "toward", "roll"), POSES)
def test_chessboard_corners(center: tuple, toward: tuple, roll: float) -> None:
    """OpenCV's chessboard search finds every corner within a tenth of a pixel."""
    grey, true = picture(chessboard(8, 5, 0.06, board_pose(center, toward, roll=roll)))
    found, corners = cv2.findChessboardCornersSB(grey, (8, 5))
    assert found
    corners = corners.reshape(-1, 2)
    if np.linalg.norm(corners[0] - true[0]) > 10.0:
        corners = corners[::-1]  # the search may start at either end
    error = corners - true
    assert np.sqrt((error**2).sum(axis=1).mean()) < 0.1
    # The saddle points themselves: no shift of the print or of the pixels' middles.
    start = true.astype(np.float32).reshape(-1, 1, 2)
    saddles = cv2.cornerSubPix(grey, start, (4, 4), (-1, -1), (3, 100, 1e-5)).reshape(-1, 2)
    assert np.abs((saddles - true).mean(axis=0)).max() < 0.02
    assert np.abs(saddles - true).max() < 0.1


@pytest.mark.parametrize(("center", "toward", "roll"), POSES)
def test_charuco_corners(center: tuple, toward: tuple, roll: float) -> None:
    """OpenCV's ChArUco detector finds and names every corner within a tenth of a pixel."""
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    pattern = cv2.aruco.CharucoBoard((7, 5), 0.08, 0.06, dictionary)
    grey, true = picture(charuco(pattern, board_pose(center, toward, roll=roll)))
    corners, names, _, _ = cv2.aruco.CharucoDetector(pattern).detectBoard(grey)
    names = np.asarray(names, dtype=np.int64).ravel()
    assert sorted(names) == list(range(24))
    error = np.asarray(corners).reshape(-1, 2) - true[names]
    assert np.sqrt((error**2).sum(axis=1).mean()) < 0.1
    assert np.abs(error.mean(axis=0)).max() < 0.03


def test_board_looks_where_it_is_told() -> None:
    """The print looks at the point, its upper edge is level, and its size is squares and rim."""
    board = chessboard(4, 3, 0.05, board_pose((2.0, 1.0, 0.5), (0.0, 1.0, 0.5)), margin=0.025)
    assert board.size == pytest.approx((0.3, 0.25))
    np.testing.assert_allclose(board.center_world, [2.0, 1.0, 0.5], atol=1e-12)
    corners = board.corners_world.reshape(3, 4, 3)
    np.testing.assert_allclose(corners[..., 0], 2.0, atol=1e-12)
    assert (np.diff(corners[..., 2], axis=0) < 0).all()  # rows run downwards
    assert (np.diff(corners[..., 1], axis=1) < 0).all()  # seen from the origin, to the right
    np.testing.assert_allclose(corners.mean(axis=(0, 1)), [2.0, 1.0, 0.5], atol=1e-12)


def test_back_of_a_board_is_blank() -> None:
    """Seen from behind, a board is plain paper."""
    board = chessboard(8, 5, 0.06, board_pose((1.0, 0.5, 0.0), (3.0, 0.5, 0.0)))
    scene = Scene(wall_scene(4.0).room, (board,))
    renderer = TwinRenderer(scene, HALF, sensor=SENSOR.quiet())
    frame = renderer.render(Shot(0.0, False, 18_000.0))
    column, row = renderer.project(board.center_world[None], 0.0)[0].round().astype(int)
    assert np.ptp(frame[row - 60 : row + 60, column - 60 : column + 60], axis=(0, 1)).max() == 0


def test_bad_boards_are_refused() -> None:
    """Boards without corners, size, or direction, and poses that are not rigid, are refused."""
    pose = board_pose((1.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    for make, words in (
        (lambda: chessboard(1, 5, 0.06, pose), "inner corners"),
        (lambda: chessboard(8, 5, 0.0, pose), "square"),
        (lambda: chessboard(8, 5, 0.06, pose, margin=-1.0), "margin"),
        (lambda: chessboard(8, 5, 0.06, np.eye(3)), "pose"),
        (lambda: chessboard(8, 5, 0.06, 2 * pose), "rotation"),
        (lambda: board_pose((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)), "what is up"),
    ):
        with pytest.raises(InputError, match=words):
            make()
