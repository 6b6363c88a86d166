"""A motor axis on the firmware of the Ciclop scanner (horus-fw 0.2, after GRBL 0.9)."""

from __future__ import annotations

import re

from depthwarp.errors import InputError
from depthwarp.scanner.axes.controller import Dialect
from depthwarp.scanner.axes.gcode_axis import GcodeAxis
from depthwarp.scanner.axes.status import Status
from depthwarp.scanner.axis import AxisError

__all__ = ["HorusAxis"]

_LASERS = (1, 2)


class HorusAxis(GcodeAxis):
    """Horus: always absolute, feed in degrees a second, `ok` to a move after the motion.

    `G50` zeroes the position itself, so the reported machine position is the angle. A reset
    releases the motor; `M17` holds it again.

    Args:
        port: As in `GcodeAxis`.
        laser: Which of the two lasers is switched, 1 or 2; off is always both.
        speed: As in `GcodeAxis`.
        baudrate: As in `GcodeAxis`; 19200 over Bluetooth.
        patience_s: As in `GcodeAxis`.

    Raises:
        InputError: Another laser, or a speed or a time that is not above zero.
    """

    dialect = Dialect("Horus 0.2", re.compile(r"Horus 0\.2"), ("M70 T1", "M70 T2"))

    def __init__(
        self,
        port: str,
        *,
        laser: int = 1,
        speed: float = 30.0,
        baudrate: int = 115200,
        patience_s: float = 4.0,
    ) -> None:
        if laser not in _LASERS:
            raise InputError(f"laser must be 1 or 2, got {laser}")
        super().__init__(port, speed=speed, baudrate=baudrate, patience_s=patience_s)
        self._laser = laser

    def _prepare(self, ticket: int) -> None:
        for line in (*self.dialect.laser_off, "M17", f"G1 F{self.speed:.3f}"):
            self._command(line, ticket)

    def _zero(self, ticket: int) -> None:
        self._command("G50", ticket)

    def _move_lines(self, degrees: float) -> tuple[str, ...]:
        return (f"G1 X{degrees:.4f} F{self.speed:.3f}",)

    def _laser_lines(self, on: bool) -> tuple[str, ...]:
        return (f"M71 T{self._laser}",) if on else self.dialect.laser_off

    def _angle(self, status: Status) -> float:
        if status.machine is None:
            raise AxisError(f"the controller on {self.port} reports no machine position: set $10=3")
        return status.machine
