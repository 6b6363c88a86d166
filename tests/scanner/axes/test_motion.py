"""Moves, references and the laser of both controllers, against the truth of the firmware double."""

from __future__ import annotations

import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from depthwarp.errors import InputError
from depthwarp.scanner.axes import GrblAxis, HorusAxis
from depthwarp.scanner.axes.motor import StepMotor
from depthwarp.scanner.axis import AxisError, AxisLostError, AxisState
from depthwarp.scanner.twin.firmware import Firmware
from tests.scanner.axes.conftest import MakeRig, Rig, build_axis

ROUNDING = 0.0005 + 1e-9  # of the three decimals in a report [degrees]


@pytest.mark.parametrize("dialect", ["grbl", "horus"])
def test_the_reported_angle_is_the_kinematic_truth(dialect: str) -> None:
    """At rest, on the step grid, within half a step of the angle asked, where the head is."""
    with (
        Firmware("grbl" if dialect == "grbl" else "horus", time_scale=2000.0) as firmware,
        build_axis(dialect, firmware.path) as axis,
    ):
        axis.reference()

        @settings(max_examples=12)
        @given(st.floats(-400.0, 400.0))
        def moves(angle: float) -> None:
            reported = axis.move_to(angle)
            assert not firmware.is_moving
            assert abs(reported - firmware.true_angle) <= ROUNDING
            steps = reported * 3200 / 360
            assert abs(steps - round(steps)) <= ROUNDING * 3200 / 360
            assert abs(reported - angle) <= 0.5 * 360 / 3200 + ROUNDING

        moves()


@pytest.mark.parametrize("step", [0.1125, 0.225])
def test_one_step_is_not_taken_for_standstill(rig: Rig, step: float) -> None:
    """A move shorter than any tolerance still ends before it is reported."""
    for number in range(1, 4):
        reported = rig.axis.move_to(number * step)
        assert not rig.firmware.is_moving
        assert reported == pytest.approx(rig.firmware.true_angle, abs=ROUNDING)
        assert reported == pytest.approx(number * step, abs=ROUNDING)


def test_move_to_returns_after_the_motion(make_rig: MakeRig) -> None:
    """18 degrees at 90 degrees/s take at least 0.2 s in real time."""
    for dialect in ("grbl", "horus"):
        rig = make_rig(dialect, time_scale=1.0)
        with rig.axis as axis:
            axis.reference()
            began = time.monotonic()
            assert axis.move_to(18.0) == 18.0
            assert 0.2 < time.monotonic() - began < 2.0
            assert rig.firmware.true_angle == 18.0


def test_missed_steps_are_not_seen_by_the_controller(make_rig: MakeRig) -> None:
    """The report goes by the count; the truth lags behind."""
    rig = make_rig(motor=StepMotor(missed_share=0.1, seed=3))
    with rig.axis as axis:
        axis.reference()
        assert axis.move_to(90.0) == 90.0
        assert rig.firmware.true_angle < 85.0


def test_reference_takes_the_present_place_as_zero(rig: Rig) -> None:
    """Also off the grid of asked angles: the zero is the counted step, not the angle asked for."""
    reported = rig.axis.move_to(60.0)
    assert reported == pytest.approx(59.9625, abs=ROUNDING)
    rig.axis.reference()
    assert rig.axis.position() == pytest.approx(0.0, abs=2 * ROUNDING)
    before = rig.firmware.true_angle
    assert rig.axis.move_to(90.0) == pytest.approx(90.0, abs=2 * ROUNDING)
    assert rig.firmware.true_angle - before == pytest.approx(90.0, abs=1e-9)


def test_a_frame_outlives_the_link(rig: Rig) -> None:
    """Whoever connects again finds the angles of the last reference, without another."""
    rig.axis.move_to(45.0)
    rig.axis.reference()
    rig.axis.move_to(90.0)
    rig.axis.close()
    with build_axis(rig.dialect, rig.firmware.path) as again:
        assert again.position() == pytest.approx(90.0, abs=2 * ROUNDING)
        assert again.move_to(0.0) == pytest.approx(0.0, abs=2 * ROUNDING)
        assert rig.firmware.true_angle == pytest.approx(45.0)


