"""The axis that is a person."""

from __future__ import annotations

import pytest

from depthwarp.scanner.axes import ManualAxis
from depthwarp.scanner.axis import AxisError, AxisLostError, AxisState


class Person:
    """Answers as told and remembers what was said."""

    def __init__(self, *answers: float | None) -> None:
        self.answers = list(answers)
        self.asked: list[str] = []
        self.told: list[str] = []

    def ask(self, text: str) -> float | None:
        self.asked.append(text)
        return self.answers.pop(0) if self.answers else None

    def axis(self) -> ManualAxis:
        return ManualAxis(self.ask, self.told.append)


def test_the_answer_is_the_angle() -> None:
    """What the person read counts, not what was asked for."""
    person = Person(29.75, None)
    with person.axis() as axis:
        assert axis.move_to(30.0) == 29.75
        assert "30 degrees" in person.asked[0]
        assert axis.position() == 29.75
        assert axis.move_to(45.0) == 45.0
        axis.reference()
        assert axis.position() == 0.0


def test_an_answer_that_is_no_angle_is_refused() -> None:
    """Infinity is no place to be."""
    with Person(float("inf")).axis() as axis, pytest.raises(AxisError, match="number"):
        axis.move_to(30.0)


def test_the_laser_is_asked_for_and_told_off_at_the_end() -> None:
    """Whoever leaves with the laser on is told, once."""
    person = Person()
    with person.axis() as axis:
        axis.set_laser(True)
        assert "on" in person.asked[0]
    assert person.told == ["Switch the laser off."]
    axis.close()
    assert len(person.told) == 1


def test_stop_never_raises() -> None:
    """Not even when nobody can be told."""

    def cannot_tell(text: str) -> None:
        raise OSError(text)

    axis = ManualAxis(lambda text: None, cannot_tell)
    axis.connect()
    axis.set_laser(True)
    axis.stop()
    assert axis.state() is AxisState.IDLE
    axis.close()
    assert axis.state() is AxisState.LOST
    with pytest.raises(AxisLostError):
        axis.position()
