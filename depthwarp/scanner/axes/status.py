"""Status reports of GRBL 1.1 and of GRBL 0.9, from which the Horus firmware comes."""

from __future__ import annotations

import re
from dataclasses import dataclass

from depthwarp.scanner.axis import AxisState

__all__ = ["Status", "parse_status"]

_REPORT = re.compile(r"<(?P<name>[A-Z][a-z]+)(?::\d)?(?P<fields>[|,].*)?>")
_POSITION = re.compile(r"(?P<frame>[MW])Pos:(?P<x>[-+]?\d+(?:\.\d+)?)(?=[,|]|$)")

_STATES = {
    "Idle": AxisState.IDLE,
    "Run": AxisState.RUN,
    "Jog": AxisState.RUN,
    "Home": AxisState.RUN,
    "Hold": AxisState.HOLD,
    "Queue": AxisState.HOLD,  # 0.9: planned moves that wait for a cycle start
    "Door": AxisState.HOLD,
    "Alarm": AxisState.ALARM,
    "Check": AxisState.ALARM,  # 1.1: takes moves without making them
    "Sleep": AxisState.ALARM,  # 1.1: the motor has no current, only a reset wakes it
}


@dataclass(frozen=True)
class Status:
    """One status report.

    Attributes:
        state: What the controller is doing.
        name: The controller's own word for it.
        machine: Angle since the controller's power-up [degrees], None where it reports `work` only.
        work: Angle in the frame of the last zero [degrees], None where it reports `machine` only.
    """

    state: AxisState
    name: str
    machine: float | None
    work: float | None


def parse_status(line: str) -> Status | None:
    """Read `<Idle|MPos:1.000,0.000,0.000|FS:0,0>` or `<Idle,MPos:1.000,0.000,0.000,WPos:...>`.

    Returns:
        The report, or None where the line is none that can be trusted: a damaged one is dropped
        and the next poll brings a sound one.
    """
    report = _REPORT.fullmatch(line)
    if report is None or report["name"] not in _STATES:
        return None
    positions = {match["frame"]: float(match["x"]) for match in _POSITION.finditer(line[:-1])}
    if not positions:
        return None
    return Status(_STATES[report["name"]], report["name"], positions.get("M"), positions.get("W"))
