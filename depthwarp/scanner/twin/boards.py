"""Flat printed boards in the twin's scene: chessboards and ChArUco boards for calibration."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from depthwarp.checks import check_finite_vector, check_positive
from depthwarp.errors import InputError
from depthwarp.scanner.geometry import Vector3

__all__ = ["Board", "board_pose", "charuco", "chessboard"]

Float64Array = npt.NDArray[np.float64]

TEXELS_A_SQUARE = 64
PAPER, INK = 225, 20
"""Reflectance of white paper and of black print, of 255."""


@dataclass(frozen=True, eq=False)
class Board:
    """A flat board without thickness, printed on one side, that stands anywhere in the world.

    The board frame is that of OpenCV's boards: origin at the pattern's upper left corner, X right
    and Y down as one looks at the print, Z into the board.

    Attributes:
        print: Reflectance, shape (H, W), uint8, row 0 on top; the other side is paper.
        size: (width, height) of the board [m], margins included.
        margin: White rim around the pattern [m].
        corners: The pattern's inner corners, board frame [m], shape (N, 3), in OpenCV's order.
        world_from_board: Rigid transform, shape (4, 4).
    """

    print: npt.NDArray[np.uint8]
    size: tuple[float, float]
    margin: float
    corners: Float64Array
    world_from_board: Float64Array

    def __post_init__(self) -> None:
        pose = np.asarray(self.world_from_board)
        if pose.shape != (4, 4) or not np.all(np.isfinite(pose)):
            raise InputError(f"world_from_board must be a finite (4, 4) matrix, got {pose.shape}")
        turn = pose[:3, :3]
        if np.abs(turn @ turn.T - np.eye(3)).max() > 1e-6 or np.linalg.det(turn) < 0:
            raise InputError("world_from_board must be a rotation and a shift, without scale")

    @property
    def center_world(self) -> Float64Array:
        """The board's middle, world frame [m], shape (3,)."""
        middle = np.array([*self.size, 0.0]) / 2 - [self.margin, self.margin, 0.0]
        return self._to_world(middle)

    @property
    def corners_world(self) -> Float64Array:
        """The pattern's inner corners, world frame [m], shape (N, 3)."""
        return self._to_world(self.corners)

    def _to_world(self, points: Float64Array) -> Float64Array:
        pose = np.asarray(self.world_from_board, dtype=np.float64)
        return np.asarray(points @ pose[:3, :3].T + pose[:3, 3])


def chessboard(
    columns: int, rows: int, square: float, pose: Float64Array, *, margin: float | None = None
) -> Board:
    """A chessboard with `columns` x `rows` inner corners, as OpenCV counts them.

    Args:
        columns: Inner corners in a row.
        rows: Inner corners in a column.
        square: Edge of a square [m].
        pose: Where the board's middle stands, from `board_pose`.
        margin: White rim [m], by default one square.

    Raises:
        InputError: Fewer than 2 x 2 corners, or lengths that are not positive.
    """
    if columns < 2 or rows < 2:
        raise InputError(f"a chessboard needs 2 x 2 inner corners or more, got {columns} x {rows}")
    across, down = np.arange(columns + 1), np.arange(rows + 1)
    cells = np.where((across[None] + down[:, None]) % 2 == 0, 0, 255).astype(np.uint8)
    picture = np.kron(cells, np.ones((TEXELS_A_SQUARE, TEXELS_A_SQUARE), np.uint8))
    x, y = np.meshgrid(np.arange(1, columns + 1), np.arange(1, rows + 1))
    corners = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3).astype(np.float64)
    return _printed(picture, corners * square, square, pose, margin)


def charuco(
    board: cv2.aruco.CharucoBoard, pose: Float64Array, *, margin: float | None = None
) -> Board:
    """The print of one of OpenCV's ChArUco boards, whose lengths are taken as metres.

    Args:
        board: Squares, markers and dictionary.
        pose: Where the board's middle stands, from `board_pose`.
        margin: White rim [m], by default one square.
    """
    across, down = board.getChessboardSize()
    texels = (across * TEXELS_A_SQUARE, down * TEXELS_A_SQUARE)
    picture = np.asarray(board.generateImage(texels), dtype=np.uint8)
    corners = np.asarray(board.getChessboardCorners(), dtype=np.float64).reshape(-1, 3)
    return _printed(picture, corners, board.getSquareLength(), pose, margin)


def board_pose(center: Vector3, toward: Vector3, *, roll: float = 0.0) -> Float64Array:
    """A pose for a board's middle whose printed side looks at a point.

    Args:
        center: The board's middle, world frame [m].
        toward: Where the print looks to, world frame [m].
        roll: Turn about the direction in which the print looks, clockwise for who looks at it
            [degrees]; at 0 the upper edge is level.

    Returns:
        Rigid transform of a frame in the board's middle, X right, Y down, Z into the board,
        shape (4, 4).

    Raises:
        InputError: Both are one point, or the print would look straight up or down.
    """
    middle = np.array(check_finite_vector("center", center, 3))
    into = middle - np.array(check_finite_vector("toward", toward, 3))
    level = np.cross(into, [0.0, 0.0, 1.0])
    if np.linalg.norm(level) < 1e-9:
        raise InputError(f"a board at {center} cannot look at {toward}: nothing says what is up")
    z, x = into / np.linalg.norm(into), level / np.linalg.norm(level)
    y = np.cross(z, x)
    cos, sin = math.cos(math.radians(roll)), math.sin(math.radians(roll))
    pose = np.eye(4)
    pose[:3, :3] = np.stack([cos * x + sin * y, cos * y - sin * x, z], axis=1)
    pose[:3, 3] = middle
    return pose


def _printed(
    picture: npt.NDArray[np.uint8],
    corners: Float64Array,
    square: float,
    world_from_middle: Float64Array,
    margin: float | None,
) -> Board:
    """A board from its pattern in black (0) and white (255) and the pose of its middle."""
    check_positive("square", square, "m")
    rim = square if margin is None else margin
    if not 0 <= rim < math.inf:
        raise InputError(f"margin must be a finite number, at least 0, got {margin}")
    texels = round(rim / square * TEXELS_A_SQUARE)
    rim = texels / TEXELS_A_SQUARE * square  # whole texels, so that the print is to scale
    framed = np.pad(picture, texels, constant_values=255)
    ink = (INK + framed.astype(np.uint16) * (PAPER - INK) // 255).astype(np.uint8)
    height, width = framed.shape
    size = (width / TEXELS_A_SQUARE * square, height / TEXELS_A_SQUARE * square)
    middle_from_board = np.eye(4)
    middle_from_board[:2, 3] = rim - size[0] / 2, rim - size[1] / 2
    pose = np.asarray(world_from_middle, dtype=np.float64)
    if pose.shape != (4, 4):
        raise InputError(f"pose must be a (4, 4) matrix, got shape {pose.shape}")
    return Board(ink, size, rim, corners, pose @ middle_from_board)
