"""A motor axis in this process: no controller, no line."""

from __future__ import annotations

import threading
import time

from depthwarp.checks import check_finite_vector, check_positive
from depthwarp.scanner.axes.controller import AxisStoppedError
from depthwarp.scanner.axes.local import LocalAxis
from depthwarp.scanner.axes.motor import StepMotor
from depthwarp.scanner.axis import AxisState

__all__ = ["SimulatedAxis"]


class SimulatedAxis(LocalAxis):
    """An axis with a step grid and a speed ramp, whose true angle can be asked for.

    Made at its mark, it needs no `reference` before the first move.

    Args:
        motor: The motor, with its step grid and its missed steps; by default 3200 steps a turn,
            none missed.
        speed: Turning speed [degrees a second].
        real_time: Whether a move takes its time. Otherwise it is over at once, and only
            `time_s` moves on.

    Raises:
        InputError: A speed that is not above zero.
    """

    def __init__(
        self, motor: StepMotor | None = None, *, speed: float = 30.0, real_time: bool = False
    ) -> None:
        super().__init__("simulated axis")
        self.motor = motor if motor is not None else StepMotor()
        self.speed = check_positive("speed", speed, "degrees a second")
        self.laser_on = False
        self._real_time = real_time
        self._virtual_time_s = 0.0
        self._lock = threading.Lock()
        self._stopped = threading.Event()

    @property
    def time_s(self) -> float:
        """The motor's clock [s]: virtual, or the real one."""
        return time.monotonic() if self._real_time else self._virtual_time_s

    @property
    def true_angle(self) -> float:
        """Where the head really is [degrees], since the motor was made."""
        with self._lock:
            return self.motor.true_angle(self.time_s)

    def connect(self) -> str:
        """See `Axis.connect`."""
        self.laser_on = False
        return super().connect()

    def reference(self) -> None:
        """See `Axis.reference`."""
        self._check()
        with self._lock:
            self.motor.zero(self.time_s)

    def move_to(self, degrees: float) -> float:
        """See `Axis.move_to`."""
        (target,) = check_finite_vector("degrees", [degrees], 1)
        self._check()
        with self._lock:
            self._stopped.clear()
            duration = self.motor.start(self.motor.nearest_count(target), self.speed, self.time_s)
            if not self._real_time:
                self._virtual_time_s += duration
        if self._real_time and self._stopped.wait(duration):
            raise AxisStoppedError("the move was ended by stop()")
        return self.position()

    def position(self) -> float:
        """See `Axis.position`."""
        self._check()
        with self._lock:
            return self.motor.angle(self.time_s)

    def state(self) -> AxisState:
        """See `Axis.state`."""
        if not self._connected:
            return AxisState.LOST
        with self._lock:
            return AxisState.RUN if self.motor.is_moving(self.time_s) else AxisState.IDLE

    def set_laser(self, on: bool) -> None:
        """See `Axis.set_laser`."""
        self._check()
        self.laser_on = on

    def stop(self) -> None:
        """See `Axis.stop`."""
        self.laser_on = False
        with self._lock:
            self.motor.halt(self.time_s)
            self._stopped.set()
