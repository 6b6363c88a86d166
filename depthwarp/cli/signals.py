"""What the signals that end or stop a program do to a scan: the machine is safe first."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from depthwarp.scanner.scan import ScanControl

__all__ = ["cancel_on_signals", "leave_on_signals", "stop_process", "suspend_on_signal"]

ENDING = [
    getattr(signal, name)
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT")
    if hasattr(signal, name)
]
"""Ctrl-C, kill, the end of the terminal's session, Ctrl-backslash."""


@contextmanager
def cancel_on_signals(control: ScanControl) -> Iterator[None]:
    """A signal ends the scan in order: motor stopped, laser off, recording whole."""
    with _handled(ENDING, lambda *_: control.cancel()):
        yield


@contextmanager
def leave_on_signals(text: str) -> Iterator[None]:
    """A signal ends even a wait for the person, through the exits of axis and camera.

    Args:
        text: Message of the error.

    Raises:
        ScanCancelledError: Out of what was under way when the signal came.
    """
    from depthwarp.scanner.scan import ScanCancelledError

    def leave(*_: object) -> None:
        for number in ENDING:  # a second signal must not break off the way to a safe machine
            signal.signal(number, signal.SIG_IGN)
        raise ScanCancelledError(text)

    with _handled(ENDING, leave):
        yield


@contextmanager
def suspend_on_signal(suspend: Callable[[], None]) -> Iterator[None]:
    """Ctrl-Z calls `suspend`; a shell without job control, which ignores it, is left so.

    A scan that is sent to the background must not be stopped for what it writes or reads there.
    """
    if not hasattr(signal, "SIGTSTP"):  # Windows
        yield
        return
    with (
        _handled([signal.SIGTSTP], lambda *_: suspend()),
        _handled([signal.SIGTTIN, signal.SIGTTOU], signal.SIG_IGN),
    ):
        yield


def stop_process() -> None:
    """Stop this process as Ctrl-Z does; returns when the shell lets it continue."""
    os.kill(os.getpid(), signal.SIGSTOP)


@contextmanager
def _handled(numbers: list[signal.Signals], handler: Any) -> Iterator[None]:
    """Signals have a handler for a while, but for those that whoever started us had ignored."""
    before = {number: signal.getsignal(number) for number in numbers}
    changed = {n: old for n, old in before.items() if old is not signal.SIG_IGN}
    for number in changed:
        signal.signal(number, handler)
    try:
        yield
    finally:
        for number, old in changed.items():
            signal.signal(number, old)
