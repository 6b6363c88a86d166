"""What can go wrong with a controller, each against a double that does it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import pytest

from depthwarp.scanner.axes import StepMotor
from depthwarp.scanner.axis import (
    AxisAlarmError,
    AxisError,
    AxisLostError,
    AxisRestartedError,
    AxisState,
    AxisTimeoutError,
)
from tests.scanner.axes.conftest import PATIENCE_S, SHORT_S, MakeRig, Rig, build_axis, wait_until

FAR = 3600.0  # degrees: two seconds of the double's time even at its fastest


@contextmanager
def during_motion(rig: Rig, event: Callable[[], object]) -> Iterator[None]:
    """Let `event` happen as soon as the motor turns."""

    def wait_and_act() -> None:
        wait_until(lambda: rig.firmware.is_moving)
        event()

    thread = threading.Thread(target=wait_and_act)
    thread.start()
    yield
    thread.join()


def assert_recovers(rig: Rig) -> None:
    """After `reference` everything works again."""
    rig.axis.reference()
    before = rig.firmware.true_angle
    rig.axis.move_to(9.0)
    assert rig.firmware.true_angle - before == pytest.approx(9.0, abs=1e-9)
    rig.axis.set_laser(True)
    assert rig.firmware.laser_on


def test_an_alarm_in_a_move_locks_until_the_reference(rig: Rig) -> None:
    """The move raises, the laser is off, nothing moves any more before `reference`."""
    rig.axis.set_laser(True)
    with (
        during_motion(rig, lambda: rig.firmware.alarm(1)),
        pytest.raises(AxisAlarmError, match="limit.*mark and reference the axis again"),
    ):
        rig.axis.move_to(FAR)
    assert not rig.firmware.laser_on
    assert rig.axis.state() is AxisState.ALARM
    for call in (rig.axis.position, lambda: rig.axis.move_to(1.0)):
        with pytest.raises(AxisAlarmError):
            call()
    with pytest.raises(AxisAlarmError):
        rig.axis.set_laser(True)
    rig.axis.set_laser(False)
    assert_recovers(rig)


def test_an_alarm_between_moves_is_noticed(rig: Rig) -> None:
    """A limit switch that is touched while the head stands."""
    rig.axis.move_to(9.0)
    rig.firmware.alarm(7)
    with pytest.raises(AxisAlarmError):
        rig.axis.move_to(18.0)
    assert_recovers(rig)


def test_a_restart_in_a_move_loses_the_position(rig: Rig) -> None:
    """The banner in mid-move ends it; the counted zero is worthless until `reference`."""
    with (
        during_motion(rig, rig.firmware.restart),
        pytest.raises(AxisRestartedError, match="restarted by itself.*reference the axis again"),
    ):
        rig.axis.move_to(FAR)
    assert rig.axis.state() is AxisState.IDLE
    for call in (rig.axis.position, lambda: rig.axis.move_to(1.0)):
        with pytest.raises(AxisRestartedError):
            call()
    assert_recovers(rig)


def test_a_restart_between_moves_is_noticed(rig: Rig) -> None:
    """The report of 0 degrees after it is never taken for an angle."""
    rig.axis.move_to(90.0)
    rig.firmware.restart()
    with pytest.raises(AxisRestartedError):
        rig.axis.move_to(99.0)
    assert rig.firmware.true_angle == pytest.approx(90.0)
    assert_recovers(rig)


def test_a_motor_that_stalls_runs_into_the_timeout(rig: Rig) -> None:
    """The time allowed follows from way and speed; the motor is stopped."""
    rig.axis.patience_s = SHORT_S
    with during_motion(rig, rig.firmware.stall):
        began = time.monotonic()
        with pytest.raises(AxisTimeoutError, match="within 0.7 s"):
            rig.axis.move_to(18.0)  # 0.2 s at 90 degrees/s, twice, and the patience
        assert 0.65 < time.monotonic() - began < 5.0
    assert rig.firmware.received[-1] in rig.laser_off_lines
    assert not rig.firmware.is_moving


@pytest.mark.parametrize("press", ["hold", "open_door"])
def test_a_held_move_raises_and_keeps_the_position(make_rig: MakeRig, press: str) -> None:
    """The hold button and the door brake the motor; the angle stays right without a reference."""
    rig = make_rig("grbl")
    rig.axis.connect()
    rig.axis.reference()
    with (
        during_motion(rig, getattr(rig.firmware, press)),
        pytest.raises(AxisError, match="Hold|Door"),
    ):
        rig.axis.move_to(FAR)
    assert rig.axis.position() == pytest.approx(rig.firmware.true_angle, abs=0.001)
    assert rig.axis.move_to(0.0) == 0.0 == rig.firmware.true_angle


def test_a_hold_before_a_move_is_no_standstill(rig: Rig) -> None:
    """A controller on hold says so; the state tells it, the move gives up."""
    rig.axis.patience_s = SHORT_S
    rig.firmware.hold()
    assert rig.axis.state() is AxisState.HOLD
    with pytest.raises(AxisTimeoutError, match="Hold|Queue"):
        rig.axis.move_to(9.0)


def test_the_line_drops_in_a_move(rig: Rig) -> None:
    """The move raises at once and warns of the laser; connecting again finds the old frame."""
    rig.axis.set_laser(True)
    with (
        during_motion(rig, rig.firmware.drop_line),
        pytest.raises(AxisLostError, match="The laser may be on"),
    ):
        rig.axis.move_to(90.0)
    assert rig.axis.state() is AxisState.LOST
    with pytest.raises(AxisLostError):
        rig.axis.reference()
    rig.axis.stop()  # has no line to stop anything by, and says nothing
    rig.firmware.restore_line()
    while rig.firmware.is_moving:
        time.sleep(0.01)
    rig.axis.connect()
    assert not rig.firmware.laser_on
    assert rig.axis.position() == 90.0


def test_connecting_to_a_head_in_motion_stops_it(rig: Rig) -> None:
    """What an earlier program left running is stopped; its position is lost."""
    with (
        during_motion(rig, rig.firmware.drop_line),
        pytest.raises(AxisLostError),
    ):
        rig.axis.move_to(FAR)
    rig.firmware.restore_line()
    rig.axis.connect()
    assert not rig.firmware.is_moving
    with pytest.raises(AxisAlarmError):
        rig.axis.move_to(1.0)
    assert_recovers(rig)


def test_silence_in_the_middle_is_a_timeout(rig: Rig) -> None:
    """A controller that hangs is given up after the patience, and everything is tried to stop."""
    rig.axis.patience_s = SHORT_S
    rig.firmware.silent = True
    assert rig.axis.state() is AxisState.LOST
    with pytest.raises(AxisTimeoutError, match="no status"):
        rig.axis.move_to(9.0)
    assert "\x18" in rig.firmware.received
    wait_until(lambda: rig.laser_off_lines == {*rig.firmware.received[-len(rig.laser_off_lines) :]})
    rig.firmware.silent = False
    rig.axis.patience_s = PATIENCE_S
    assert_recovers(rig)


def test_slow_answers_are_waited_for(make_rig: MakeRig) -> None:
    """A controller that takes 20 ms for each answer is slow, not broken."""
    rig = make_rig()
    rig.firmware.answer_delay_s = 0.02
    with rig.axis as axis:
        axis.reference()
        assert axis.move_to(9.0) == 9.0 == rig.firmware.true_angle


def test_damaged_reports_are_asked_for_again(make_rig: MakeRig) -> None:
    """With a third of all lines damaged, a status still comes through."""
    rig = make_rig()
    with rig.axis as axis:
        axis.reference()
        axis.move_to(9.0)
        rig.firmware.garbled_share = 0.3
        for _ in range(10):
            assert axis.position() == 9.0
        rig.firmware.garbled_share = 0.0


def test_a_damaged_answer_is_no_ok(make_rig: MakeRig) -> None:
    """Nobody knows whether the controller took the command: stop, and say what was heard."""
    rig = make_rig()
    rig.axis.connect()
    rig.axis.reference()
    rig.axis.patience_s = SHORT_S
    rig.firmware.garbled_share = 1.0
    with pytest.raises(AxisTimeoutError, match="it said last: "):
        rig.axis.set_laser(True)
    assert not rig.firmware.laser_on
    rig.firmware.garbled_share = 0.0
    rig.axis.patience_s = PATIENCE_S
    assert_recovers(rig)


def test_a_move_that_ends_elsewhere_raises(make_rig: MakeRig) -> None:
    """Idle far from the angle asked for is no success, here on a grid of 5 degrees."""
    rig = make_rig(motor=StepMotor(steps_per_degree=0.2))
    with rig.axis as axis:
        axis.reference()
        assert axis.move_to(10.0) == 10.0
        with pytest.raises(AxisError, match="at 15.0 degrees instead of 13.0"):
            axis.move_to(13.0)


def test_something_else_on_the_port_is_quoted(make_rig: MakeRig) -> None:
    """The message shows what it said, made printable, and it is sent nothing to stop."""
    rig = make_rig(patience_s=SHORT_S)
    rig.firmware.foreign = "echo:Marlin 2.1 \x1b[31mready"
    with pytest.raises(AxisError, match=r"not GRBL 1.1; it said last: 'echo:Marlin") as info:
        rig.axis.connect()
    assert str(info.value).isprintable()
    assert rig.axis.state() is AxisState.LOST


@pytest.mark.parametrize(("spoken", "expected"), [("grbl", "horus"), ("horus", "grbl")])
def test_the_other_dialect_is_recognized(make_rig: MakeRig, spoken: str, expected: str) -> None:
    """A Horus board on a GRBL axis is refused before anything turns, and the reverse."""
    rig = make_rig(spoken)
    with pytest.raises(
        AxisError, match=f"it said last: .*{'Grbl' if spoken == 'grbl' else 'Horus'}"
    ):
        build_axis(expected, rig.firmware.path, SHORT_S).connect()
    assert not any("X" in line for line in rig.firmware.received)


def test_silence_at_the_start(make_rig: MakeRig) -> None:
    """A dead port is given up within the patience."""
    rig = make_rig(patience_s=SHORT_S)
    rig.firmware.silent = True
    began = time.monotonic()
    with pytest.raises(AxisTimeoutError, match="switched on"):
        rig.axis.connect()
    assert time.monotonic() - began < 3.0


def test_a_controller_locked_by_a_limit_switch_is_found(make_rig: MakeRig) -> None:
    """GRBL is deaf after a limit switch until it is reset; connecting resets it."""
    rig = make_rig("grbl", patience_s=SHORT_S)
    rig.firmware.alarm(1)
    rig.axis.connect()
    rig.axis.patience_s = PATIENCE_S
    assert rig.axis.state() is AxisState.ALARM
    assert_recovers(rig)
