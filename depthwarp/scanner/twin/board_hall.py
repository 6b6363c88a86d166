"""Where a calibration board is put up, and a hall in which the twin puts it up by itself."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from depthwarp.errors import InputError
from depthwarp.scanner.calibration import Board as BoardPattern
from depthwarp.scanner.calibration import CharucoBoard, Chessboard
from depthwarp.scanner.geometry import ScannerGeometry
from depthwarp.scanner.twin.boards import Board, board_pose, charuco, chessboard
from depthwarp.scanner.twin.optics import Sensor
from depthwarp.scanner.twin.renderer import TwinRenderer
from depthwarp.scanner.twin.scene import Scene, wall_scene

__all__ = ["BOARD_PLACES", "BoardPlace", "board_renderer"]

HALL_M = 14.0
"""Distance of the hall's grey wall [m]."""

WIDE_TURNS = (20.0, 35.0, 50.0)
"""Angles beside those at which the laser is on the board: they are for the axis [degrees]."""


@dataclass(frozen=True)
class BoardPlace:
    """A place for the board, such that the laser meets its middle when the head is at 0 degrees.

    Attributes:
        distance: From the turning axis [m].
        height: Above the camera [m].
        yaw: Turn of the board about the vertical away from facing the head [degrees].
        pitch: Up to where the print looks [degrees].
        roll: Turn of the board in its own plane [degrees].
    """

    distance: float
    height: float = 0.0
    yaw: float = 0.0
    pitch: float = 0.0
    roll: float = 0.0

    def angles(self, board_width: float) -> tuple[float, ...]:
        """Stops of the head [degrees]: four with the laser on the board, then the wide ones.

        The laser runs near the image's left edge, where the board would leave the image: it
        wanders over the left half of the board only, past its edges from square to square.
        """
        half = math.degrees(math.atan2(0.42 * board_width, self.distance))
        return (*(half * k for k in (0.15, 0.44, 0.74, 1.03)), *WIDE_TURNS)


BOARD_PLACES = (
    BoardPlace(1.3, roll=8.0),
    BoardPlace(1.6, 0.9, 20.0, -20.0, 5.0),
    BoardPlace(1.6, -0.9, -20.0, 20.0, -5.0),
    BoardPlace(4.0, 0.3, 10.0, 0.0, 8.0),
    BoardPlace(2.0, 0.2, 35.0, 10.0, 10.0),
    BoardPlace(2.0, -0.2, -35.0, -10.0, -10.0),
    BoardPlace(3.0, 1.8, -10.0, -25.0, -8.0),
    BoardPlace(3.0, -1.8, 10.0, 25.0, 8.0),
    BoardPlace(1.8, 0.0, 0.0, 30.0, 85.0),
    BoardPlace(5.0, -0.5, -10.0, 0.0, -8.0),
    BoardPlace(1.2, 0.4, 10.0, -35.0, -5.0),
    BoardPlace(5.5, 1.5, 0.0, -15.0, 8.0),
    BoardPlace(2.3, 1.5, -15.0, -30.0, 15.0),
    BoardPlace(2.3, -1.5, 15.0, 30.0, -15.0),
    BoardPlace(6.5, 0.0, 10.0, 0.0, -8.0),
    BoardPlace(6.5, -2.0, -10.0, 15.0, 8.0),
)
"""Near and far, at the top and bottom of the line, tilted each way; any first few are a mixture.
All are rolled a little, so that the line does not follow an edge of the squares."""


def board_renderer(
    geometry: ScannerGeometry,
    pattern: BoardPattern,
    place: BoardPlace,
    *,
    sensor: Sensor | None = None,
    seed: int = 0,
    device: str | None = None,
) -> TwinRenderer:
    """A twin's renderer in a hall in which a board has been put up.

    Args:
        geometry: The scanner, which stands in the world's origin.
        pattern: The board.
        place: Where it stands.
        sensor: See `TwinRenderer`.
        seed: See `TwinRenderer`.
        device: See `TwinRenderer`.

    Raises:
        InputError: A kind of board that the twin cannot print.
    """
    board = _printed(geometry, pattern, place)
    scene = Scene(wall_scene(HALL_M, (130, 130, 130)).room, (board,))
    return TwinRenderer(scene, geometry, sensor=sensor, seed=seed, device=device)


def _printed(geometry: ScannerGeometry, pattern: BoardPattern, place: BoardPlace) -> Board:
    azimuth = _laser_azimuth(geometry)
    center = (
        place.distance * math.cos(azimuth),
        place.distance * math.sin(azimuth),
        place.height,
    )
    yaw, pitch = azimuth + math.radians(place.yaw), math.radians(place.pitch)
    looks = (
        -math.cos(pitch) * math.cos(yaw),
        -math.cos(pitch) * math.sin(yaw),
        math.sin(pitch),
    )
    toward = (center[0] + looks[0], center[1] + looks[1], center[2] + looks[2])
    pose = board_pose(center, toward, roll=place.roll)
    if isinstance(pattern, Chessboard):
        return chessboard(pattern.columns, pattern.rows, pattern.square, pose)
    if isinstance(pattern, CharucoBoard):
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, pattern.dictionary))
        size = (pattern.columns, pattern.rows)
        printed = cv2.aruco.CharucoBoard(size, pattern.square, pattern.marker, dictionary)
        return charuco(printed, pose)
    raise InputError(f"the twin prints chessboards and ChArUco boards, not '{pattern.text}'")


def _laser_azimuth(geometry: ScannerGeometry) -> float:
    """Direction of the laser's light in the head's horizontal plane [rad], left positive."""
    normal = geometry.head_from_optical[:3, :3] @ np.asarray(geometry.plane_normal)
    forward = np.array([normal[1], -normal[0]])
    forward *= math.copysign(1.0, forward[0])
    return math.atan2(forward[1], forward[0])
