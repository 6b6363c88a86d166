"""A motor axis on GRBL 1.1 (gnea/grbl, grblHAL): the head is its X axis, in degrees."""

from __future__ import annotations

import re

from depthwarp.scanner.axes.controller import Dialect
from depthwarp.scanner.axes.gcode_axis import GcodeAxis
from depthwarp.scanner.axes.status import Status
from depthwarp.scanner.axis import AxisError

__all__ = ["GrblAxis"]

_SYNC = "G4 P0.01"  # a dwell: its ok comes after all motion and switching before it
_LASER_POWER = 1000  # GRBL's default full scale, $30


class GrblAxis(GcodeAxis):
    """GRBL 1.1: X in degrees (`$100` is steps a degree), the laser on the spindle's output.

    Set once in the controller: `$1=255` keeps the motor under current, so that the head does not
    sag between two frames; `$32=1` if the laser is on the spindle's PWM pin.

    An `ok` to a move says that it is planned, not that it is done, and right after it the status
    may still be idle. A short dwell is therefore sent behind each move; its `ok` comes when the
    motor stands.

    The angle is the reported machine position less the offset G54, which `reference` sets by
    `G10 L20`. The machine position itself cannot be zeroed, and `G92` would be forgotten at
    every reset; G54 is in the controller's permanent memory, so the frame outlives a stop, this
    program, and a lost link. What it does not outlive, a restart, is noticed by the banner.
    """

    dialect = Dialect("GRBL 1.1", re.compile(r"Grbl(HAL)? 1\.1"), ("M5",))

    def _prepare(self, ticket: int) -> None:
        # In laser mode ($32=1) the laser lights in G1 only; a reset falls back to G0.
        for line in ("G21 G90 G94 G54", "G92.1", "M5", f"G1 F{60.0 * self.speed:.3f}"):
            self._command(line, ticket)
        self._read_offset(ticket)

    def _zero(self, ticket: int) -> None:
        self._command("G10 L20 P1 X0", ticket)
        self._read_offset(ticket)

    def _read_offset(self, ticket: int) -> None:
        self._command("$#", ticket)
        if "G54" not in self._connected().parameters:
            raise AxisError(f"the controller on {self.port} did not print its offset G54 on $#")

    def _move_lines(self, degrees: float) -> tuple[str, ...]:
        return (f"G1 X{degrees:.4f} F{60.0 * self.speed:.3f}", _SYNC)

    def _laser_lines(self, on: bool) -> tuple[str, ...]:
        return (f"M3 S{_LASER_POWER}" if on else "M5", _SYNC)

    def _angle(self, status: Status) -> float:
        if status.machine is not None:
            return round(status.machine - self._connected().parameters["G54"], 3)
        assert status.work is not None  # $10=0: the controller subtracts the offset itself
        return status.work
