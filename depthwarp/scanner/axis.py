"""The motor axis that turns the head: what it can do, its states, and how it can fail."""

from __future__ import annotations

from enum import StrEnum
from typing import Any, Protocol

from depthwarp.errors import DepthwarpError

__all__ = [
    "Axis",
    "AxisAlarmError",
    "AxisError",
    "AxisLostError",
    "AxisRestartedError",
    "AxisState",
    "AxisTimeoutError",
]


class AxisError(DepthwarpError):
    """The axis did not do what it was told."""


class AxisTimeoutError(AxisError):
    """No answer, or no standstill, in the time that the move should have taken."""


class AxisAlarmError(AxisError):
    """The controller is in alarm; its position cannot be trusted until it is referenced again."""


class AxisRestartedError(AxisError):
    """The controller restarted on its own: its position is lost until it is referenced again."""


class AxisLostError(AxisError):
    """The link to the controller is gone."""


class AxisState(StrEnum):
    """What the axis is doing."""

    IDLE = "idle"
    RUN = "run"
    HOLD = "hold"
    ALARM = "alarm"
    LOST = "lost"


class Axis(Protocol):
    """A turning axis with the laser's switch on it. A context manager that leaves it safe.

    Angles are in degrees, counter-clockwise seen from above, in the frame that `reference` sets.
    """

    def connect(self) -> str:
        """Open the link and make sure that the right controller answers; returns its greeting.

        Raises:
            InputError: There is no such port.
            AxisError: In use, silent, or something else answers.
        """
        ...

    def reference(self) -> None:
        """Take the present position as 0 degrees and clear alarms and restarts."""
        ...

    def move_to(self, degrees: float) -> float:
        """Turn to an angle, wait until the head stands still, and return the reported angle.

        The reported angle is what counts in the triangulation: it lies on the motor's step grid.

        Raises:
            AxisError: Alarm, restart, lost link, or no standstill in time. The motor is stopped.
        """
        ...

    def position(self) -> float:
        """The angle that the controller reports now [degrees]."""
        ...

    def state(self) -> AxisState:
        """What the axis is doing now; `LOST` when it does not answer."""
        ...

    def set_laser(self, on: bool) -> None:
        """Switch the laser; returns when the controller has carried it out."""
        ...

    def stop(self) -> None:
        """Stop the motor and switch the laser off, from any state; never raises."""
        ...

    def close(self) -> None:
        """`stop`, then close the link; never raises."""
        ...

    def __enter__(self) -> Any:
        """Connect."""
        ...

    def __exit__(self, *exception: object) -> None:
        """Close, on every way out."""
        ...
