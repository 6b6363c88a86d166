"""Board views of a known scanner, computed with the reference geometry instead of a camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from depthwarp.scanner.calibration import Board, BoardCorners, Chessboard
from depthwarp.scanner.calibration.turning_axis import head_turned
from depthwarp.scanner.calibration.views import BoardView, keep_on_board, pose_matrix
from depthwarp.scanner.geometry import ScannerGeometry, TurningAxis
from depthwarp.scanner.lens import project

BOARD = Chessboard(11, 8, 0.06)


@dataclass(frozen=True)
class Place:
    """Where a board stands at motor angle 0, in the optical frame.

    Attributes:
        middle: Its middle [m].
        tilt: Turn about X, Y and Z from facing the camera [degrees].
    """

    middle: tuple[float, float, float]
    tilt: tuple[float, float, float]


PLACES = (
    Place((0.00, 0.05, 0.60), (15.0, -25.0, 4.0)),
    Place((0.05, -0.40, 0.80), (30.0, 15.0, -5.0)),
    Place((-0.10, 0.45, 0.85), (-30.0, -10.0, 8.0)),
    Place((0.00, 0.70, 1.20), (-20.0, 25.0, 0.0)),
    Place((-0.20, -0.80, 1.30), (15.0, -30.0, -3.0)),
    Place((-0.30, 0.00, 1.90), (25.0, 20.0, 5.0)),
    Place((-0.20, 0.30, 2.80), (-25.0, -20.0, 0.0)),
)
ANGLES = (-25.0, -20.0, -15.0, -10.0, -5.0, 0.0, 5.0, 10.0, 15.0, 20.0, 25.0)


def tilted(geometry: ScannerGeometry) -> ScannerGeometry:
    """The scanner with the small crookedness of a real one: axis and plane not quite upright."""
    normal = np.array(geometry.plane_normal) + [0.004, 0.012, -0.003]
    up = np.array([0.008, -1.0, -0.015])
    up /= np.linalg.norm(up)
    point = np.array([0.497, 0.0, 0.021])
    point -= (point @ up) * up
    return replace(
        geometry,
        plane_normal=tuple(normal / np.linalg.norm(normal)),
        plane_distance=geometry.plane_distance * 1.006,
        axis=TurningAxis(tuple(up), tuple(point)),
    )


def board_at(place: Place, board: Board = BOARD) -> np.ndarray:
    """`optical_from_board` of a place at motor angle 0, shape (4, 4)."""
    turn = np.eye(4)
    for axis, degrees in zip(np.eye(3), place.tilt, strict=True):
        turn = turn @ pose_matrix(np.radians(degrees) * axis, np.zeros(3))
    turn[:3, 3] = np.array(place.middle) - turn[:3, :3] @ board.points.mean(axis=0)
    return turn


def see(
    geometry: ScannerGeometry,
    rng: np.random.Generator,
    *,
    places: Sequence[Place] = PLACES,
    angles: Sequence[float] = ANGLES,
    noise_px: float = 0.1,
    board: Board = BOARD,
) -> list[BoardView]:
    """All views that show the whole board, with the laser line where it crosses it."""
    views = []
    axis = geometry.axis
    for number, place in enumerate(places):
        for angle in angles:
            turned = head_turned(np.array(axis.direction), np.array(axis.point), angle)
            pose = turned @ board_at(place, board)
            points = board.points @ pose[:3, :3].T + pose[:3, 3]
            pixels = project(geometry.lens, points)
            low, high = pixels.min(axis=0), pixels.max(axis=0)
            if not ((low > 5).all() and (high < np.array(geometry.lens.size) - 6).all()):
                continue
            corners = BoardCorners(board.points, pixels + rng.normal(0, noise_px, pixels.shape))
            laser = laser_on(geometry, pose, corners)
            laser[:, 0] += rng.normal(0, noise_px, len(laser))
            views.append(BoardView(corners, laser, noise_px or 0.1, angle, number))
    return views


def laser_on(geometry: ScannerGeometry, pose: np.ndarray, corners: BoardCorners) -> np.ndarray:
    """The laser peaks of all rows on a board between its corners, shape (M, 2), exact to 1e-6 px.

    The line is where the laser plane cuts the board, seen through the lens at whole rows.
    """
    laser, board = np.array(geometry.plane_normal), pose[:3, 2]
    along = np.cross(laser, board)
    along *= -np.sign(along[1]) / np.linalg.norm(along)
    middle = pose[:3, 3] + pose[:3, :3] @ corners.points_board.mean(axis=0)
    start, *_ = np.linalg.lstsq(
        np.stack([laser, board, along]),
        np.array([geometry.plane_distance, board @ pose[:3, 3], along @ middle]),
    )
    line = start + np.linspace(0.6, -0.6, 4000)[:, None] * along
    u, v = project(geometry.lens, line).T
    rows = np.arange(np.ceil(corners.pixels[:, 1].min()), corners.pixels[:, 1].max())
    return keep_on_board(np.column_stack([np.interp(rows, v, u), rows]), corners)
