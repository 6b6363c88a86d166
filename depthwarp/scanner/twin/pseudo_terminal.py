"""The far end of a serial line that another program can open, without hardware (POSIX only)."""

from __future__ import annotations

import contextlib
import os
import pty
import select
import tempfile
import tty
from pathlib import Path

__all__ = ["PseudoTerminal"]


class PseudoTerminal:
    """A pseudo terminal under a name that stays the same when the line is dropped and restored.

    `read` and `write` belong to one thread; only `wake` may be called from any other.

    Attributes:
        path: Name to open as a serial port; it dangles while the line is dropped.
    """

    def __init__(self) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="axis-")
        self.path = str(Path(self._folder.name) / "port")
        self._ends: tuple[int, int] | None = None
        self._wake_end, self._wake = os.pipe()
        os.set_blocking(self._wake_end, False)
        self.restore()

    def restore(self) -> None:
        """Plug the line in."""
        if self._ends is not None:
            return
        ours, theirs = pty.openpty()
        # Their end stays open here too, so that a client may come and go.
        self._ends = ours, theirs
        tty.setraw(theirs)
        os.set_blocking(ours, False)
        os.symlink(os.ttyname(theirs), self.path)

    def drop(self) -> None:
        """Pull the plug."""
        if self._ends is not None:
            os.unlink(self.path)
            for end in self._ends:
                os.close(end)
            self._ends = None

    def close(self) -> None:
        """Drop the line and leave nothing behind."""
        self.drop()
        os.close(self._wake)
        os.close(self._wake_end)
        self._folder.cleanup()

    def wake(self) -> None:
        """End a `read` that waits."""
        os.write(self._wake, b"w")

    def read(self, timeout_s: float) -> bytes:
        """Bytes that have arrived; empty after the timeout or a `wake`."""
        ours = [self._ends[0]] if self._ends is not None else []
        ready, _, _ = select.select([self._wake_end, *ours], [], [], timeout_s)
        if self._wake_end in ready:
            os.read(self._wake_end, 1024)
        return os.read(ours[0], 1024) if ours and ours[0] in ready else b""

    def write(self, data: bytes) -> None:
        """Send bytes; what nobody reads is lost, as on a real line."""
        if self._ends is not None:
            with contextlib.suppress(BlockingIOError):
                os.write(self._ends[0], data)
