"""The controller of a turning head as a thread behind a pseudo terminal, with faults on request."""

from __future__ import annotations

import queue
import random
import re
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Literal, Self, TypeVar

from depthwarp.checks import check_choice, check_positive
from depthwarp.scanner.axes.motor import StepMotor
from depthwarp.scanner.twin.gcode import GrblMachine, HorusMachine, Machine
from depthwarp.scanner.twin.pseudo_terminal import PseudoTerminal

__all__ = ["Firmware"]

_LONGEST_WAIT_S = 0.5
_SHORTEST_WAIT_S = 0.001
_PLANNING_S = 0.003
_REAL_TIME = re.compile(rb"([?!~\x18])")

Result = TypeVar("Result")


class Firmware:
    """GRBL 1.1 or Horus 0.2 as a client sees it, turning a motor that is arithmetic.

    Everything runs in one thread; the methods hand their work to it and wait until it is done.

    Args:
        dialect: `grbl` or `horus`.
        motor: The motor that it turns.
        time_scale: Seconds that pass for the motor in one second.
        boot_s: Time from a restart to the banner [s]; nothing is heard or said in it. With 0 it
            has been running for long, otherwise it has just been switched on.
        seed: Of the damage to garbled lines.

    Attributes:
        path: Name of the serial port to connect to.
        received: Lines and real-time characters that arrived, but for `?`.
        silent: Say nothing any more.
        foreign: Answer everything with this text, as some other device would.
        garbled_share: Share of the lines that arrive damaged.
        answer_delay_s: Time that each answer is late [s].

    Example:
        >>> with Firmware() as firmware, GrblAxis(firmware.path) as axis:
        ...     axis.reference()
        ...     axis.move_to(45.0)
        ...     firmware.true_angle
        45.0
        45.0
    """

    def __init__(
        self,
        dialect: Literal["grbl", "horus"] = "grbl",
        *,
        motor: StepMotor | None = None,
        time_scale: float = 1.0,
        boot_s: float = 0.0,
        seed: int = 0,
    ) -> None:
        check_choice("dialect", dialect, ("grbl", "horus"))
        self._time_scale = check_positive("time_scale", time_scale)
        self.received: list[str] = []
        self.silent = False
        self.foreign: str | None = None
        self.garbled_share = 0.0
        self.answer_delay_s = 0.0
        kind = GrblMachine if dialect == "grbl" else HorusMachine
        self._machine: Machine = kind(motor if motor is not None else StepMotor())
        self._random = random.Random(seed)
        self._boot_s = boot_s
        self._boots_at: float | None = time.monotonic() + boot_s if boot_s else None
        self._clock_from = time.monotonic()
        self._stalled_at: float | None = None
        self._partial = b""
        self._outbox: deque[tuple[float, bytes]] = deque()
        self._requests: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._closing = False
        self._terminal = PseudoTerminal()
        self.path = self._terminal.path
        self._thread = threading.Thread(target=self._run, name="firmware", daemon=True)
        self._thread.start()

    def __enter__(self) -> Self:
        """Return itself; it has run since it was made."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Close."""
        self.close()

    def close(self) -> None:
        """End the thread and remove the port; the truth can still be asked for."""
        if not self._closing:
            self._closing = True
            self._terminal.wake()
            self._thread.join()
            self._terminal.close()

    @property
    def true_angle(self) -> float:
        """Where the head really is [degrees], since the motor was made."""
        return self._do(lambda: self._machine.motor.true_angle(self._now()))

    @property
    def laser_on(self) -> bool:
        """Whether any laser is on."""
        return self._do(lambda: self._machine.laser_on)

    @property
    def is_moving(self) -> bool:
        """Whether the motor turns."""
        return self._do(lambda: self._machine.motor.is_moving(self._now()))

    def restart(self) -> None:
        """Lose the supply for a moment: position 0, laser off, a banner after the boot time."""

        def power_cycle() -> None:
            self._machine.power_up(self._now())
            self._boots_at = time.monotonic() + self._boot_s
            self._outbox.clear()

        self._do(power_cycle)

    def alarm(self, code: int = 1) -> None:
        """Raise an alarm, as a limit switch does."""
        self._do(lambda: self._machine.alarm(self._now(), code))

    def hold(self) -> None:
        """Press the hold button."""
        self._do(lambda: self._machine.hold(self._now()))

    def open_door(self) -> None:
        """Open the safety door (GRBL only)."""
        self._do(lambda: self._machine.hold(self._now(), "Door"))

    def stall(self) -> None:
        """Let the motor's time stand still: a move under way never ends."""

        def freeze() -> None:
            self._stalled_at = self._now()

        self._do(freeze)

    def drop_line(self) -> None:
        """Pull the plug of the line; the motor runs on."""
        self._do(self._terminal.drop)

    def restore_line(self) -> None:
        """Plug the line in again, under the same name."""
        self._do(self._terminal.restore)

    def _do(self, work: Callable[[], Result]) -> Result:
        """Run `work` in the thread, or here when there is no thread any more."""
        if not self._thread.is_alive() or threading.current_thread() is self._thread:
            return work()
        results: queue.SimpleQueue[Result] = queue.SimpleQueue()
        self._requests.put(lambda: results.put(work()))
        self._terminal.wake()
        while True:
            try:
                return results.get(timeout=_LONGEST_WAIT_S)
            except queue.Empty:
                if not self._thread.is_alive():
                    return work()

    def _now(self) -> float:
        """The motor's time [s]."""
        if self._stalled_at is not None:
            return self._stalled_at
        return (time.monotonic() - self._clock_from) * self._time_scale

    def _run(self) -> None:
        """The thread's body: take what arrives, let the machine work, send what is due."""
        while not self._closing:
            arrived = self._terminal.read(self._time_to_wait())
            while not self._requests.empty():
                self._requests.get()()
            if self._boots_at is not None:
                if time.monotonic() < self._boots_at:
                    continue  # what arrives while it boots is lost
                self._boots_at = None
                self._machine.greet()
            self._take(arrived)
            self._machine.work(self._now())
            self._post()
            self._send_due()

    def _time_to_wait(self) -> float:
        now = time.monotonic()
        waits = [_LONGEST_WAIT_S]
        if self._boots_at is not None:
            waits.append(self._boots_at - now)
        if self._outbox:
            waits.append(self._outbox[0][0] - now)
        if self._machine.motor.is_moving(self._now()):
            if self._stalled_at is None:
                waits.append(self._machine.motor.remaining_s(self._now()) / self._time_scale)
        elif self._machine.has_moves_to_start:
            waits.append(_PLANNING_S)
        return max(_SHORTEST_WAIT_S, min(waits))

    def _take(self, arrived: bytes) -> None:
        """Pick the real-time characters out of the stream, cut the rest into lines."""
        for part in _REAL_TIME.split(arrived):
            if self.foreign is not None:
                if part:
                    self._machine.say(self.foreign)
            elif _REAL_TIME.fullmatch(part):
                character = part.decode()
                if character != "?":
                    self.received.append(character)
                if character == "\x18":
                    self._partial = b""
                self._machine.take_real_time(character, self._now())
            else:
                *lines, self._partial = (self._partial + part).split(b"\n")
                for line in lines:
                    text = line.decode("ascii", "replace").strip()
                    self.received.append(text)
                    self._machine.lines.append(text)

    def _post(self) -> None:
        """Put what the machine says into the outbox, damaged where it is to be damaged."""
        due = time.monotonic() + self.answer_delay_s
        while self._machine.said:
            data = self._machine.said.popleft().encode() + b"\r\n"
            if len(data) > 2 and self._random.random() < self.garbled_share:
                place = self._random.randrange(len(data) - 2)
                data = data[:place] + bytes([self._random.randrange(128, 256)]) + data[place + 1 :]
            if not self.silent:
                self._outbox.append((due, data))

    def _send_due(self) -> None:
        while self._outbox and self._outbox[0][0] <= time.monotonic():
            self._terminal.write(self._outbox.popleft()[1])
