"""What a calibration starts from: boards seen by the camera, some with the laser on them."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError
from depthwarp.scanner.calibration.boards import BoardCorners
from depthwarp.scanner.geometry import Lens
from depthwarp.scanner.lens import undistort

__all__ = [
    "BoardView",
    "board_pose",
    "keep_on_board",
    "on_board",
    "place_name",
    "pose_matrix",
    "rays_on_board",
    "rotation",
]

Float64Array = npt.NDArray[np.float64]


def _no_pixels() -> Float64Array:
    return np.empty((0, 2))


@dataclass(frozen=True, eq=False)
class BoardView:
    """One view of the board.

    Attributes:
        corners: The corners found with the laser off.
        laser_pixels: Peaks of the laser line on the board, (u, v) [px], shape (M, 2); may be none.
        laser_sigma_px: Standard deviation of their columns [px].
        angle_deg: Motor angle as reported [degrees].
        placement: Number of the place where the board stood; views of one placement show the
            board standing still while the head turned.

    Raises:
        InputError: Shapes that do not fit, or numbers that are not finite.
    """

    corners: BoardCorners
    laser_pixels: Float64Array = field(default_factory=_no_pixels)
    laser_sigma_px: float = 0.1
    angle_deg: float = 0.0
    placement: int = 0

    def __post_init__(self) -> None:
        shape = self.laser_pixels.shape
        if len(shape) != 2 or shape[1] != 2 or not np.isfinite(self.laser_pixels).all():
            raise InputError(f"laser_pixels must be finite with shape (M, 2), got shape {shape}")
        if not (np.isfinite(self.angle_deg) and self.laser_sigma_px > 0):
            raise InputError(
                f"angle_deg must be finite and laser_sigma_px above 0, got {self.angle_deg} and "
                f"{self.laser_sigma_px}"
            )


def place_name(placement: int) -> str:
    """What people read of a placement: they count the board's places from 1."""
    return f"place {placement + 1} of the board"


def keep_on_board(pixels: Float64Array, corners: BoardCorners) -> Float64Array:
    """The pixels (u, v), shape (M, 2), that lie between the board's found corners.

    The line goes on over the wall behind; only between the corners is the surface known.
    """
    outline = cv2.convexHull(corners.pixels.astype(np.float32))
    inside = [
        cv2.pointPolygonTest(outline, (float(u), float(v)), measureDist=False) > 0
        for u, v in pixels
    ]
    return pixels[np.flatnonzero(inside)]


def rotation(vector: npt.ArrayLike) -> Float64Array:
    """Rotation matrix of a rotation vector [rad], shape (3, 3)."""
    matrix, _ = cv2.Rodrigues(np.asarray(vector, np.float64))
    return np.asarray(matrix, np.float64)


def pose_matrix(rotation_vector: npt.ArrayLike, translation: npt.ArrayLike) -> Float64Array:
    """A rigid motion as a matrix, shape (4, 4), column vectors."""
    matrix = np.eye(4)
    matrix[:3, :3] = rotation(rotation_vector)
    matrix[:3, 3] = np.ravel(np.asarray(translation, np.float64))
    return matrix


def board_pose(corners: BoardCorners, lens: Lens) -> Float64Array:
    """Where a board stands, `optical_from_board`, shape (4, 4) [m].

    Raises:
        InputError: The corners fit no pose in front of the camera.
    """
    rays = undistort(lens, corners.pixels)
    good = np.isfinite(rays).all(axis=1)
    if good.sum() >= 6:
        found, turn, shift = cv2.solvePnP(
            corners.points_board[good], rays[good], np.eye(3), np.zeros(5), flags=cv2.SOLVEPNP_IPPE
        )
        if found and float(np.ravel(shift)[2]) > 0:
            turn, shift = cv2.solvePnPRefineLM(
                corners.points_board[good], rays[good], np.eye(3), np.zeros(5), turn, shift
            )
            return pose_matrix(turn, shift)
    raise InputError(
        f"{int(good.sum())} of {len(rays)} board corners fit the lens, and they give no pose: "
        "the lens belongs to another camera, or the corners are wrong"
    )


def on_board(lens: Lens, optical_from_board: Float64Array, pixels: Float64Array) -> Float64Array:
    """Where the rays of pixels meet the board, optical frame [m], shape (M, 3); NaN where not."""
    return rays_on_board(undistort(lens, pixels), optical_from_board)


def rays_on_board(rays: Float64Array, optical_from_board: Float64Array) -> Float64Array:
    """Where undistorted rays (x', y'), shape (M, 2), meet the board, see `on_board`."""
    straight = np.column_stack([rays, np.ones(len(rays))])
    normal, origin = optical_from_board[:3, 2], optical_from_board[:3, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = (normal @ origin) / (straight @ normal)
    return np.where((depth > 0)[:, None], depth[:, None] * straight, np.nan)
