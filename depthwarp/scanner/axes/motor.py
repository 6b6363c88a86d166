"""A stepping motor that exists as arithmetic only: whole steps, a speed ramp, missed steps."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from depthwarp.checks import check_positive
from depthwarp.errors import InputError

__all__ = ["StepMotor"]


@dataclass(frozen=True)
class _Ramp:
    """Motion as phases of constant acceleration: (duration [s], first speed, acceleration)."""

    phases: tuple[tuple[float, float, float], ...]

    @classmethod
    def over(cls, distance: float, speed: float, acceleration: float) -> _Ramp:
        """From rest to rest: a trapezoid of speed, or a triangle where the way is short."""
        top = min(speed, math.sqrt(distance * acceleration))
        if top == 0.0:
            return cls(())
        rising = top / acceleration
        cruising = distance / top - rising
        up, down = (rising, 0.0, acceleration), (rising, top, -acceleration)
        return cls((up, (cruising, top, 0.0), down))

    @property
    def duration(self) -> float:
        return sum(phase[0] for phase in self.phases)

    def at(self, time: float) -> tuple[float, float]:
        """Distance covered and speed at a time since the start."""
        distance = speed = 0.0
        for duration, first_speed, acceleration in self.phases:
            spent = min(max(time, 0.0), duration)
            distance += first_speed * spent + 0.5 * acceleration * spent * spent
            speed = first_speed + acceleration * spent
            if time < duration:
                return distance, speed
            time -= duration
        return distance, 0.0


class StepMotor:
    """A motor that counts its steps, and a head that may not have followed all of them.

    Times are seconds on any clock that never runs backwards; the motor keeps none of its own.

    Args:
        steps_per_degree: Whole steps of the grid in one degree.
        max_speed: Fastest turning [degrees a second].
        acceleration: Of the ramps at both ends of a move [degrees a second squared].
        missed_share: Probability that the head does not follow a step.
        seed: Of the draw of missed steps.

    Raises:
        InputError: An argument outside of its range.
    """

    def __init__(
        self,
        *,
        steps_per_degree: float = 3200 / 360,
        max_speed: float = 90.0,
        acceleration: float = 720.0,
        missed_share: float = 0.0,
        seed: int = 0,
    ) -> None:
        self.steps_per_degree = check_positive("steps_per_degree", steps_per_degree)
        self._max_speed = check_positive("max_speed", max_speed, "degrees a second")
        self._acceleration = check_positive("acceleration", acceleration)
        if not 0.0 <= missed_share <= 1.0:
            raise InputError(f"missed_share must be from 0 to 1, got {missed_share}")
        self._missed_share = missed_share
        self._random = np.random.default_rng(seed)
        self._to_miss = 0
        self._first_count = 0  # where the move under way began
        self._steps = 0  # its length, with sign
        self._direction = 1.0  # of the last move
        self._missed = 0  # of these, how many the head does not follow
        self._ramp = _Ramp(())
        self._began = 0.0
        self._head_ahead = 0  # steps of the head less steps counted, when the move began

    def start(self, target_count: int, speed: float, now: float) -> float:
        """Begin a move to a step of the grid; returns how long it takes [s]."""
        self._finish(now)
        self._steps = target_count - self._first_count
        length = abs(self._steps)
        self._missed = min(length, self._to_miss + self._draw_missed(length))
        self._to_miss = 0
        self._ramp = _Ramp.over(
            length / self.steps_per_degree, min(speed, self._max_speed), self._acceleration
        )
        self._began = now
        return self._ramp.duration

    def is_moving(self, now: float) -> bool:
        """Whether the move is not over yet."""
        return now - self._began < self._ramp.duration

    def remaining_s(self, now: float) -> float:
        """Time until the move is over [s]."""
        return max(0.0, self._began + self._ramp.duration - now)

    def count(self, now: float) -> int:
        """Steps counted since the zero: what a controller knows."""
        return self._first_count + self._covered(now)

    def angle(self, now: float) -> float:
        """Angle that the counted steps make [degrees]."""
        return self.count(now) / self.steps_per_degree

    def true_angle(self, now: float) -> float:
        """Where the head really is [degrees], since the motor was made."""
        covered = self._covered(now)
        missed = round(self._missed * abs(covered) / abs(self._steps)) if self._steps else 0
        followed = covered - int(math.copysign(missed, self._steps))
        return (self._first_count + self._head_ahead + followed) / self.steps_per_degree

    def nearest_count(self, degrees: float) -> int:
        """The step of the grid that is nearest to an angle."""
        return round(degrees * self.steps_per_degree)

    def brake(self, now: float) -> None:
        """Come to rest by the ramp, wherever that is."""
        _, speed = self._ramp.at(now - self._began)
        self._finish(now)
        braking = speed / self._acceleration
        way = round(0.5 * speed * braking * self.steps_per_degree)
        self._steps = int(math.copysign(way, self._direction))
        self._ramp = _Ramp(((braking, speed, -self._acceleration),) if way else ())
        self._began = now

    def halt(self, now: float) -> None:
        """Stand still at once."""
        self._finish(now)

    def zero(self, now: float) -> None:
        """Count from 0 here; the head stays where it is."""
        self._finish(now)
        self._head_ahead += self._first_count
        self._first_count = 0

    def miss(self, steps: int) -> None:
        """Let the head not follow so many steps of the next move."""
        self._to_miss += steps

    def _covered(self, now: float) -> int:
        if not self.is_moving(now):
            return self._steps
        distance, _ = self._ramp.at(now - self._began)
        covered = min(abs(self._steps), int(distance * self.steps_per_degree))
        return int(math.copysign(covered, self._steps))

    def _finish(self, now: float) -> None:
        """Make what was covered until now the place where the next move begins."""
        covered = self._covered(now)
        head = self.true_angle(now) * self.steps_per_degree
        self._direction = math.copysign(1.0, self._steps)
        self._first_count += covered
        self._head_ahead = round(head) - self._first_count
        self._steps = self._missed = 0
        self._ramp = _Ramp(())

    def _draw_missed(self, length: int) -> int:
        return int(self._random.binomial(length, self._missed_share)) if self._missed_share else 0
