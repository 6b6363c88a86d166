"""A motor axis that is a person: told where to turn the head, asked where it stands."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Iterator

from depthwarp.checks import check_finite_vector
from depthwarp.scanner.axes.local import LocalAxis
from depthwarp.scanner.axis import AxisError, AxisState

__all__ = ["ManualAxis"]


class ManualAxis(LocalAxis):
    """A head that a person turns, on a divided circle for example.

    Args:
        ask: Shows a text and waits. Returns the number that was given, or None for "just as the
            text says". Whoever wants to leave lets it raise; that ends the move.
        tell: Shows a text and does not wait.
    """

    def __init__(self, ask: Callable[[str], float | None], tell: Callable[[str], None]) -> None:
        super().__init__("manual axis")
        self._ask = ask
        self._tell = tell
        self._laser_on = False
        self._angle = 0.0

    def reference(self) -> None:
        """See `Axis.reference`."""
        self._check()
        self._ask("The present position of the head is now 0 degrees. Note it, then press Enter.")
        self._angle = 0.0

    def move_to(self, degrees: float) -> float:
        """See `Axis.move_to`.

        Raises:
            AxisError: The answer is no angle.
        """
        (target,) = check_finite_vector("degrees", [degrees], 1)
        self._check()
        answer = self._ask(
            f"Turn the head to {target:g} degrees and let go. Angle reached [degrees], just Enter "
            f"for {target:g}:"
        )
        reached = target if answer is None else float(answer)
        if not math.isfinite(reached):
            raise AxisError(f"the angle reached must be a number of degrees, got {reached}")
        self._angle = reached
        return reached

    def position(self) -> float:
        """See `Axis.position`: what was answered last."""
        self._check()
        return self._angle

    def state(self) -> AxisState:
        """See `Axis.state`."""
        return AxisState.IDLE if self._connected else AxisState.LOST

    def set_laser(self, on: bool) -> None:
        """See `Axis.set_laser`."""
        self._check()
        self._laser_on = self._laser_on or on
        self._ask(f"Switch the laser {'on' if on else 'off'}, then press Enter.")
        self._laser_on = on

    @contextlib.contextmanager
    def left_alone(self) -> Iterator[None]:
        """Have the laser switched off while nobody asks; afterwards as it was before."""
        if self._laser_on:
            self._tell("Switch the laser off.")
        yield
        if self._laser_on:
            self._tell("Switch the laser on again.")

    def stop(self) -> None:
        """See `Axis.stop`."""
        if self._laser_on:
            with contextlib.suppress(Exception):
                self._tell("Switch the laser off.")
                self._laser_on = False
