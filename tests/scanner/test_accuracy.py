"""The scanner's accuracy on the twin: from frames to the cloud, against the analytic truth.

Each test prints what it measured; `python -m benchmarks.scanner` measures the same at full size.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from benchmarks.scanner import SENSOR, Case, measure, room_cases, saturated, wall_case
from benchmarks.scanner_report import (
    LEAST_FOUND,
    MOST_FALSE,
    MOST_RMS_PX,
    MOST_RMS_SATURATED_PX,
    PULL_DEVIATIONS,
    Figures,
    misses,
)
from depthwarp.cloud import PointCloud
from depthwarp.scanner.axes import SimulatedAxis, StepMotor
from depthwarp.scanner.frames import DeviceLostError
from depthwarp.scanner.geometry import reference_geometry
from depthwarp.scanner.plan import ScanPlan
from depthwarp.scanner.processing import process_recording
from depthwarp.scanner.recording import Recording
from depthwarp.scanner.room import furnished_room
from depthwarp.scanner.scan import ScanCancelledError, ScanControl, ScanProgress, run_scan
from depthwarp.scanner.twin import CameraFault, Scene, TwinCamera, TwinRenderer
from depthwarp.scanner.twin.session import TWIN_POSITION, TwinScanner, twin_calibration

HALF, QUARTER, EIGHTH = 0.5, 0.25, 0.125
PLAN = ScanPlan.turn(12, exposures_us=(4000.0,), settle_s=0.0)

Interfere = Callable[[TwinScanner, ScanControl], None]


@pytest.fixture(scope="module", params=[1.0, 2.0, 5.0, 10.0], ids=lambda range_m: f"{range_m:g}m")
def wall(request: pytest.FixtureRequest) -> Iterator[Figures]:
    """Figures of a wall at normal exposure, noise of 2.5 grey levels, no speckle."""
    yield measure(wall_case(request.param), HALF)


def test_line_position(wall: Figures) -> None:
    """At normal exposure the line's column is right to 0.10 px RMS."""
    print(f"{wall.case}: RMS {wall.rms_px:.3f} px, bias {wall.bias_px:+.3f} px")
    assert SENSOR.read_noise == 2.5
    assert wall.points > 700
    assert wall.rms_px <= MOST_RMS_PX
    assert abs(wall.bias_px) < MOST_RMS_PX / 4


def test_points_found(wall: Figures) -> None:
    """Of a line on a wall 99 % is found, and next to no point lies off the line."""
    print(f"{wall.case}: {wall.found} of {wall.visible} rows, {wall.false_points} false points")
    assert wall.visible > 700
    assert wall.found_share >= LEAST_FOUND
    assert wall.false_share < MOST_FALSE


def test_range_error_and_pull(wall: Figures) -> None:
    """Half of the ranges are right within one sigma, and errors spread as the sigmas say."""
    print(
        f"{wall.case}: median error {wall.median_range_error_m * 1e3:.2f} mm, sigma "
        f"{wall.median_sigma_m * 1e3:.2f} mm, pull {wall.pull_deviation:.2f}"
    )
    assert wall.median_range_error_m <= wall.median_sigma_m
    assert wall.median_pull <= 1.0
    least, most = PULL_DEVIATIONS
    assert least <= wall.pull_deviation <= most


@pytest.mark.parametrize("range_m", [1.0, 5.0])
def test_saturated_line(range_m: float) -> None:
    """With eight times the light: 0.15 px RMS, as complete, and sigmas that say what happens."""
    figures = measure(saturated(wall_case(range_m)), HALF)
    print(
        f"{figures.case}: RMS {figures.rms_px:.3f} px, median error "
        f"{figures.median_pull:.2f} sigma, pull {figures.pull_deviation:.2f}"
    )
    assert figures.rms_px <= MOST_RMS_SATURATED_PX
    assert misses(figures) == []


def test_speckle_is_the_floor() -> None:
    """Speckle of contrast 0.2 makes the column worse by several times, as it does for real."""
    plain = measure(wall_case(2.0), QUARTER)
    speckled = measure(wall_case(2.0).with_speckle(), QUARTER)
    print(f"RMS {plain.rms_px:.3f} px without, {speckled.rms_px:.3f} px with speckle")
    assert 1.5 * plain.rms_px < speckled.rms_px < 0.2


@pytest.mark.parametrize("case", room_cases(6), ids=lambda case: case.name)
def test_line_in_the_room(case: Case) -> None:
    """Slanted, cut off by furniture and blended at its edges, the line is as good as on a wall."""
    figures = measure(case, HALF)
    print(
        f"{figures.case}: {figures.found_share:.2%} found, {figures.false_share:.3%} false, RMS "
        f"{figures.rms_px:.3f} px, median error {figures.median_pull:.2f} sigma, pull "
        f"{figures.pull_deviation:.2f}"
    )
    assert figures.found_share >= LEAST_FOUND
    assert figures.false_share < MOST_FALSE
    assert figures.rms_px <= MOST_RMS_PX
    assert figures.median_pull <= 1.0