def test_the_laser_is_switched_when_the_call_returns(rig: Rig) -> None:
    """On is on, off is off, as often as wanted."""
    for on in (True, False, True, True, False, False):
        rig.axis.set_laser(on)
        assert rig.firmware.laser_on is on


def test_the_laser_stays_on_through_a_move(rig: Rig) -> None:
    """A sweep with the laser on is possible, and its end is known."""
    rig.axis.set_laser(True)
    rig.axis.move_to(30.0)
    assert rig.firmware.laser_on
    rig.axis.set_laser(False)
    assert not rig.firmware.laser_on


def test_states(rig: Rig) -> None:
    """Idle at rest, lost when closed."""
    assert rig.axis.state() is AxisState.IDLE
    rig.axis.close()
    assert rig.axis.state() is AxisState.LOST
    for call in (rig.axis.position, rig.axis.reference, lambda: rig.axis.move_to(1.0)):
        with pytest.raises(AxisLostError, match="connect"):
            call()


def test_connecting_finds_a_board_that_is_booting(make_rig: MakeRig) -> None:
    """The banner is waited for; the position means nothing until `reference`."""
    for dialect in ("grbl", "horus"):
        rig = make_rig(dialect, boot_s=0.15)
        assert rig.axis.connect() in ("Grbl 1.1h ['$' for help]", "Horus 0.2 ['$' for help]")
        for call in (rig.axis.position, lambda rig=rig: rig.axis.move_to(1.0)):
            with pytest.raises(AxisError, match="just started.*mark and reference the axis"):
                call()
        with pytest.raises(AxisError, match="just started"):
            rig.axis.set_laser(True)
        rig.axis.reference()
        assert rig.axis.move_to(9.0) == 9.0


@pytest.mark.parametrize("angle", [float("nan"), float("inf")])
def test_an_angle_that_is_no_number_never_reaches_the_line(rig: Rig, angle: float) -> None:
    """It is refused before anything is sent."""
    sent = len(rig.firmware.received)
    with pytest.raises(InputError, match="degrees"):
        rig.axis.move_to(angle)
    assert len(rig.firmware.received) == sent


def test_impossible_settings_are_refused() -> None:
    """Speed, patience and the number of the laser have their ranges."""
    with pytest.raises(InputError, match="speed"):
        GrblAxis("/dev/null", speed=0.0)
    with pytest.raises(InputError, match="patience_s"):
        GrblAxis("/dev/null", patience_s=float("nan"))
    with pytest.raises(InputError, match="laser must be 1 or 2"):
        HorusAxis("/dev/null", laser=3)


def test_grbl_modes_are_sent_again_after_every_reset(make_rig: MakeRig) -> None:
    """A reset falls back to other modes; absolute degrees and the feed come first again."""
    rig = make_rig("grbl")
    with rig.axis as axis:
        axis.reference()
        axis.move_to(9.0)
        axis.stop()
        rig.firmware.received.clear()
        axis.move_to(18.0)
    received = rig.firmware.received
    modes = ("G21 G90 G94 G54", "G92.1", "M5", "G1 F5400.000")
    assert tuple(received[:4]) == modes
    assert received.index("G1 X18.0000 F5400.000") > received.index("$#") > 3


def test_horus_holds_its_motor_and_uses_degrees_a_second(make_rig: MakeRig) -> None:
    """The motor gets current before the first move; the second laser can be chosen."""
    rig = make_rig("horus")
    with HorusAxis(rig.firmware.path, laser=2, speed=45.0, patience_s=0.5) as axis:
        axis.reference()
        axis.move_to(9.0)
        axis.set_laser(True)
        received = rig.firmware.received
        assert received.index("M17") < received.index("G50") < received.index("G1 X9.0000 F45.000")
        assert received[-1] == "M71 T2"
