"""Running a scan: the order of things, failures, pause and cancel, and a safe machine after all."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.axis import AxisAlarmError, AxisLostError, AxisRestartedError
from depthwarp.scanner.frames import (
    DeviceLostError,
    Frame,
    FrameTimeoutError,
    IncompleteFrameError,
)
from depthwarp.scanner.plan import ScanPlan
from depthwarp.scanner.recording import Recording
from depthwarp.scanner.scan import ScanCancelledError, ScanControl, ScanProgress, run_scan
from tests.scanner.fakes import FakeAxis, FakeSource


def begin(folder: Path, source: FakeSource, steps: int = 5, **settings: object) -> Recording:
    """A recording for the fake camera."""
    plan = ScanPlan.turn(steps, **({"settle_s": 0.0} | settings))
    return Recording.create(folder, plan, source.info, {})


def test_a_stop_is_move_off_frame_lit_frames(tmp_path):
    """Every exposure has a frame without the laser and one with it; it is off when moving."""
    axis = FakeAxis()
    source = FakeSource(axis)
    recording = begin(tmp_path, source, steps=2, exposures_us=(100.0, 400.0))
    run_scan(recording, source, axis)
    assert source.laser_seen == [False, False, True, True] * 2
    assert axis.log == ["move", "laser off", "laser on", "laser off"] * 2 + ["stop"]
    first, second = recording.steps()
    for number, exposure in enumerate((100.0, 400.0)):
        lit_frame, off_frame = first.exposures[number]
        assert lit_frame.exposure_us == off_frame.exposure_us == exposure
    assert second.reported == 180.0


def test_without_off_frame(tmp_path):
    """Only lit frames are taken when the plan says so."""
    axis = FakeAxis()
    source = FakeSource(axis)
    run_scan(begin(tmp_path, source, with_off_frame=False), source, axis)
    assert source.laser_seen == [True] * 5


def test_progress_counts_and_estimates(tmp_path):
    """Every stop reports done, total and the time left, which ends at 0."""
    axis = FakeAxis()
    source = FakeSource(axis, delay_s=0.01)
    seen: list[ScanProgress] = []
    run_scan(begin(tmp_path, source), source, axis, progress=seen.append)
    assert [progress.done for progress in seen] == [1, 2, 3, 4, 5]
    assert seen[-1].seconds_left == 0 and seen[0].seconds_left > seen[3].seconds_left > 0
    assert seen[1].angle == pytest.approx(72, abs=0.06)


@pytest.mark.parametrize("error", [FrameTimeoutError("late"), IncompleteFrameError("torn")])
def test_a_late_or_torn_frame_is_asked_for_again(tmp_path, error):
    """Two failures in a row do not end the scan, three do."""
    axis = FakeAxis()
    source = FakeSource(axis, errors=[error, error])
    run_scan(begin(tmp_path / "a", source), source, axis)
    source = FakeSource(axis, errors=[error, error, error])
    recording = begin(tmp_path / "b", source)
    with pytest.raises(type(error)):
        run_scan(recording, source, axis)
    assert recording.finished == frozenset() and axis.log[-1] == "stop"


@pytest.mark.parametrize(
    "error",
    [AxisLostError("gone"), AxisAlarmError("alarm"), AxisRestartedError("again"), RuntimeError()],
)
def test_whatever_the_axis_does_the_machine_is_safe_and_the_scan_goes_on(tmp_path, error):
    """After an error laser and motor are off; a resumed scan ends like an unbroken one."""
    axis = FakeAxis(fails_at=3, error=error)
    source = FakeSource(axis)
    recording = begin(tmp_path, source)
    with pytest.raises(type(error)):
        run_scan(recording, source, axis)
    assert axis.log[-1] == "stop" and not axis.laser
    again = Recording.open(tmp_path)
    assert again.finished == {0, 1}
    axis = FakeAxis()
    run_scan(again, FakeSource(axis), axis)
    assert Recording.open(tmp_path).remaining == []


def test_a_lost_camera_leaves_the_laser_off(tmp_path):
    """The camera vanishes while the laser is on."""
    axis = FakeAxis()
    source = FakeSource(axis, errors=[None, DeviceLostError("unplugged")])
    with pytest.raises(DeviceLostError, match="unplugged"):
        run_scan(begin(tmp_path, source), source, axis)
    assert axis.log[-2:] == ["laser on", "stop"] and not axis.laser


def test_a_frame_of_another_size_is_not_recorded(tmp_path):
    """A camera whose region was changed is refused with both sizes."""
    axis = FakeAxis()
    source = FakeSource(axis)
    recording = begin(tmp_path, source)
    source.size = (20, 16)
    with pytest.raises(IncompleteFrameError, match="20 x 16 .* 24 x 16"):
        run_scan(recording, source, axis)


def test_cancel_and_resume(tmp_path):
    """Cancelling ends the scan with what is recorded; the rest can be taken later."""
    axis, control = FakeAxis(), ScanControl()
    source = FakeSource(axis)
    recording = begin(tmp_path, source)

    def stop_after_two(progress: ScanProgress) -> None:
        if progress.done == 2:
            control.cancel()

    with pytest.raises(ScanCancelledError):
        run_scan(recording, source, axis, control=control, progress=stop_after_two)
    assert axis.log[-1] == "stop" and recording.finished == {0, 1}
    run_scan(Recording.open(tmp_path), source, axis)
    assert Recording.open(tmp_path).remaining == []


def test_pause_holds_the_scan(tmp_path):
    """While paused nothing moves and the laser is off; afterwards the scan goes on."""
    axis, control = FakeAxis(), ScanControl()
    source = FakeSource(axis)
    recording = begin(tmp_path, source)
    control.pause()
    thread = threading.Thread(
        target=run_scan, args=(recording, source, axis), kwargs={"control": control}
    )
    thread.start()
    time.sleep(0.05)
    assert axis.moves == 0 and not axis.laser
    control.resume()
    thread.join(timeout=5)
    assert not thread.is_alive() and recording.remaining == []


def test_a_pause_in_the_midst_of_a_stop_finishes_it_first(tmp_path):
    """Also when it is asked for while the laser is on; what is to be done at rest is done once."""
    axis, control = FakeAxis(), ScanControl()
    source = FakeSource(axis)
    recording = begin(tmp_path, source)
    seen: list[tuple[bool, bool, int]] = []
    grab = source.grab

    def grab_and_pause(timeout_s: float) -> Frame:
        if axis.laser and not recording.finished:
            control.pause()
            control.call_at_rest(look)
        return grab(timeout_s)

    def look() -> None:
        seen.append((axis.laser, control.is_resting, len(recording.finished)))
        control.resume()

    source.grab = grab_and_pause  # type: ignore[method-assign]
    run_scan(recording, source, axis, control=control)
    assert seen == [(False, True, 1)]
    assert not control.is_resting and recording.remaining == []


def test_time_in_a_pause_is_not_counted_as_pace(tmp_path):
    """The time left after a pause is what it was before."""
    axis, control = FakeAxis(), ScanControl()
    source = FakeSource(axis)
    seen: list[ScanProgress] = []

    def report(progress: ScanProgress) -> None:
        seen.append(progress)
        if progress.done == 2:
            control.call_at_rest(lambda: time.sleep(0.5))

    run_scan(begin(tmp_path, source), source, axis, control=control, progress=report)
    assert seen[2].seconds_left < 0.25


@pytest.mark.parametrize(
    "settings",
    [
        {"stops": 0},
        {"stops": 10**9},
        {"stops": 4, "degrees": 0},
        {"stops": 4, "degrees": 400},
        {"stops": 4, "exposures_us": ()},
        {"stops": 4, "exposures_us": (0.0,)},
        {"stops": 4, "exposures_us": (float("nan"),)},
        {"stops": 4, "settle_s": -1.0},
        {"stops": 4, "gain_db": float("inf")},
        {"stops": 4, "frame_timeout_s": 0.0},
    ],
)
def test_plans_that_make_no_sense(settings):
    """Numbers out of their range are refused by name."""
    with pytest.raises(InputError):
        ScanPlan.turn(**settings)
