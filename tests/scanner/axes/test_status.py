"""Status reports: both dialects, every state, and damage."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from depthwarp.scanner.axes.status import Status, parse_status
from depthwarp.scanner.axis import AxisState


def test_reads_a_report_of_grbl_1_1() -> None:
    """State, machine position; other fields do not disturb."""
    line = "<Run|MPos:59.962,0.000,-1.000|FS:500,0|WCO:1.000,0.000,0.000>"
    assert parse_status(line) == Status(AxisState.RUN, "Run", 59.962, None)


def test_reads_a_work_position_of_grbl_1_1() -> None:
    """With $10=0 the controller reports its work position only."""
    assert parse_status("<Idle|WPos:-2.250,0.000,0.000|FS:0,0>") == Status(
        AxisState.IDLE, "Idle", None, -2.25
    )


def test_reads_a_report_of_horus() -> None:
    """Commas between the fields, both positions."""
    line = "<Idle,MPos:10.125,0.000,0.000,WPos:9.000,0.000,0.000>"
    assert parse_status(line) == Status(AxisState.IDLE, "Idle", 10.125, 9.0)


@pytest.mark.parametrize(
    ("name", "state"),
    [
        ("Idle", AxisState.IDLE),
        ("Run", AxisState.RUN),
        ("Jog", AxisState.RUN),
        ("Home", AxisState.RUN),
        ("Hold:0", AxisState.HOLD),
        ("Hold:1", AxisState.HOLD),
        ("Queue", AxisState.HOLD),
        ("Door:3", AxisState.HOLD),
        ("Alarm", AxisState.ALARM),
        ("Check", AxisState.ALARM),
        ("Sleep", AxisState.ALARM),
    ],
)
def test_every_state_has_its_meaning(name: str, state: AxisState) -> None:
    """Each word of the controllers maps to one state."""
    report = parse_status(f"<{name}|MPos:0.000,0.000,0.000>")
    assert report is not None
    assert report.state is state


@pytest.mark.parametrize(
    "line",
    [
        "",
        "ok",
        "<>",
        "<Idle>",
        "<Idle|MPos:1.0,0.0,0.0",
        "Idle|MPos:1.0,0.0,0.0>",
        "<Idlx|MPos:1.0,0.0,0.0>",
        "<Idle|MPos:1.\\xff0,0.0,0.0>",
        "<Idle|MP\\xc3s:1.0,0.0,0.0>",
        "<Idle|MPos:,0.0>",
    ],
)
def test_a_damaged_report_is_none(line: str) -> None:
    """A line that is cut or has a strange character is no report."""
    assert parse_status(line) is None


@given(st.text(max_size=60))
def test_no_text_makes_it_fail(text: str) -> None:
    """Whatever comes over the line, the parser returns."""
    parse_status(f"<{text}>")
