"""How near the calibration on the twin's rendered boards comes to the twin's true geometry.

Run `python -m benchmarks.calibration`. The twin puts a board up in one place after another, takes
its pictures through the same code as a real scanner, and calibrates from them; frames are thrown
away as soon as their corners and their line are found. Exit code 1 where a figure is missed.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from depthwarp.cli.report import Reporter, quiet_warp
from depthwarp.scanner.axes import SimulatedAxis
from depthwarp.scanner.calibration import (
    Board,
    BoardView,
    CalibrationReport,
    ScannerCalibration,
    calibrate_views,
    parse_board,
)
from depthwarp.scanner.calibration.capture import require_one_camera, take_placement
from depthwarp.scanner.calibration.recorded import board_views, fit_board_color
from depthwarp.scanner.geometry import ScannerGeometry, reference_geometry
from depthwarp.scanner.laser import LaserColorModel
from depthwarp.scanner.plan import ScanPlan
from depthwarp.scanner.recording import Recording
from depthwarp.scanner.twin import TwinCamera
from depthwarp.scanner.twin.board_hall import BOARD_PLACES, board_renderer

EXPOSURES_US = (20_000.0, 1000.0, 100.0)
TARGETS = {"plane_mrad": 0.1, "plane_mm": 0.1, "axis_mrad": 0.05, "axis_mm": 0.1}


@dataclass(frozen=True)
class GeometryErrors:
    """How far a geometry is from the true one.

    Attributes:
        plane_mrad: Angle between the laser planes.
        plane_mm: Difference of their distances from the camera.
        axis_mrad: Angle between the axes.
        axis_mm: Distance of the axes beside the camera.
    """

    plane_mrad: float
    plane_mm: float
    axis_mrad: float
    axis_mm: float

    @classmethod
    def of(cls, found: ScannerGeometry, truth: ScannerGeometry) -> GeometryErrors:
        direction = np.array(truth.axis.direction)
        beside = np.array(found.axis.point) - truth.axis.point
        return cls(
            plane_mrad=_mrad(found.plane_normal, truth.plane_normal),
            plane_mm=1e3 * abs(found.plane_distance - truth.plane_distance),
            axis_mrad=_mrad(found.axis.direction, truth.axis.direction),
            axis_mm=1e3 * float(np.linalg.norm(beside - (beside @ direction) * direction)),
        )


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; 1 where a figure is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scale", type=float, default=1.0, help="size of the sensor")
    parser.add_argument("--placements", type=int, default=len(BOARD_PLACES))
    parser.add_argument("--board", default="chessboard:9x6:0.1")
    options = parser.parse_args(arguments)
    quiet_warp()
    begun = time.perf_counter()
    truth = reference_geometry(options.scale)
    board = parse_board(options.board)
    calibration, report = twin_calibrated(truth, board, options.placements)
    errors, sigmas = GeometryErrors.of(calibration.geometry, truth), calibration.covariance.sigmas
    say = Reporter(as_json=False).say
    say(f"{truth.lens.size[0]} x {truth.lens.size[1]} px, board {board.text}")
    say(report.text)
    beside = {
        "plane_mrad": 1e3 * float(np.hypot(sigmas["plane_toe_in"], sigmas["plane_roll"])),
        "plane_mm": 1e3 * sigmas["plane_distance"],
        "axis_mrad": 1e3 * float(np.hypot(sigmas["axis_pitch"], sigmas["axis_roll"])),
        "axis_mm": 1e3 * float(np.hypot(sigmas["axis_forward"], sigmas["axis_sideways"])),
    }
    for name, target in TARGETS.items():
        error = getattr(errors, name)
        word = "reached" if error <= target else "MISSED"
        say(f"{name}: error {error:.4f}, sigma {beside[name]:.4f}, target {target}: {word}")
    say(f"lens {calibration.geometry.lens}, {time.perf_counter() - begun:.0f} s")
    return int(any(getattr(errors, name) > target for name, target in TARGETS.items()))


def twin_calibrated(
    truth: ScannerGeometry, board: Board, placements: int
) -> tuple[ScannerCalibration, CalibrationReport]:
    """The calibration from the twin's pictures of a board in its first places."""
    views: list[BoardView] = []
    recordings: dict[int, Recording] = {}
    model: LaserColorModel | None = None  # learned at the first place
    with SimulatedAxis() as axis, tempfile.TemporaryDirectory() as folder:
        axis.reference()
        for number in range(placements):
            recordings[number] = _taken(Path(folder), truth, board, number, axis)
            model = model or fit_board_color(recordings)
            views += board_views({number: recordings[number]}, board, model)[0]
            for path in (recordings[number].folder / "frames").iterdir():
                path.unlink()
    return calibrate_views(views, board, require_one_camera(recordings))


def _taken(
    folder: Path, truth: ScannerGeometry, board: Board, number: int, axis: SimulatedAxis
) -> Recording:
    """The recording of one place of the board."""
    place = BOARD_PLACES[number]
    stops = place.angles(float(board.points[:, 0].max()))
    plan = ScanPlan(stops, EXPOSURES_US, settle_s=0.0)
    with TwinCamera(board_renderer(truth, board, place, seed=number), axis) as camera:
        return take_placement(folder, number, plan, camera, camera.open(), axis, settings={})


def _mrad(first: Sequence[float], second: Sequence[float]) -> float:
    a, b = np.array(first), np.array(second)
    return 1e3 * float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))


if __name__ == "__main__":
    raise SystemExit(main())
