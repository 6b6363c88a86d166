"""The step motor's arithmetic: grid, ramp, braking, missed steps."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from depthwarp.errors import InputError
from depthwarp.scanner.axes.motor import StepMotor

ANGLES = st.floats(-720.0, 720.0)


@given(st.lists(ANGLES, min_size=1, max_size=6), st.floats(1.0, 400.0))
def test_a_move_ends_on_the_nearest_step(angles: list[float], steps_per_degree: float) -> None:
    """After its duration a move stands on the step nearest to the angle, and so does the head."""
    motor = StepMotor(steps_per_degree=steps_per_degree)
    now = 0.0
    for angle in angles:
        now += motor.start(motor.nearest_count(angle), 30.0, now) + 1e-9
        assert not motor.is_moving(now)
        assert motor.count(now) == round(angle * steps_per_degree)
        assert motor.true_angle(now) == motor.angle(now)


def test_the_ramp_is_the_textbook_one() -> None:
    """90 degrees at 30 degrees/s with 60 degrees/s2: 3 s of way and half a second of ramps."""
    motor = StepMotor(steps_per_degree=100.0, acceleration=60.0)
    assert motor.start(9000, 30.0, 10.0) == pytest.approx(3.5)
    assert motor.angle(10.5) == pytest.approx(7.5, abs=0.02)  # a t^2 / 2
    assert motor.angle(11.5) == pytest.approx(37.5, abs=0.02)
    assert motor.angle(13.0) == pytest.approx(82.5, abs=0.02)
    assert motor.is_moving(13.49)
    assert motor.angle(13.51) == 90.0


def test_a_short_move_never_reaches_its_speed() -> None:
    """1 degree at 60 degrees/s2 takes 2 sqrt(1 / 60) s, whatever the speed."""
    assert StepMotor(steps_per_degree=100.0, acceleration=60.0).start(100, 90.0, 0.0) == (
        pytest.approx(2 * (1 / 60) ** 0.5)
    )


def test_braking_takes_the_way_of_its_ramp() -> None:
    """From 30 degrees/s with 60 degrees/s2: 7.5 degrees in half a second, either direction."""
    for sign in (1, -1):
        motor = StepMotor(steps_per_degree=100.0, acceleration=60.0)
        motor.start(sign * 9000, 30.0, 0.0)
        before = motor.angle(2.0)
        motor.brake(2.0)
        assert motor.is_moving(2.49)
        assert not motor.is_moving(2.51)
        assert motor.angle(2.51) - before == pytest.approx(sign * 7.5, abs=0.02)


def test_halting_keeps_what_was_covered() -> None:
    """The motor stands at once, and the next move goes from there."""
    motor = StepMotor(steps_per_degree=10.0)
    motor.start(900, 30.0, 0.0)
    motor.halt(1.0)
    reached = motor.count(1.0)
    assert 0 < reached < 900
    assert motor.count(5.0) == reached
    motor.start(0, 30.0, 5.0)
    assert motor.count(100.0) == 0


def test_missed_steps_part_the_head_from_the_count() -> None:
    """Three missed steps stay missed, over later moves and a zero."""
    motor = StepMotor(steps_per_degree=10.0)
    motor.miss(3)
    motor.start(100, 30.0, 0.0)
    assert (motor.angle(9.0), motor.true_angle(9.0)) == (10.0, 9.7)
    motor.zero(9.0)
    assert (motor.angle(9.0), motor.true_angle(9.0)) == (0.0, 9.7)
    motor.start(-100, 30.0, 9.0)
    assert motor.angle(99.0) == -10.0
    assert motor.true_angle(99.0) == pytest.approx(-0.3)


def test_random_misses_follow_the_seed() -> None:
    """The same seed misses the same steps, about the share that was asked for."""

    def run(seed: int) -> float:
        motor = StepMotor(steps_per_degree=100.0, missed_share=0.1, seed=seed)
        motor.start(10_000, 30.0, 0.0)
        return motor.true_angle(1e6)

    assert run(1) == run(1)
    assert run(1) != run(2)
    assert run(1) == pytest.approx(90.0, abs=1.5)  # 5 sigma of the draw


@pytest.mark.parametrize(
    "arguments",
    [{"steps_per_degree": 0.0}, {"max_speed": -1.0}, {"acceleration": 0.0}, {"missed_share": 1.1}],
)
def test_impossible_motors_are_refused(arguments: dict[str, float]) -> None:
    """Each argument has its range."""
    with pytest.raises(InputError, match=next(iter(arguments))):
        StepMotor(**arguments)  # type: ignore[arg-type]
