"""A person beside a scan under way: sees how far it is, pauses it, leaves it, ends it."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from typing import TYPE_CHECKING, cast

import typer

from depthwarp.cli.keys import Keys
from depthwarp.cli.report import ProgressLine, Reporter
from depthwarp.cli.signals import (
    cancel_on_signals,
    leave_on_signals,
    stop_process,
    suspend_on_signal,
)

if TYPE_CHECKING:
    from depthwarp.scanner.axes import ManualAxis
    from depthwarp.scanner.axis import Axis
    from depthwarp.scanner.scan import ScanControl

__all__ = ["ask_person", "ended_by_signals", "steered", "wait_for_person"]

PAUSE_KEYS = " pP"

LOOK_AGAIN_S = 0.2
"""Longest time that a signal waits while a person is asked."""


def ended_by_signals(control: ScanControl, axis: Axis, text: str) -> AbstractContextManager[None]:
    """Ctrl-C and its like end a scan: in order where a motor turns, at once where a person does.

    Args:
        control: Of the scan.
        axis: That turns the head.
        text: What to say when a person, asked to turn the head, left instead.
    """
    return leave_on_signals(text) if _is_person(axis) else cancel_on_signals(control)


@contextmanager
def steered(
    reporter: Reporter, control: ScanControl, axis: Axis, name: str, text: str, total: int
) -> Iterator[ProgressLine]:
    """Show how far a scan is, and let a person pause it.

    Space or p pauses after the stop that is under way, and goes on again. Ctrl-Z stops the process
    when the scan is at rest. Where a person turns the head, each question is a pause.

    Args:
        reporter: Shows the progress.
        control: Of the scan.
        axis: That turns the head.
        name: Of the step in the reporter's seconds.
        text: What is under way.
        total: Stops in all.
    """
    by_hand = _is_person(axis)
    with reporter.progress(name, text, total, is_live=not by_hand) as line:
        if by_hand:
            with suspend_on_signal(lambda: _leave_alone(cast("ManualAxis", axis))):
                yield line
        else:
            with _Steering(control, line, text):
                yield line


def _is_person(axis: Axis) -> bool:
    from depthwarp.scanner.axes import ManualAxis

    return isinstance(axis, ManualAxis)


class _Steering:
    """Keys and Ctrl-Z on a scan whose motor and laser the program commands."""

    def __init__(self, control: ScanControl, line: ProgressLine, text: str) -> None:
        self._control, self._line, self._text = control, line, text
        self._stack = ExitStack()
        self._keys = Keys(self._press)
        self._is_suspending = False

    def __enter__(self) -> _Steering:
        self._stack.enter_context(suspend_on_signal(self._ask_to_suspend))
        self._stack.enter_context(self._keys)
        if self._keys.are_read:
            self._line.describe(f"{self._text} (space pauses)")
        return self

    def __exit__(self, *exception: object) -> None:
        self._stack.close()
        self._line.describe()

    def _press(self, key: str) -> None:
        if key not in PAUSE_KEYS:
            return
        if self._control.is_paused:
            self._control.resume()
            self._line.describe(f"{self._text} (space pauses)")
        else:
            self._control.pause()
            self._control.call_at_rest(self._say_paused)
            self._line.describe("pausing after this stop")

    def _say_paused(self) -> None:
        if self._control.is_paused:
            self._line.describe("paused, laser off (space goes on)")

    def _ask_to_suspend(self) -> None:
        if not self._is_suspending:  # Ctrl-Z twice is once
            self._is_suspending = True
            self._control.call_at_rest(self._suspend)

    def _suspend(self) -> None:
        with self._line.left_alone(), self._keys.left_alone():
            stop_process()
        self._is_suspending = False


def _leave_alone(axis: ManualAxis) -> None:
    """Stop the process in the midst of a question; it is still open afterwards."""
    with axis.left_alone():
        stop_process()
    typer.echo("The last question is still open.", err=True)


def ask_person(question: str) -> float | None:
    """Ask the person at the terminal for a number, until it is one; an empty answer is None."""
    while answer := wait_for_person(question).strip():
        try:
            return float(answer)
        except ValueError:
            typer.echo(f"{answer!r} is not a number: type one, or just Enter", err=True)
    return None


def wait_for_person(text: str) -> str:
    """Show a text and wait for Enter; what was typed before it.

    Raises:
        typer.Abort: The input has ended, or Ctrl-C.
    """
    try:
        typer.echo(f"{text} ", nl=False, err=True)
        return _read_line()
    except BaseException:
        typer.echo(err=True)  # what is said next begins a line
        raise


def _read_line() -> str:
    """The next line of the input, without its end."""
    try:
        if os.name == "posix" and sys.stdin.isatty():
            # A signal that comes just before a read is not seen until the read returns, that is
            # until the person types: look again every now and then.
            while not select.select([sys.stdin], [], [], LOOK_AGAIN_S)[0]:
                pass
        line = sys.stdin.readline()
    except KeyboardInterrupt:
        raise typer.Abort from None
    if not line:
        raise typer.Abort
    return line.rstrip("\n")
