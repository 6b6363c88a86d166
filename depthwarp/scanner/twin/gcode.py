"""How GRBL 1.1 and Horus 0.2 act on what they are told, without any line or clock."""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections import deque

from depthwarp.scanner.axes.motor import StepMotor

__all__ = ["GrblMachine", "HorusMachine", "Machine"]

_WORDS = re.compile(r"(?:[A-Z][-+]?\d+(?:\.\d*)?)+")
_WORD = re.compile(r"([A-Z])([-+]?\d+(?:\.\d*)?)")
_PLANNED_MOVES = 15
_REPORTS_PER_OFFSET = 10


class Machine(ABC):
    """A controller's state: one planner, one motor, alarm and hold.

    The owner feeds `lines` and `take_real_time`, calls `work` whenever something may have become
    due, and takes away what was `said`. Times are the motor's.

    Attributes:
        motor: The motor it turns.
        lines: Lines that arrived and were not worked off yet.
        said: Lines to send, oldest first.
        laser_on: Whether any laser is on.
    """

    banner: str

    def __init__(self, motor: StepMotor) -> None:
        self.motor = motor
        self.lines: deque[str] = deque()
        self.said: deque[str] = deque()
        self.laser_on = False
        self._moves: deque[tuple[int, float]] = deque()
        self._target: int | None = None  # of the move under way
        self._in_alarm = False
        self._locked = False  # after a limit switch: deaf to all but a reset
        self._held = ""  # "Hold", "Door" or nothing
        self._speed = 0.0
        self._parser_degrees = 0.0  # where the parser believes to be, in machine coordinates
        self._lose_modes()

    def say(self, *lines: str) -> None:
        """Queue lines to send."""
        self.said.extend(lines)

    def greet(self) -> None:
        """Say the banner, and how to unlock if in alarm."""
        self.say("", self.banner)
        if self._in_alarm:
            self._say_locked()

    def power_up(self, now: float) -> None:
        """Start from nothing: counted position 0, no alarm, laser off."""
        self._clear(now)
        self.motor.zero(now)
        self._parser_degrees = 0.0
        self._in_alarm = self._locked = False
        self.said.clear()

    def alarm(self, now: float, code: int) -> None:
        """Cut everything off and lock."""
        self._clear(now)
        self._in_alarm = True
        self._locked = code in (1, 2)
        self._say_alarm(code)

    def hold(self, now: float, name: str = "Hold") -> None:
        """Brake and wait for `~`."""
        if not self._held:
            self.motor.brake(now)
        self._held = name

    def take_real_time(self, character: str, now: float) -> None:
        """Act on `?`, `!`, `~` or the soft reset."""
        if character == "\x18":
            self._reset(now)
        elif self._locked:
            return
        elif character == "?":
            self.say(self._report(now))
        elif character == "!":
            self.hold(now)
        elif character == "~" and self._held:
            self._held = ""
            if self._target is not None:
                self._moves.appendleft((self._target, self._speed))

    def work(self, now: float) -> None:
        """Start planned moves and work off lines, as far as both can go now."""
        if self._locked:
            self.lines.clear()
        self._start_moves(now)
        while self.lines and self._work_off(self.lines[0], now):
            self.lines.popleft()

    @property
    def has_moves_to_start(self) -> bool:
        """Whether moves are planned that the next `work` may start.

        As in the real ones, a move begins a moment after its line was taken, and until then the
        status is still idle.
        """
        return bool(self._moves) and not self._held

    def _start_moves(self, now: float) -> None:
        while not self._held and not self.motor.is_moving(now):
            self._target = None
            if not self._moves:
                return
            self._target, speed = self._moves.popleft()
            self.motor.start(self._target, speed, now)

    def _is_busy(self, now: float) -> bool:
        return bool(self._moves) or self._target is not None or self.motor.is_moving(now)

    def _reset(self, now: float) -> None:
        """Soft reset: the position survives if the motor stands."""
        was_moving = self.motor.is_moving(now)
        self._clear(now)
        self.said.clear()
        self._locked = False
        if was_moving:
            self._in_alarm = True
            self._say_alarm(3)
        # From here the parser goes by the counted steps, not by the last angle asked for.
        self._parser_degrees = self.motor.angle(now)
        self.greet()

    def _clear(self, now: float) -> None:
        self.motor.halt(now)
        self._moves.clear()
        self._target = None
        self.lines.clear()
        self.laser_on = False
        self._held = ""
        self._lose_modes()

    def _work_off(self, line: str, now: float) -> bool:
        """Act on one line; False if it has to wait."""
        line = line.replace(" ", "").upper()
        if line.startswith("$") or not line:
            self._obey_system(line)
        elif self._in_alarm:
            self._refuse(9, "Alarm lock")
        elif _WORDS.fullmatch(line) is None:
            self._refuse(2, "Bad number format")
        else:
            words = [(letter, float(value)) for letter, value in _WORD.findall(line)]
            return self._obey(words, now)
        return True

    def _plan(self, degrees: float, speed: float) -> None:
        """Plan a move to an angle in machine coordinates."""
        self._parser_degrees = degrees
        self._speed = speed
        self._moves.append((self.motor.nearest_count(degrees), speed))

    @abstractmethod
    def _lose_modes(self) -> None: ...

    @abstractmethod
    def _report(self, now: float) -> str: ...

    @abstractmethod
    def _say_alarm(self, code: int) -> None: ...

    @abstractmethod
    def _say_locked(self) -> None: ...

    @abstractmethod
    def _refuse(self, code: int, text: str) -> None: ...

    @abstractmethod
    def _obey_system(self, line: str) -> None: ...

    @abstractmethod
    def _obey(self, words: list[tuple[str, float]], now: float) -> bool: ...


