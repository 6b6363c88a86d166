"""The program on a terminal of its own, as a person uses it."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

PATIENCE_S = 30.0

LAUNCH = """
import fcntl, os, sys, termios
fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.executable, [sys.executable, "-m", "depthwarp", *sys.argv[1:]])
"""
"""Makes the terminal on stdin that of the session, as a shell has it, and becomes the program."""

CONTROL = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


class Terminal:
    """A running program and the other end of its terminal, 80 columns wide.

    Attributes:
        screen: All that was shown, without control sequences.
    """

    def __init__(self, *arguments: object) -> None:
        self._master, self._slave = self._ends = list(pty.openpty())
        fcntl.ioctl(self._slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, 80, 0, 0))
        self.settings_before = termios.tcgetattr(self._slave)
        self.screen = ""
        self.process = subprocess.Popen(
            [sys.executable, "-c", LAUNCH, *map(str, arguments)],
            stdin=self._slave,
            stdout=self._slave,
            stderr=self._slave,
            start_new_session=True,
            env={**os.environ, "TERM": "xterm", "COLUMNS": "80"},
        )

    @property
    def settings(self) -> list[object]:
        """The terminal's settings as they are now."""
        return termios.tcgetattr(self._slave)

    @property
    def is_stopped(self) -> bool:
        """Whether the process is stopped, as after Ctrl-Z."""
        with open(f"/proc/{self.process.pid}/stat", encoding="ascii") as file:
            return file.read().rpartition(")")[2].split()[0] == "T"

    def press(self, keys: str) -> None:
        """Type something."""
        os.write(self._master, keys.encode())

    def wait_until(self, condition: Callable[[], bool]) -> None:
        """Wait, and read what is shown meanwhile, until something holds."""
        deadline = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline, self.screen
            self._read(0.02)

    def wait_for(self, words: str, times: int = 1) -> None:
        """Wait until the screen has shown these words so many times."""
        self.wait_until(lambda: self.screen.count(words) >= times)

    def wait_for_end(self) -> int:
        """Wait until the program ends; its exit code."""
        self.wait_until(lambda: self.process.poll() is not None)
        self._read(0.1)
        return self.process.returncode

    def close(self) -> None:
        """End the program, whatever it does."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGKILL)
            self.process.wait()
        self.hang_up()

    def hang_up(self) -> None:
        """Close the terminal under the program, as its window does."""
        while self._ends:
            os.close(self._ends.pop())

    def _read(self, timeout_s: float) -> None:
        while select.select([self._master], [], [], timeout_s)[0]:
            shown = os.read(self._master, 4096).decode("utf-8", "replace")
            self.screen += CONTROL.sub("", shown)
            timeout_s = 0.0


@contextmanager
def on_terminal(*arguments: object) -> Iterator[Terminal]:
    """Run the program on a terminal; in the end it is gone, whatever it does."""
    terminal = Terminal(*arguments)
    try:
        yield terminal
    finally:
        terminal.close()
