"""The real green line on a real board: five photographs that anybody's scanner could have taken."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from depthwarp.scanner.calibration import (
    BoardNotFoundError,
    BoardView,
    Chessboard,
    calibrate_laser_plane,
    calibrate_lens,
)
from depthwarp.scanner.calibration.views import keep_on_board
from depthwarp.scanner.frames import Frame, PixelFormat
from depthwarp.scanner.laser import ColorTable, LineFinder, fit_lit

BOARD = Chessboard(8, 6, 0.04)


@pytest.fixture(scope="module")
def photographs(shared_data: Path) -> list[np.ndarray]:
    folder = shared_data.parent / "laser_images" / "hjamal3+Light-Stripe-Calibration"
    if not folder.is_dir():
        pytest.skip(f"no photographs on this machine: there is no folder {folder}")
    return [np.asarray(cv2.imread(str(path))) for path in sorted(folder.glob("?_right.jpg"))]


def test_laser_plane_of_the_photographs_is_flat_to_a_third_of_a_millimetre(
    photographs: list[np.ndarray],
):
    """Board, lens, line finder and plane on real pictures: plane residual at most 0.3 mm."""
    frames = [
        Frame(image, PixelFormat.BGR, 8, math.nan, math.nan, 0, None, number)
        for number, image in enumerate(photographs)
    ]
    size = (photographs[0].shape[1], photographs[0].shape[0])
    finder = LineFinder(ColorTable(fit_lit(frames, "green")), size, PixelFormat.BGR)
    views = []
    for frame in frames:
        try:
            corners = BOARD.detect(frame.pixels)
        except BoardNotFoundError:
            continue
        line = finder.find(frame)
        peaks = np.column_stack([line.columns, line.rows.astype(np.float64)])
        views.append(BoardView(corners, keep_on_board(peaks, corners)))
    assert len(views) >= 5
    fit = calibrate_lens([view.corners for view in views], size)
    plane = calibrate_laser_plane(views, fit.lens, fit.poses)
    print(
        f"{len(views)} boards, corners {fit.rms_px:.3f} px; plane {1e3 * plane.rms_m:.3f} mm from "
        f"{plane.inliers.sum()} of {len(plane.inliers)} peaks, {plane.nearest_m:.2f} to "
        f"{plane.farthest_m:.2f} m, baseline {1e3 * plane.baseline_m:.1f} mm, toe-in "
        f"{plane.toe_in_deg:.3f} degrees"
    )
    assert fit.rms_px < 0.25
    assert plane.rms_m <= 0.3e-3
    assert plane.inliers.mean() > 0.9
    assert plane.baseline_m == pytest.approx(-0.0394, abs=0.002)  # the laser is on the left
