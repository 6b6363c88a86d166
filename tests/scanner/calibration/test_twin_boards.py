"""The calibration from the twin's rendered boards, against the twin's true geometry."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from benchmarks.calibration import GeometryErrors, twin_calibrated
from depthwarp.errors import InputError
from depthwarp.scanner.calibration import (
    BoardNotFoundError,
    CalibrationReport,
    CharucoBoard,
    Grade,
    ScannerCalibration,
    parse_board,
)
from depthwarp.scanner.frames import PixelFormat
from depthwarp.scanner.geometry import reference_geometry
from depthwarp.scanner.twin import Sensor, Shot
from depthwarp.scanner.twin.board_hall import BOARD_PLACES, board_renderer

TRUTH = reference_geometry(0.25)
BOARD = parse_board("chessboard:9x6:0.1")


@pytest.fixture(scope="module")
def calibrated() -> tuple[ScannerCalibration, CalibrationReport]:
    return twin_calibrated(TRUTH, BOARD, 6)


def test_plane_and_axis_come_out_near_the_truth(
    calibrated: tuple[ScannerCalibration, CalibrationReport],
):
    """A quarter of the sensor and six places: errors within three sigma, and small."""
    calibration, report = calibrated
    errors, sigmas = GeometryErrors.of(calibration.geometry, TRUTH), calibration.covariance.sigmas
    print(f"{errors}\n{report.text}")
    assert errors.plane_mrad < 3e3 * np.hypot(sigmas["plane_toe_in"], sigmas["plane_roll"])
    assert errors.plane_mm < 3e3 * sigmas["plane_distance"]
    assert errors.axis_mrad < 3e3 * np.hypot(sigmas["axis_pitch"], sigmas["axis_roll"])
    assert errors.axis_mm < 3e3 * np.hypot(sigmas["axis_forward"], sigmas["axis_sideways"])
    assert errors.plane_mrad < 0.2
    assert errors.plane_mm < 0.2
    assert errors.axis_mrad < 0.2
    assert errors.axis_mm < 0.4


def test_corners_and_line_are_found_to_a_few_hundredths_of_a_pixel(
    calibrated: tuple[ScannerCalibration, CalibrationReport],
):
    """No view of a tilted board stands out, and the prints do not draw the line aside."""
    calibration, report = calibrated
    assert calibration.residuals.corner_rms_px < 0.07
    assert calibration.residuals.laser_rms_px < 0.08
    assert report.adjustment.view_rms_px.max() < 0.12
    assert calibration.residuals.laser_farthest_m > 3.0
    assert report.verdict.grade is not Grade.BAD


def test_the_laser_meets_the_middle_of_every_board_at_zero_degrees():
    """What the places promise: one peak of the true line lies at the board's middle."""
    for place in BOARD_PLACES:
        renderer = board_renderer(TRUTH, BOARD, place)
        (board,) = renderer.scene.boards
        normal = np.array(TRUTH.plane_normal)
        rotation, camera = renderer.placement.world_from_optical(0.0)
        middle = (board.center_world - camera) @ rotation
        assert normal @ middle == pytest.approx(TRUTH.plane_distance, abs=1e-9)
        assert middle[2] > 0.5


def test_a_charuco_board_is_put_up_too():
    """The twin prints the board that the calibration looks for, and it is found."""
    board = CharucoBoard(8, 6, 0.12, 0.09, "DICT_4X4_50")
    sensor = Sensor(PixelFormat.BGR)
    renderer = board_renderer(TRUTH, board, BOARD_PLACES[0], sensor=sensor)
    found = board.detect(renderer.render(Shot(20.0, False, 20_000.0)).astype(np.uint8))
    assert len(found.pixels) > 0.9 * len(board.points)
    printed = renderer.project(renderer.scene.boards[0].corners_world, 20.0)
    column, row = np.rint(found.points_board[:, :2] / board.square).astype(int).T
    index = column + (board.columns - 1) * row
    assert np.abs(found.pixels - printed[index]).max() < 0.15


def test_a_charuco_board_calibrates_from_end_to_end():
    """Rendered, found, calibrated and judged; few corners on a small sensor: errors in sigmas."""
    board = parse_board("charuco:6x4:0.18:0.14:DICT_4X4_50")
    calibration, report = twin_calibrated(TRUTH, board, 6)
    errors, sigmas = GeometryErrors.of(calibration.geometry, TRUTH), calibration.covariance.sigmas
    print(f"{errors}\n{report.text}")
    assert errors.plane_mrad < 3e3 * np.hypot(sigmas["plane_toe_in"], sigmas["plane_roll"])
    assert errors.plane_mm < 3e3 * sigmas["plane_distance"]
    assert errors.axis_mrad < 3e3 * np.hypot(sigmas["axis_pitch"], sigmas["axis_roll"])
    assert errors.axis_mm < 3e3 * np.hypot(sigmas["axis_forward"], sigmas["axis_sideways"])
    assert calibration.residuals.corner_rms_px < 0.12
    assert calibration.board == board.text
    assert "uncertainty of the axis's place" in report.text


def test_a_chessboard_is_never_upside_down(monkeypatch: pytest.MonkeyPatch):
    """Whichever end the search begins at, the corners come in the same order."""
    renderer = board_renderer(TRUTH, BOARD, BOARD_PLACES[0], sensor=Sensor(PixelFormat.BGR))
    image = renderer.render(Shot(20.0, False, 20_000.0))
    found = BOARD.detect(image)
    search = cv2.findChessboardCornersSB

    def from_the_other_end(*args: Any, **options: Any) -> tuple[bool, np.ndarray]:
        found, corners = search(*args, **options)
        return found, corners[::-1]

    monkeypatch.setattr(cv2, "findChessboardCornersSB", from_the_other_end)
    again = BOARD.detect(image)
    np.testing.assert_allclose(again.pixels, found.pixels, atol=1e-3)
    true = renderer.project(renderer.scene.boards[0].corners_world, 20.0)
    if np.linalg.norm(found.pixels[0] - true[0]) > 5:
        true = true[::-1]
    assert np.abs(found.pixels - true).max() < 0.15


def test_the_edge_of_the_pattern_is_no_row_of_corners(monkeypatch: pytest.MonkeyPatch):
    """A grid that lies one square beside the true corners is refused, as OpenCV may find it."""
    renderer = board_renderer(TRUTH, BOARD, BOARD_PLACES[0], sensor=Sensor(PixelFormat.BGR))
    image = renderer.render(Shot(20.0, False, 20_000.0))
    search = cv2.findChessboardCornersSB

    def one_beside(
        image: np.ndarray, size: tuple[int, int], **options: Any
    ) -> tuple[bool, np.ndarray]:
        found, corners = search(image, size, **options)
        grid = corners.reshape(size[1], size[0], 2)
        moved = np.concatenate([2 * grid[:, :1] - grid[:, 1:2], grid[:, :-1]], axis=1)
        return found, moved.reshape(-1, 1, 2)

    monkeypatch.setattr(cv2, "findChessboardCornersSB", one_beside)
    with pytest.raises(BoardNotFoundError, match="no whole chessboard"):
        BOARD.detect(image)


def test_other_boards_are_refused():
    """What the twin cannot print is refused by its name."""

    class Circles:
        text = "circles:4x11:0.05"

    with pytest.raises(InputError, match="not 'circles:4x11:0.05'"):
        board_renderer(TRUTH, Circles(), BOARD_PLACES[0])  # type: ignore[arg-type]