def test_missed_figures_are_named() -> None:
    """A figure that is not reached is said in words, one that is reached is not."""
    good = Figures("wall", 1.0, 0.0, 1000, 1000, 1000, 0, 0.03, 0.0, 1e-3, 2e-3, 0.6, 1.0)
    assert misses(good) == []
    bad = Figures(**(asdict(good) | {"rms_px": 0.11, "found": 980, "pull_deviation": 2.5}))
    assert [line.split(": ")[1].split()[0] for line in misses(bad)] == ["RMS", "98.00%", "pull"]


def test_missed_steps_turn_the_cloud(tmp_path: Path) -> None:
    """Where the head did not follow its motor, points keep their range but not their azimuth."""
    axis = SimulatedAxis(StepMotor())
    renderer = TwinRenderer(Scene(furnished_room()), reference_geometry(QUARTER), TWIN_POSITION)
    camera = TwinCamera(renderer, axis)
    true_angles: list[float] = []

    def slip_after_three(progress: ScanProgress) -> None:
        true_angles.append(axis.true_angle)
        if progress.done == 3:
            axis.motor.miss(40)  # of 3200 a turn

    with camera, axis:
        info = camera.open()
        settings = {"position": list(TWIN_POSITION)}
        recording = Recording.create(tmp_path / "scan", PLAN, info, settings)
        run_scan(recording, camera, axis, progress=slip_after_three)
    cloud = process_recording(recording, twin_calibration(renderer, info)).cloud
    missed = np.array(PLAN.angles) - true_angles
    np.testing.assert_allclose(missed[:3], 0.0, atol=0.06)  # half a step
    np.testing.assert_allclose(missed[3:], 40 * 360 / 3200, atol=0.06)
    offset = cloud.points_world.astype(np.float64) - TWIN_POSITION
    azimuth = np.degrees(np.arctan2(offset[:, 1], offset[:, 0]))
    for stop, angle in enumerate(true_angles):
        chosen = cloud.attributes["frame"] == stop
        truth = renderer.truth(angle)
        row = cloud.attributes["row"][chosen].astype(int)
        single = truth.visible[row] & (truth.crossings[row] == 1)
        error = cloud.attributes["range"][chosen][single] - truth.range[row[single]]
        assert np.median(np.abs(error)) < 0.02
        true = truth.points_world[row[single]] - TWIN_POSITION
        turned = azimuth[chosen][single] - np.degrees(np.arctan2(true[:, 1], true[:, 0]))
        np.testing.assert_allclose((turned + 180) % 360 - 180, missed[stop], atol=0.06)


def test_replay_gives_the_same_bytes(tmp_path: Path) -> None:
    """A recording that is processed again, from disk, gives the identical cloud."""
    with TwinScanner(EIGHTH) as twin:
        recording = _run(twin, tmp_path, ScanControl(), lambda progress: None)
        live = process_recording(recording, twin.calibration)
    assert live.counts.points > 2000
    with TwinScanner(EIGHTH) as other:
        replayed = process_recording(Recording.open(tmp_path), other.calibration)
    assert _bytes(replayed.cloud) == _bytes(live.cloud)


def _cancel(twin: TwinScanner, control: ScanControl) -> None:
    control.cancel()


def _lose_camera(twin: TwinScanner, control: ScanControl) -> None:
    twin.camera.fail(CameraFault.LOST)


@pytest.mark.parametrize("interfere", [_cancel, _lose_camera])
def test_a_resumed_scan_is_the_unbroken_one(tmp_path: Path, interfere: Interfere) -> None:
    """Broken off after five stops and continued by a new scanner: the same cloud, byte for byte."""
    control = ScanControl()
    with TwinScanner(EIGHTH, seed=3) as twin:

        def after_five(progress: ScanProgress) -> None:
            if progress.done == 5:
                interfere(twin, control)

        with pytest.raises((ScanCancelledError, DeviceLostError)):
            _run(twin, tmp_path / "broken", control, after_five)
    assert Recording.open(tmp_path / "broken").finished == set(range(5))
    clouds = []
    for name in ("whole", "broken"):
        with TwinScanner(EIGHTH, seed=3) as twin:
            recording = _run(twin, tmp_path / name, ScanControl(), lambda progress: None)
            assert recording.remaining == []
            clouds.append(process_recording(recording, twin.calibration).cloud)
    assert _bytes(clouds[0]) == _bytes(clouds[1])


def _run(
    twin: TwinScanner,
    folder: Path,
    control: ScanControl,
    progress: Callable[[ScanProgress], None],
) -> Recording:
    """Begin the scan of a folder, or continue it."""
    with twin.camera as camera, twin.axis as axis:
        info = camera.open()
        axis.reference()
        if (folder / "scan.json").exists():
            recording = Recording.open(folder)
        else:
            settings = {
                "calibration_hash": twin.calibration.content_hash,
                "position": list(TWIN_POSITION),
            }
            recording = Recording.create(folder, PLAN, info, settings)
        run_scan(recording, camera, axis, control=control, progress=progress)
    return recording


def _bytes(cloud: PointCloud) -> bytes:
    """Everything that a cloud holds."""
    names = sorted(cloud.attributes)
    parts = [cloud.points_world, *(cloud.attributes[name] for name in names)]
    return " ".join(names).encode() + b"".join(part.tobytes() for part in parts)
