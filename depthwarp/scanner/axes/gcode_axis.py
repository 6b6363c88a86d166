"""What the axes that speak g-code have in common: the order of things, and being safe."""

from __future__ import annotations

import time
import weakref
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import ClassVar, Self

from depthwarp.checks import check_finite_vector, check_positive
from depthwarp.scanner.axes.controller import AxisStoppedError, Controller, Dialect
from depthwarp.scanner.axes.status import Status
from depthwarp.scanner.axis import (
    AxisAlarmError,
    AxisError,
    AxisLostError,
    AxisState,
    AxisTimeoutError,
)

__all__ = ["GcodeAxis"]

_QUICK_POLL_S = 0.02  # before the second request, as most waits are short
_POLL_S = 0.1  # GRBL advises at most 10 status requests a second
_SAME_ANGLE = 1e-4  # finer than the three decimals of a report [degrees]
_ZERO = 0.002  # a zeroed controller reports 0 up to the rounding of two numbers [degrees]
_FARTHEST_STEP = 1.0  # more than half a full step of a motor without gear, 0.9 [degrees]


class GcodeAxis(ABC):
    """An axis behind a controller of the GRBL family.

    After a boot of the controller, an alarm or a restart the position means nothing: `move_to`,
    `position` and `set_laser(True)` refuse until `reference`. Leaving the `with` block, an
    exception in a move, and even forgetting the object stop the motor and switch the laser off.

    Args:
        port: Anything that `serial.serial_for_url` takes: `/dev/ttyUSB0`, `COM3`,
            `socket://host:port`, `spy:///dev/ttyUSB0?file=log.txt`.
        speed: Turning speed [degrees a second]. The controller's own limit must not be lower
            than half of it, or the longest moves run into their timeout.
        baudrate: Speed of the line [baud].
        patience_s: How long the controller may take to start or to answer [s].

    Raises:
        InputError: A speed or a time that is not above zero.
    """

    dialect: ClassVar[Dialect]

    def __init__(
        self, port: str, *, speed: float = 30.0, baudrate: int = 115200, patience_s: float = 4.0
    ) -> None:
        self.port = port
        self.speed = check_positive("speed", speed, "degrees a second")
        self.patience_s = check_positive("patience_s", patience_s, "seconds")
        self.baudrate = baudrate
        self._controller: Controller | None = None
        self._leave_safe: weakref.finalize[[Controller], GcodeAxis] | None = None
        self._is_prepared = False

    @abstractmethod
    def _prepare(self, ticket: int) -> None:
        """Set the modes that a reset of the controller has lost."""

    @abstractmethod
    def _zero(self, ticket: int) -> None:
        """Make the present position 0 degrees."""

    @abstractmethod
    def _move_lines(self, degrees: float) -> Sequence[str]:
        """Lines that turn to an angle; the answer to the last comes after the motion."""

    @abstractmethod
    def _laser_lines(self, on: bool) -> Sequence[str]:
        """Lines that switch the laser; the answer to the last comes after it is done."""

    @abstractmethod
    def _angle(self, status: Status) -> float:
        """Angle since the last zero [degrees] that a status report tells."""

    def connect(self) -> str:
        """See `Axis.connect`. A controller that was moving is stopped, its laser switched off."""
        self.close()
        controller = Controller(self.port, self.baudrate, self.dialect)
        controller.line.open()
        self._controller = controller
        self._leave_safe = weakref.finalize(self, Controller.abandon, controller)
        try:
            greeting = controller.greet(self.patience_s)
            if controller.poll(self.patience_s).state is not AxisState.ALARM:
                self._prepare_once(controller.line.draw_ticket())
        except BaseException:
            self.close()
            raise
        return greeting

    def reference(self) -> None:
        """See `Axis.reference`."""
        controller = self._connected()
        with self._stopped_on_failure():
            self._recover(controller)
            ticket = controller.line.draw_ticket()
            self._prepare_once(ticket)
            self._wait_for_standstill()
            self._zero(ticket)
            if abs(angle := self._wait_for_standstill()) > _ZERO:
                raise AxisError(
                    f"the controller on {self.port} reports {angle} degrees after it was zeroed"
                )

    def move_to(self, degrees: float) -> float:
        """See `Axis.move_to`. The time allowed is `patience_s` plus twice what the move takes."""
        (target,) = check_finite_vector("degrees", [degrees], 1)
        controller = self._trusted()
        ticket = controller.line.draw_ticket()
        with self._stopped_on_failure():
            self._prepare_once(ticket)
            turn = abs(target - self._wait_for_standstill())
            allowed_s = self.patience_s + 2.0 * turn / self.speed
            for line in self._move_lines(target):
                controller.line.command(
                    line, allowed_s, ticket, lambda: controller.watch_motion(ticket)
                )
            reached = self._wait_for_standstill()
            controller.check()
            if abs(reached - target) > _FARTHEST_STEP:
                raise AxisError(
                    f"the head stands still at {reached} degrees instead of {target}: the move "
                    "was cut short, something else commands the controller, or its steps are "
                    "coarser than 2 degrees"
                )
        return reached

    def position(self) -> float:
        """See `Axis.position`.

        Raises:
            AxisError: The position cannot be trusted, or the controller does not answer.
        """
        controller = self._trusted()
        status = controller.poll(self.patience_s)
        controller.check()
        return self._angle(status)

    def state(self) -> AxisState:
        """See `Axis.state`."""
        if self._controller is None:
            return AxisState.LOST
        if isinstance(self._controller.fault, AxisAlarmError):
            return AxisState.LOST if self._controller.line.is_lost else AxisState.ALARM
        try:
            return self._controller.poll(self.patience_s).state
        except AxisError:
            return AxisState.LOST

    def set_laser(self, on: bool) -> None:
        """See `Axis.set_laser`. Switching off works in an alarm too, by way of `stop`."""
        controller = self._trusted() if on else self._connected()
        if controller.fault is not None:
            self.stop()
            controller.line.check_link()
            return
        ticket = controller.line.draw_ticket()
        with self._stopped_on_failure():
            self._prepare_once(ticket)
            controller.laser_on = controller.laser_on or on
            for line in self._laser_lines(on):
                controller.line.command(line, self.patience_s, ticket)
            controller.laser_on = on

    def stop(self) -> None:
        """See `Axis.stop`. May be called from any thread; a move under way raises there.

        A motor that can brake within half a second while the laser is off keeps its position;
        in any other motion the position is lost, and the controller goes into alarm.
        """
        self._is_prepared = False
        if self._controller is not None:
            self._controller.make_safe()

    def close(self) -> None:
        """See `Axis.close`."""
        if self._leave_safe is not None:
            self._leave_safe()
        self._is_prepared = False
        self._controller = None

    def __enter__(self) -> Self:
        """Connect."""
        self.connect()
        return self

    def __exit__(self, *exception: object) -> None:
        """Close, on every way out."""
        self.close()

    def _connected(self) -> Controller:
        if self._controller is None:
            raise AxisLostError(f"the axis on {self.port} is not connected: call connect() first")
        self._controller.line.check_link()
        return self._controller

    def _trusted(self) -> Controller:
        controller = self._connected()
        controller.check()
        return controller

    def _recover(self, controller: Controller) -> None:
        """Bring the controller out of alarm, hold or motion, into rest.

        The reset also makes the parser's position the counted steps. Before, it is the angle that
        was asked for last, and a zero would be off by the rounding to whole steps.
        """
        self._is_prepared = False
        if not controller.reset(self.patience_s):
            raise AxisTimeoutError(
                f"the controller on {self.port} did not come back from a reset; "
                f"{controller.line.describe_heard()}; switch it off and on"
            )
        if controller.poll(self.patience_s).state is not AxisState.IDLE:
            controller.line.command("$X", self.patience_s, controller.line.draw_ticket())
        controller.clear_fault()

    def _prepare_once(self, ticket: int) -> None:
        if not self._is_prepared:
            self._prepare(ticket)
            self._is_prepared = True

    def _command(self, text: str, ticket: int) -> None:
        self._connected().line.command(text, self.patience_s, ticket)

    def _wait_for_standstill(self) -> float:
        """Poll until two reports in a row say idle at one angle; return it [degrees].

        Two, because one digit that was damaged on the way would go unnoticed.
        """
        controller = self._connected()
        deadline = time.monotonic() + self.patience_s
        pause_s, previous = _QUICK_POLL_S, None
        while True:
            status = controller.poll(self.patience_s)
            controller.check()
            angle = self._angle(status) if status.state is AxisState.IDLE else None
            if angle is not None and previous is not None and abs(angle - previous) < _SAME_ANGLE:
                return angle
            previous = angle
            if angle is None and time.monotonic() > deadline:
                raise AxisTimeoutError(
                    f"the controller on {self.port} reports no standstill but "
                    f"{status.name}; {controller.line.describe_heard()}"
                )
            if angle is None:
                time.sleep(pause_s)
                pause_s = _POLL_S

    @contextmanager
    def _stopped_on_failure(self) -> Iterator[None]:
        """Stop the machine when the block fails, unless `stop` is why it failed."""
        try:
            yield
        except AxisStoppedError:
            self._is_prepared = False
            raise
        except AxisLostError as error:
            self._is_prepared = False
            if self._controller is not None and self._controller.laser_on:
                raise AxisLostError(f"{error}. The laser may be on: switch it off") from error
            raise
        except BaseException:
            self.stop()
            raise
