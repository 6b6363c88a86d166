"""Calibration of the scanner: lens, laser plane and turning axis, with sigmas and a verdict."""

from depthwarp.scanner.calibration.adjustment import Adjustment, adjust
from depthwarp.scanner.calibration.board_text import parse_board
from depthwarp.scanner.calibration.boards import Board, BoardCorners, BoardNotFoundError
from depthwarp.scanner.calibration.charuco import CharucoBoard
from depthwarp.scanner.calibration.chessboard import Chessboard
from depthwarp.scanner.calibration.intrinsics import Coverage, LensCalibration, calibrate_lens
from depthwarp.scanner.calibration.laser_plane import LaserPlane, calibrate_laser_plane
from depthwarp.scanner.calibration.procedure import (
    BoardShot,
    CalibrationReport,
    LineFinder,
    calibrate,
    calibrate_views,
    observe,
)
from depthwarp.scanner.calibration.store import Residuals, ScannerCalibration, load_calibration
from depthwarp.scanner.calibration.turning_axis import calibrate_turning_axis
from depthwarp.scanner.calibration.verdict import Check, Grade, Verdict, judge
from depthwarp.scanner.calibration.views import BoardView
from depthwarp.scanner.calibration.wall import verify

__all__ = [
    "Adjustment",
    "Board",
    "BoardCorners",
    "BoardNotFoundError",
    "BoardShot",
    "BoardView",
    "CalibrationReport",
    "CharucoBoard",
    "Check",
    "Chessboard",
    "Coverage",
    "Grade",
    "LaserPlane",
    "LensCalibration",
    "LineFinder",
    "Residuals",
    "ScannerCalibration",
    "Verdict",
    "adjust",
    "calibrate",
    "calibrate_laser_plane",
    "calibrate_lens",
    "calibrate_turning_axis",
    "calibrate_views",
    "judge",
    "load_calibration",
    "observe",
    "parse_board",
    "verify",
]
