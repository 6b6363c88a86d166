"""How the twin's camera and axis are coupled: where the head truly points, what the laser does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

__all__ = ["HeadState", "StillHead"]


class HeadState(Protocol):
    """The physical head, as the twin's camera meets it; a simulated axis or firmware is one.

    It may say something else than the controller reports: that is how steps are missed.
    """

    @property
    def true_angle(self) -> float:
        """Where the head points now [degrees], counter-clockwise seen from above."""
        ...

    @property
    def laser_on(self) -> bool:
        """Whether the laser is lit."""
        ...


@dataclass
class StillHead:
    """A head without a motor: it points wherever it is told to.

    Attributes:
        true_angle: Where it points [degrees].
        laser_on: Whether the laser is lit.
    """

    true_angle: float = 0.0
    laser_on: bool = False