class GrblMachine(Machine):
    """GRBL 1.1h: `ok` means planned; dwell, laser and offsets wait for the motion before them."""

    banner = "Grbl 1.1h ['$' for help]"

    def __init__(self, motor: StepMotor) -> None:
        self._permanent_offset = 0.0  # G54, survives everything
        self._reports = 0
        super().__init__(motor)

    def _lose_modes(self) -> None:
        self._absolute = True
        self._feed = 0.0
        self._linear = False
        self._passing_offset = 0.0  # G92

    def _report(self, now: float) -> str:
        moving = self.motor.is_moving(now)
        if self._in_alarm:
            name = "Alarm"
        elif self._held:
            name = f"{self._held}:{int(moving)}"
        else:
            name = "Run" if moving or self._target is not None else "Idle"
        self._reports += 1
        offset = f"|WCO:{self._offset:.3f},0.000,0.000" if self._reports % 10 == 1 else ""
        position = f"{self.motor.angle(now):.3f},0.000,0.000"
        return f"<{name}|MPos:{position}|FS:{self._feed if moving else 0:.0f},0{offset}>"

    @property
    def _offset(self) -> float:
        return self._permanent_offset + self._passing_offset

    def _say_alarm(self, code: int) -> None:
        self.say(f"ALARM:{code}", *(["[MSG:Reset to continue]"] if self._locked else []))

    def _say_locked(self) -> None:
        self.say("[MSG:'$H'|'$X' to unlock]")

    def _refuse(self, code: int, text: str) -> None:
        self.say(f"error:{code}")

    def _obey_system(self, line: str) -> None:
        if line == "$X" and self._in_alarm:
            self._in_alarm = False
            self.say("[MSG:Caution: Unlocked]")
        elif line == "$#":
            self.say(f"[G54:{self._permanent_offset:.3f},0.000,0.000]")
            self.say(f"[G92:{self._passing_offset:.3f},0.000,0.000]")
        elif line not in ("", "$X"):
            return self._refuse(3, "Invalid statement")
        self.say("ok")

    def _obey(self, words: list[tuple[str, float]], now: float) -> bool:
        codes = {f"{letter}{value:g}" for letter, value in words if letter in "GM"}
        values = dict(word for word in words if word[0] not in "GM")
        must_wait = codes & {"G4", "G10", "G92", "G92.1", "M3", "M5"}
        if (must_wait and self._is_busy(now)) or len(self._moves) >= _PLANNED_MOVES:
            return False
        self._feed = values.get("F", self._feed)
        self._linear = "G1" in codes or (self._linear and "G0" not in codes)
        self._absolute = "G90" in codes or (self._absolute and "G91" not in codes)
        if codes & {"M3", "M5"}:
            self.laser_on = "M3" in codes and values.get("S", 0.0) > 0.0
        if "G92.1" in codes:
            self._passing_offset = 0.0
        elif "G92" in codes:
            self._passing_offset = self._parser_degrees - self._permanent_offset - values["X"]
        elif "G10" in codes:
            self._permanent_offset = self._parser_degrees - self._passing_offset - values["X"]
        elif "X" in values:
            if self._linear and not self._feed:
                self._refuse(22, "Undefined feed rate")
                return True
            origin = self._offset if self._absolute else self._parser_degrees
            self._plan(origin + values["X"], self._feed / 60.0 if self._linear else math.inf)
        self.say("ok")
        return True


class HorusMachine(Machine):
    """Horus 0.2: feed in degrees a second, `ok` to a move after the motion, texts of GRBL 0.9."""

    banner = "Horus 0.2 ['$' for help]"

    def _lose_modes(self) -> None:
        self._feed = 0.0
        self._lasers: set[int] = set()
        self._answer_due = False

    def _report(self, now: float) -> str:
        if self._in_alarm:
            name = "Alarm"
        elif self._held:
            name = "Hold" if self.motor.is_moving(now) else "Queue"
        else:
            name = "Run" if self.motor.is_moving(now) or self._target is not None else "Idle"
        position = f"{self.motor.angle(now):.3f},0.000,0.000"
        return f"<{name},MPos:{position},WPos:{position}>"

    def _say_alarm(self, code: int) -> None:
        self.say(f"ALARM: {'Abort during cycle' if code == 3 else 'Hard/soft limit'}")

    def _say_locked(self) -> None:
        self.say("['$H'|'$X' to unlock]")

    def _refuse(self, code: int, text: str) -> None:
        self.say(f"error: {text}")

    def _obey_system(self, line: str) -> None:
        if not line:
            return  # Horus does not answer an empty line
        if line != "$X":
            return self._refuse(3, "Invalid statement")
        if self._in_alarm:
            self._in_alarm = False
            self.say("[Caution: Unlocked]")
        self.say("ok")

    def _obey(self, words: list[tuple[str, float]], now: float) -> bool:
        if self._is_busy(now):
            return False
        if self._answer_due:  # the move of this very line is over
            self._answer_due = False
            self.say("ok")
            return True
        codes = {f"{letter}{value:g}" for letter, value in words if letter in "GM"}
        values = dict(word for word in words if word[0] not in "GM")
        if codes - {"G0", "G1", "G50", "M17", "M18", "M50", "M70", "M71"}:
            self._refuse(20, "Unsupported command")
            return True
        self._feed = values.get("F", self._feed)
        laser = int(values.get("T", 0))
        self._lasers = self._lasers | {laser} if "M71" in codes else self._lasers
        self._lasers = self._lasers - {laser} if "M70" in codes else self._lasers
        self.laser_on = bool(self._lasers)
        if "G50" in codes:
            self.motor.zero(now)
            self._parser_degrees = 0.0
        if "X" in values:
            self._plan(values["X"], self._feed)
            self._answer_due = True
            return False
        self.say("ok")
        return True
