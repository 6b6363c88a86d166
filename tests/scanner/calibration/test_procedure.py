"""The whole way from pictures to a calibration: rendered boards with a green line on them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.calibration import (
    BoardShot,
    CharucoBoard,
    calibrate,
    load_calibration,
    observe,
)
from depthwarp.scanner.calibration.boards import BoardCorners
from depthwarp.scanner.calibration.turning_axis import head_turned
from depthwarp.scanner.calibration.views import rays_on_board
from depthwarp.scanner.frames import PixelFormat, SourceInfo
from depthwarp.scanner.geometry import reference_geometry
from depthwarp.scanner.lens import project, undistort
from tests.scanner.calibration.synthetic import PLACES, board_at, laser_on, tilted

TRUTH = tilted(reference_geometry(0.3))
BOARD = CharucoBoard(8, 6, 0.09, 0.07, "DICT_4X4_50")
CAMERA = SourceInfo("rendered", "R-1", TRUTH.lens.size, PixelFormat.BGR, True)
DRAWN = 36  # pixels a square of the drawn board, about as many as in the picture


@pytest.fixture(scope="module")
def rays() -> np.ndarray:
    """The ray of every pixel of the frame, shape (H, W, 2)."""
    width, height = TRUTH.lens.size
    v, u = np.indices((height, width))
    flat = undistort(TRUTH.lens, np.column_stack([u.ravel(), v.ravel()]))
    return flat.reshape(*u.shape, 2)


def picture(rays: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """The board in front of a grey wall, BGR."""
    points = rays_on_board(rays.reshape(-1, 2), pose)
    on_plane = (points - pose[:3, 3]) @ pose[:3, :2]
    drawn = (
        on_plane / BOARD.square + 2
    ) * DRAWN - 0.5  # the first corner is a border and a square in
    maps = np.nan_to_num(drawn, nan=-1e4).clip(-1e4, 1e4).astype(np.float32)
    maps = maps.reshape(*rays.shape)
    drawing = cv2.GaussianBlur(BOARD.draw(DRAWN), (0, 0), 1.0)
    grey = cv2.remap(drawing, maps[..., 0], maps[..., 1], cv2.INTER_LINEAR, borderValue=(90,))
    return np.dstack([np.asarray(grey)] * 3) // 2


def with_laser(image: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """The same picture with a green line of 1.2 px on the board."""
    points = BOARD.points @ pose[:3, :3].T + pose[:3, 3]
    corners = BoardCorners(BOARD.points, project(TRUTH.lens, points))
    lit = image.astype(np.float64)
    columns = np.arange(image.shape[1])
    for u, v in laser_on(TRUTH, pose, corners):
        lit[int(v), :, 1] += 120 * np.exp(-(((columns - u) / 1.2) ** 2) / 2)
    return np.clip(lit, 0, 255).round().astype(np.uint8)


def find_line(lit: np.ndarray, off: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Centre of gravity of what the laser added."""
    added = lit[..., 1].astype(np.float64) - off[..., 1]
    rows = np.flatnonzero(added.max(axis=1) > 40)
    columns = added[rows] @ np.arange(added.shape[1]) / added[rows].sum(axis=1)
    return rows.astype(np.float64), columns, np.full(len(rows), 0.05)


@pytest.fixture(scope="module")
def shots(rays: np.ndarray) -> list[BoardShot]:
    axis, shots = TRUTH.axis, []
    for number, place in enumerate(PLACES[:6]):
        for angle in (-20.0, -6.0, 8.0):
            turned = head_turned(np.array(axis.direction), np.array(axis.point), angle)
            pose = turned @ board_at(place, BOARD)
            image = picture(rays, pose)
            shots.append(BoardShot(image, with_laser(image, pose), angle, number))
    return shots


def test_pictures_become_a_calibration_near_the_truth(shots: list[BoardShot], tmp_path):
    """From rendered pictures at a third of the size: plane and axis to a fraction of a mrad."""
    empty = replace(shots[0], image=np.full_like(shots[0].image, 90), lit_image=None)
    calibration, report = calibrate([*shots, empty], BOARD, CAMERA, find_line)
    found = calibration.geometry
    plane_mrad = 1e3 * np.linalg.norm(np.cross(found.plane_normal, TRUTH.plane_normal))
    axis_mrad = 1e3 * np.linalg.norm(np.cross(found.axis.direction, TRUTH.axis.direction))
    plane_mm = 1e3 * abs(found.plane_distance - TRUTH.plane_distance)
    print(
        f"plane {plane_mrad:.2f} mrad {plane_mm:.2f} mm, axis {axis_mrad:.2f} mrad\n{report.text}"
    )
    assert plane_mrad < 0.5
    assert plane_mm < 0.5
    assert axis_mrad < 0.5
    assert found.lens.cx == pytest.approx(TRUTH.lens.cx, abs=0.15)
    assert report.adjustment.corner_rms_px < 0.15
    assert report.adjustment.laser_rms_px < 0.15
    assert "picture 18 at -20 degrees: 0 corners" in report.skipped[-1]
    assert "left out" in report.text
    assert calibration.camera_serial == "R-1"
    assert calibration.board == BOARD.text
    assert calibration.residuals.turn_deg == 28.0
    calibration.save(tmp_path / "c.json")
    load_calibration(tmp_path / "c.json").require_camera(CAMERA)


def test_the_line_is_used_on_the_board_only(shots: list[BoardShot]):
    """Peaks on the wall behind the board are left out."""

    def everywhere(lit: np.ndarray, off: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        rows = np.arange(lit.shape[0], dtype=np.float64)
        return rows, np.full(len(rows), lit.shape[1] / 2), np.full(len(rows), 0.2)

    (view,), skipped = observe(shots[1:2], BOARD, CAMERA.size, everywhere)
    low, high = view.corners.pixels.min(axis=0), view.corners.pixels.max(axis=0)
    assert not skipped
    assert 50 < len(view.laser_pixels) < 0.8 * CAMERA.size[1]
    assert (view.laser_pixels > low).all() and (view.laser_pixels < high).all()
    assert view.laser_sigma_px == 0.2


def test_pictures_of_another_size_are_refused(shots: list[BoardShot]):
    """A calibration never mixes cameras or modes."""
    with pytest.raises(InputError, match="picture 0 has .* the camera gives 100 x 100 px"):
        observe(shots[:1], BOARD, (100, 100), find_line)


def test_pictures_without_any_board_are_refused_with_what_to_do(shots: list[BoardShot]):
    """Too few boards end in the lens's own words."""
    blank = [replace(shot, image=np.zeros_like(shot.image)) for shot in shots[:5]]
    with pytest.raises(InputError, match="0 views of the board are too few"):
        calibrate(blank, BOARD, CAMERA, find_line)
