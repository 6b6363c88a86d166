"""What is known of a g-code controller from what it pushes, and how to make it safe."""

from __future__ import annotations

import contextlib
import re
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from depthwarp.scanner.axes.serial_line import SerialLine
from depthwarp.scanner.axes.status import Status, parse_status
from depthwarp.scanner.axis import (
    AxisAlarmError,
    AxisError,
    AxisRestartedError,
    AxisState,
    AxisTimeoutError,
)

__all__ = ["AxisStoppedError", "Controller", "Dialect"]

_FEED_HOLD = b"!"
_SOFT_RESET = b"\x18"
_REPORT_POSITION = b"?"

_POLL_AGAIN_S = 0.25  # a report can get lost on the way
_BRAKING_S = 0.5  # longest time that a stop waits for the motor to brake by itself
_SAFE_ANSWER_S = 1.0  # a stop must not hang on a controller that does not answer

_ALARMS = {
    "1": "a limit switch was hit",
    "2": "a move beyond the soft limits",
    "3": "reset while the motor turned",
    "6": "homing was reset",
    "7": "homing: the door was opened",
    "8": "homing: the limit switch stayed closed",
    "9": "homing: no limit switch was found",
}
_PARAMETER = re.compile(r"\[(G\d+):([-+]?\d+(?:\.\d+)?)(?:,[^\]]*)?\]")


class AxisStoppedError(AxisError):
    """A move was ended by `stop`."""


@dataclass(frozen=True)
class Dialect:
    """What distinguishes one kind of controller, as far as finding and stopping it goes.

    Attributes:
        name: For people.
        banner: How its greeting begins.
        laser_off: Lines that switch every laser off.
    """

    name: str
    banner: re.Pattern[str]
    laser_off: tuple[str, ...]


