"""A serial line to a g-code controller: one command, one answer; everything else is a push."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any

import serial

from depthwarp.errors import InputError
from depthwarp.scanner.axes.ports import describe_ports, find_port
from depthwarp.scanner.axis import AxisError, AxisLostError, AxisTimeoutError

__all__ = ["SerialLine"]

_READ_SLICE_S = 0.2  # how often the reader looks whether it should end
_WRITE_TIMEOUT_S = 1.0
_WATCH_S = 0.1  # GRBL advises at most 10 status requests a second while the motor runs
_LONGEST_LINE = 256  # a device that never ends its line must not fill the memory

_ANSWER = re.compile(r"ok|error:.*")


class SerialLine:
    """A link to a controller, with a thread that reads it.

    The thread splits what arrives: `ok` and `error:...` answer the command that is under way, any
    other line (status, message, alarm, banner) is pushed to `hear`. At most one command is under
    way. `interrupt` makes every ticket that was drawn before it void: a command that waits fails
    at once, and one that comes late is not written any more. So nothing moves after a stop.

    Args:
        port: Anything that `serial.serial_for_url` takes: `/dev/ttyUSB0`, `COM3`,
            `socket://host:port`, `spy:///dev/ttyUSB0?file=log.txt`; or `serial:NUMBER`, the
            port with that USB serial number at each opening.
        baudrate: Speed of the line [baud].
        hear: Gets each pushed line, in the reader's thread and under the lock of `news`.

    Attributes:
        news: Condition that is notified whenever a line arrives or the link is lost.
        heard: The last lines that arrived, newest last, printable.
    """

    def __init__(self, port: str, baudrate: int, hear: Callable[[str], None]) -> None:
        self.port = port
        self.news = threading.Condition()
        self.heard: deque[str] = deque(maxlen=6)
        self._baudrate = baudrate
        self._hear = hear
        self._device: Any = None
        self._reader: threading.Thread | None = None
        self._closing = False
        self._lost: str | None = None
        self._answers: deque[str] = deque()
        self._turn = threading.Lock()
        self._interruptions: list[AxisError] = []

    @property
    def is_lost(self) -> bool:
        """Whether the link broke, or was never opened, or is closed."""
        return self._device is None or self._lost is not None

    def open(self) -> None:
        """Open the port and start to listen.

        Raises:
            InputError: There is no such port.
            AxisError: It is in use, or this user may not open it.
        """
        self._device = _open_device(find_port(self.port), self._baudrate)
        self._reader = threading.Thread(target=self._read_on, name=f"axis {self.port}", daemon=True)
        self._reader.start()

    def close(self) -> None:
        """End the reader and close the port; never raises."""
        if self._device is None:
            return
        self._closing = True
        if self._reader is not None and self._reader is not threading.current_thread():
            with contextlib.suppress(Exception):  # not every kind of port can cancel
                self._device.cancel_read()
            self._reader.join(timeout=5 * _READ_SLICE_S)
        device, self._device = self._device, None
        _close_device(device)

    def draw_ticket(self) -> int:
        """Number of interruptions so far: a later command fails with the next one, if any."""
        with self.news:
            return len(self._interruptions)

    def interrupt(self, error: AxisError) -> None:
        """Void every ticket drawn so far: their commands fail with `error`."""
        with self.news:
            self._interruptions.append(error)
            self.news.notify_all()

    def forget_answers(self) -> None:
        """Drop answers that nobody waits for: a controller that was reset owes none."""
        with self.news:
            self._answers.clear()

    def write(self, data: bytes, ticket: int | None = None) -> None:
        """Send bytes, unless the ticket is void.

        Raises:
            AxisLostError: The link is gone.
            AxisTimeoutError: The device takes no more bytes.
            AxisError: The ticket was voided by `interrupt`.
        """
        with self.news:
            self._check(ticket)
            try:
                self._device.write(data)
            except serial.SerialTimeoutException as error:
                raise AxisTimeoutError(
                    f"the controller on {self.port} takes no more bytes; switch it off and on"
                ) from error
            except (serial.SerialException, OSError) as error:
                self._lose(str(error))
                raise self._loss() from error

    def command(
        self,
        text: str,
        timeout_s: float,
        ticket: int,
        meanwhile: Callable[[], None] | None = None,
    ) -> None:
        """Send one line and wait until the controller has answered `ok`.

        Args:
            text: The line, without its end.
            timeout_s: Longest time to the answer [s].
            ticket: From `draw_ticket`.
            meanwhile: Called about ten times a second as long as there is no answer.

        Raises:
            AxisLostError: The link is gone.
            AxisTimeoutError: No answer in time.
            AxisError: The answer is an error, or `interrupt` was called.
        """
        with self._turn:
            deadline = time.monotonic() + timeout_s
            with self.news:
                self._answers.clear()
                self.write(text.encode("ascii") + b"\n", ticket)
            while (answer := self._wait(deadline, ticket)) is None:
                if time.monotonic() >= deadline:
                    raise AxisTimeoutError(
                        f"the controller on {self.port} did not answer {text!r} within "
                        f"{timeout_s:.1f} s; {self.describe_heard()}"
                    )
                if meanwhile is not None:
                    meanwhile()
        if answer != "ok":
            raise AxisError(f"the controller on {self.port} refused {text!r}: {answer}")

    def _wait(self, deadline: float, ticket: int) -> str | None:
        """Return the answer, or None after a slice of time."""
        with self.news:
            self.news.wait_for(
                lambda: self._answers or self.is_lost or self._is_void(ticket),
                max(0.0, min(_WATCH_S, deadline - time.monotonic())),
            )
            self._check(ticket)
            return self._answers.popleft() if self._answers else None

    def describe_heard(self) -> str:
        """Say what the device said last."""
        with self.news:
            return f"it said last: {', '.join(self.heard)}" if self.heard else "it said nothing"

    def check_link(self) -> None:
        """Raise AxisLostError if the link is gone."""
        if self.is_lost:
            raise self._loss()

    def _check(self, ticket: int | None) -> None:
        self.check_link()
        if ticket is not None and self._is_void(ticket):
            # The first that came is the cause; a stop, say, may have led to an alarm since.
            error = self._interruptions[ticket]
            raise type(error)(*error.args)

    def _is_void(self, ticket: int) -> bool:
        return ticket < len(self._interruptions)

    def _loss(self) -> AxisLostError:
        return AxisLostError(
            f"the link to the controller on {self.port} is gone "
            f"({self._lost or 'it is closed'}); check plug and power, then connect again"
        )

    def _lose(self, reason: str) -> None:
        with self.news:
            self._lost = self._lost or reason
            self.news.notify_all()

    def _read_on(self) -> None:
        """Cut the stream into lines until the port is closed or lost; the thread's body."""
        pending = b""
        device = self._device
        while not self._closing:
            try:
                # The first byte is waited for, the rest is there: a longer read would wait on.
                arrived = device.read(1)
                arrived += device.read(device.in_waiting) if arrived else b""
            except (serial.SerialException, OSError, TypeError) as error:
                # A TypeError is how pyserial reports a port that was closed under a read.
                if not self._closing:
                    self._lose(str(error))
                return
            *lines, pending = (pending + arrived).split(b"\n")
            if len(pending) > _LONGEST_LINE:
                lines, pending = [*lines, pending], b""
            for line in lines:
                self._take(line)
            if pending and not arrived:  # not a line yet, but something to show to a person
                self._note(pending)

    def _take(self, raw: bytes) -> None:
        line = raw.decode("ascii", "backslashreplace").strip()
        if not line:
            return
        with self.news:
            self._note(raw)
            if _ANSWER.fullmatch(line):
                self._answers.append(line)
            else:
                self._hear(line)
            self.news.notify_all()

    def _note(self, raw: bytes) -> None:
        shown = ascii(raw.decode("ascii", "backslashreplace").strip()[:80])
        with self.news:
            if not self.heard or self.heard[-1] != shown:  # a poll repeats the same report
                self.heard.append(shown)


