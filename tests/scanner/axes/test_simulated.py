"""The simulated axis: the protocol with no line behind it."""

from __future__ import annotations

import threading
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from depthwarp.errors import InputError
from depthwarp.scanner.axes import AxisStoppedError, SimulatedAxis, StepMotor
from depthwarp.scanner.axis import AxisLostError, AxisState


@given(st.floats(-360.0, 360.0))
def test_the_reported_angle_is_the_true_one_on_the_grid(angle: float) -> None:
    """Without missed steps the report is the truth, at most half a step from the angle asked."""
    with SimulatedAxis() as axis:
        reported = axis.move_to(angle)
        assert reported == axis.true_angle == axis.position()
        assert reported * 3200 / 360 == pytest.approx(round(angle * 3200 / 360), abs=1e-9)


def test_virtual_time_moves_on_by_the_motion() -> None:
    """A turn at 30 degrees/s lasts 12 s of the motor's time and none of ours."""
    began = time.monotonic()
    with SimulatedAxis(speed=30.0) as axis:
        axis.move_to(360.0)
        assert 12.0 < axis.time_s < 12.2
    assert time.monotonic() - began < 1.0


def test_reference_zeroes_the_report_and_not_the_head() -> None:
    """After `reference` the same place is 0 degrees."""
    with SimulatedAxis() as axis:
        axis.move_to(90.0)
        axis.reference()
        assert (axis.position(), axis.true_angle) == (0.0, 90.0)


def test_missed_steps_show_in_the_truth_only() -> None:
    """The report says where the motor should be."""
    axis = SimulatedAxis(StepMotor(missed_share=0.2, seed=1))
    with axis:
        assert axis.move_to(90.0) == 90.0
        assert 60.0 < axis.true_angle < 80.0


def test_stop_ends_a_move_in_real_time() -> None:
    """Another thread's `stop` makes `move_to` raise, with the laser off."""
    with SimulatedAxis(speed=10.0, real_time=True) as axis:
        axis.set_laser(True)
        threading.Timer(0.05, axis.stop).start()
        began = time.monotonic()
        with pytest.raises(AxisStoppedError):
            axis.move_to(90.0)
        assert time.monotonic() - began < 2.0
        assert not axis.laser_on
        assert axis.state() is AxisState.IDLE
        assert 0.0 < axis.position() < 45.0


def test_a_real_move_takes_its_time() -> None:
    """3 degrees at 60 degrees/s take at least 50 ms."""
    with SimulatedAxis(speed=60.0, real_time=True) as axis:
        began = time.monotonic()
        assert axis.move_to(9.0) == 9.0
        assert time.monotonic() - began >= 0.15


def test_leaving_switches_the_laser_off() -> None:
    """On an exception too; afterwards the axis is lost."""
    axis = SimulatedAxis()
    with pytest.raises(KeyError), axis:
        axis.set_laser(True)
        raise KeyError
    assert not axis.laser_on
    assert axis.state() is AxisState.LOST
    with pytest.raises(AxisLostError, match="connect"):
        axis.move_to(1.0)


def test_an_angle_that_is_no_number_is_refused() -> None:
    """NaN would end nowhere."""
    with SimulatedAxis() as axis, pytest.raises(InputError, match="degrees"):
        axis.move_to(float("nan"))