class Controller:
    """A controller of the GRBL family behind a serial line.

    It keeps the last status report, remembers a `fault` (an alarm, or a restart that nobody asked
    for) until `clear_fault`, and can bring the machine to a safe state.

    Attributes:
        fault: Why the position cannot be trusted, None where it can.
        laser_on: Whether the laser may be on: set before it is switched on, cleared after it is
            known to be off.
        parameters: First number of each parameter that `$#` printed, such as `G54`.
    """

    def __init__(self, port: str, baudrate: int, dialect: Dialect) -> None:
        self.dialect = dialect
        self.line = SerialLine(port, baudrate, self._hear)
        self.fault: AxisError | None = None
        self.laser_on = False
        self.parameters: dict[str, float] = {}
        self._report: Status | None = None
        self._reports = 0
        self._banner = ""
        self._banners = 0
        self._greeted = False
        self._reset_under_way = False
        self._stopping = threading.Lock()

    def greet(self, patience_s: float) -> str:
        """Find out that the right controller is there, at rest, and its laser off.

        A running controller answers a status request; it is then reset by software, which keeps
        its position if the motor stood still and gives its banner. One that says its banner by
        itself has just started, as most boards do when their port is opened, and one that
        answered only to the reset may have: their position is lost, which is a `fault`.

        Returns:
            The banner.

        Raises:
            AxisError: Silence, or something else answers.
        """
        deadline = time.monotonic() + 0.5 * patience_s
        while not self._banners and self._report is None and time.monotonic() < deadline:
            self.line.write(_REPORT_POSITION)
            self._wait_for(lambda: bool(self._banners) or self._report is not None, _POLL_AGAIN_S)
        was_running = self._report is not None and not self._banners
        if not self._banners and not self.reset(patience_s):
            raise self._stranger()
        self._greeted = True
        if not was_running:
            self.fault = AxisRestartedError(
                f"the controller on {self.line.port} has just started and does not know where "
                "the head is: turn the head to its mark and reference the axis"
            )
        return self._banner

    def poll(self, patience_s: float) -> Status:
        """Ask for a status report and return it.

        Raises:
            AxisTimeoutError: No report that makes sense came in time.
            AxisLostError: The link is gone.
        """
        before = self._reports
        deadline = time.monotonic() + patience_s
        while time.monotonic() < deadline:
            self.line.write(_REPORT_POSITION)
            wait_s = min(_POLL_AGAIN_S, patience_s)
            if self._wait_for(lambda: self._reports > before, wait_s) and self._report is not None:
                return self._report
            self.line.check_link()
        raise AxisTimeoutError(
            f"the controller on {self.line.port} sent no status within {patience_s:.1f} s; "
            f"{self.line.describe_heard()}"
        )

    def watch_motion(self, ticket: int) -> None:
        """Look after a move under way: ask for a report, raise on one that says it is held."""
        report = self._report
        self.line.write(_REPORT_POSITION, ticket)  # raises if a hold is the work of `make_safe`
        if report is not None and report.state is AxisState.HOLD:
            raise AxisError(
                f"the controller on {self.line.port} holds the move ({report.name}): somebody "
                "pressed its hold button or opened its door; release that and move again"
            )

    def check(self) -> None:
        """Raise if the link is gone or the position cannot be trusted."""
        self.line.check_link()
        if self.fault is not None:
            raise type(self.fault)(*self.fault.args)

    def clear_fault(self) -> None:
        """Trust the position again."""
        with self.line.news:
            self.fault = None

    def reset(self, patience_s: float) -> bool:
        """Reset by software: motor and laser off, modes lost, position kept if at rest.

        Returns:
            Whether the banner came.
        """
        before = self._banners
        self._reset_under_way = True
        try:
            self.line.write(_SOFT_RESET)
            answered = self._wait_for(lambda: self._banners > before, patience_s)
        finally:
            self._reset_under_way = False
        self.line.forget_answers()
        return answered

    def make_safe(self) -> None:
        """Stop the motor, switch the laser off, end every command under way; never raises."""
        with self._stopping, contextlib.suppress(AxisError):
            self.line.interrupt(AxisStoppedError("the move was ended by stop()"))
            self.line.write(_FEED_HOLD)
            if not self.laser_on:  # a motor that has braked keeps its position through the reset
                self._wait_for_braking()
            answers = self.reset(_SAFE_ANSWER_S)
            self.laser_on = self.laser_on and not answers
            for text in self.dialect.laser_off:
                self._send_laser_off(text, answers)

    def abandon(self) -> None:
        """Make safe and close the link; never raises. A stranger's device is left alone."""
        try:
            if self._greeted:
                self.make_safe()
        finally:
            self.line.close()

    def _send_laser_off(self, text: str, answers: bool) -> None:
        """Send what the reset has made needless; wait only for a controller that answers."""
        if not answers:
            self.line.write(text.encode("ascii") + b"\n")
            return
        with contextlib.suppress(AxisError):  # refused in an alarm
            self.line.command(text, _SAFE_ANSWER_S, self.line.draw_ticket())

    def _wait_for_braking(self) -> None:
        deadline = time.monotonic() + _BRAKING_S
        previous: Status | None = None
        while time.monotonic() < deadline:
            with contextlib.suppress(AxisTimeoutError):
                report = self.poll(_BRAKING_S)
                stands = previous is not None and report == previous
                if report.state in (AxisState.IDLE, AxisState.ALARM) or (
                    report.state is AxisState.HOLD and stands
                ):
                    return
                previous = report
            self._wait_for(lambda: False, 0.02)

    def _wait_for(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Wait for news that make `condition` true; False after the time or without a link."""
        with self.line.news:
            self.line.news.wait_for(lambda: condition() or self.line.is_lost, timeout_s)
            return condition()

    def _hear(self, line: str) -> None:
        """Take in a pushed line; runs in the reader's thread, under the lock of the news."""
        report = parse_status(line)
        if report is not None:
            self._report = report
            self._reports += 1
            if report.state is AxisState.ALARM:
                self._fail(AxisAlarmError, f"is in {report.name.lower()}")
        elif line.startswith("ALARM"):
            code = line.partition(":")[2].strip()  # 1.1 says a number, 0.9 a text
            meaning = f"{code}: {_ALARMS[code]}" if code in _ALARMS else code
            self._fail(AxisAlarmError, f"is in alarm ({meaning})")
        elif self.dialect.banner.match(line):
            self._banner = line
            self._banners += 1
            if self._greeted and not self._reset_under_way:
                self._fail(AxisRestartedError, "restarted by itself (a dip of its supply?)")
        elif (parameter := _PARAMETER.fullmatch(line)) is not None:
            self.parameters[parameter[1]] = float(parameter[2])

    def _fail(self, kind: type[AxisError], what: str) -> None:
        """Remember the first fault and end the command under way."""
        if self.fault is None:
            self.fault = kind(
                f"the controller on {self.line.port} {what}: its position cannot be trusted; "
                "turn the head to its mark and reference the axis again"
            )
            self.line.interrupt(self.fault)

    def _stranger(self) -> AxisError:
        if not self.line.heard:
            return AxisTimeoutError(
                f"nothing answers on {self.line.port}: is the controller switched on, is it the "
                "right port, is the baud rate right?"
            )
        return AxisError(
            f"what answers on {self.line.port} is not {self.dialect.name}; "
            f"{self.line.describe_heard()}; is it the right port, kind of axis and baud rate?"
        )