def _open_device(port: str, baudrate: int) -> Any:
    """Open a port for this process alone, with DTR and RTS low."""
    try:
        device = serial.serial_for_url(
            port,
            do_not_open=True,
            baudrate=baudrate,
            timeout=_READ_SLICE_S,
            write_timeout=_WRITE_TIMEOUT_S,
            exclusive=True,
        )
        # A rising DTR resets the usual boards, and with it the position. Before the opening,
        # because a pseudo terminal refuses it afterwards.
        device.dtr = False
        device.rts = False
        device.open()
    except ValueError as error:
        raise InputError(f"port {port!r} cannot be used: {error}; {describe_ports()}") from error
    except OSError as error:  # SerialException is one
        raise _opening_error(port, error) from error
    return device


def _opening_error(port: str, error: OSError) -> InputError | AxisError:
    if error.errno in (errno.EBUSY, errno.EAGAIN, errno.EWOULDBLOCK):
        return AxisError(f"port {port} is in use by another program: close that one first")
    if error.errno in (errno.EACCES, errno.EPERM):
        return AxisError(
            f"port {port} may not be opened by this user, or another program holds it; on Linux "
            "add the user to the group that owns it (mostly 'dialout') and log in again"
        )
    if "://" in port:
        return InputError(f"port {port!r} cannot be reached: {error}")
    if error.errno == errno.ENOENT:
        return InputError(
            f"there is no serial port {port!r}: give the controller's; {describe_ports()}"
        )
    reason = os.strerror(error.errno) if error.errno else str(error)
    return InputError(
        f"port {port!r} does not open as a serial port ({reason}): give the controller's; "
        f"{describe_ports()}"
    )


def _close_device(device: Any) -> None:
    """Close a port and what pyserial leaves open behind it; never raises."""
    socket = getattr(device, "_socket", None)  # stays open when the other side went first
    log = getattr(getattr(device, "formatter", None), "output", None)  # of spy://
    with contextlib.suppress(Exception):
        device.close()
    if socket is not None:
        with contextlib.suppress(OSError):
            socket.close()
    if log is not None and log.name != "<stderr>":
        with contextlib.suppress(OSError):
            log.close()
