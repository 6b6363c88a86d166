"""`depthwarp calibrate` that is ended while it waits for the person."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest

from tests.cli.conftest import invoke
from tests.scanner.fakes import FakeAxis, FakeSource


class WatchedAxis(FakeAxis):
    """Counts the closings."""

    closings = 0

    def close(self) -> None:
        """Close, and say so."""
        self.closings += 1
        super().close()

    def __exit__(self, *exception: object) -> None:
        """Stop and close, as every axis does."""
        self.stop()
        self.close()


@pytest.fixture
def axis(monkeypatch: pytest.MonkeyPatch) -> WatchedAxis:
    """The axis that the command opens, with the laser left on by someone."""
    watched = WatchedAxis()
    watched.laser = True
    monkeypatch.setattr("depthwarp.scanner.axes.open_axis", lambda *_, **__: watched)
    monkeypatch.setattr(
        "depthwarp.scanner.sources.open_source", lambda *_, **__: FakeSource(watched)
    )
    return watched


def calibrate(folder: Path):
    """Run the command up to its first question."""
    return invoke(
        *("calibrate", folder / "boards", "-o", folder / "c.json"),
        *("--board", "chessboard:9x6:0.1", "--axis", "grbl:X", "--camera", "opencv:0"),
    )


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_at_the_question_leaves_a_safe_machine(
    axis: WatchedAxis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: signal.Signals
):
    """Laser off, axis closed, exit code 2, one line; the old handlers are back."""
    before = [signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)]

    def ask(*_: object, **__: object) -> str:
        os.kill(os.getpid(), number)
        pytest.fail("the signal did not end the wait")

    monkeypatch.setattr("depthwarp.cli.steering._read_line", ask)
    result = calibrate(tmp_path)
    assert result.exit_code == 2, result.output
    assert "cancelled; the same command goes on" in result.stderr
    assert "Traceback" not in result.stderr
    assert not axis.laser and axis.closings == 1
    assert [signal.getsignal(one) for one in (signal.SIGINT, signal.SIGTERM)] == before


def test_the_end_of_input_at_the_question_is_no_defect(axis: WatchedAxis, tmp_path: Path):
    """Nobody at the terminal: interrupted, exit code 130, and the machine is safe."""
    result = calibrate(tmp_path)
    assert result.exit_code == 130, result.output
    assert "interrupted" in result.stderr and "defect" not in result.stderr
    assert not axis.laser and axis.closings == 1
