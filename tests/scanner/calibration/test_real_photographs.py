"""The real green line on a real board: five photographs that anybody's scanner could have taken."""

from __future__ import annotations

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

BOARD = Chessboard(8, 6, 0.04)


@pytest.fixture(scope="module")
def photographs(shared_data: Path) -> list[np.ndarray]:
    folder = shared_data.parent / "laser_images" / "hjamal3+Light-Stripe-Calibration"
    if not folder.is_dir():
        pytest.skip(f"no photographs on this machine: there is no folder {folder}")
    return [np.asarray(cv2.imread(str(path))) for path in sorted(folder.glob("?_right.jpg"))]


def green_peaks(image: np.ndarray) -> np.ndarray:
    """Centre of gravity of the green excess around its maximum in each row, shape (M, 2)."""
    blue, green, red = np.moveaxis(image.astype(np.float64), 2, 0)
    excess = np.maximum(2 * green - red - blue, 0)
    peaks = []
    for row, middle in enumerate(cv2.GaussianBlur(excess, (0, 0), 1.5).argmax(axis=1)):
        low, high = max(middle - 4, 0), middle + 5
        weight = excess[row, low:high]
        if weight.max() > 25:
            peaks.append((np.average(np.arange(low, low + len(weight)), weights=weight), row))
    return np.array(peaks).reshape(-1, 2)


def test_laser_plane_of_the_photographs_is_flat_to_a_third_of_a_millimetre(
    photographs: list[np.ndarray],
):
    """Board, lens and plane from real pictures: plane residual at most 0.3 mm."""
    views = []
    for image in photographs:
        try:
            corners = BOARD.detect(image)
        except BoardNotFoundError:
            continue
        views.append(BoardView(corners, keep_on_board(green_peaks(image), corners)))
    assert len(views) >= 5
    height, width = photographs[0].shape[:2]
    fit = calibrate_lens([view.corners for view in views], (width, height))
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
