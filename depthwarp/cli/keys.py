"""Single keys from the terminal while a command works, and a terminal as it was before, after."""

from __future__ import annotations

import os
import select
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from importlib.util import find_spec

__all__ = ["Keys"]

LOOK_S = 0.1
"""How often the terminal is looked at: is there a key, are we in the foreground?"""


class Keys:
    """Keys pressed without Enter, read by a thread; Ctrl-C and Ctrl-Z stay signals.

    A process in the background neither reads the terminal nor changes it: that would stop it, with
    the laser in whatever state it was. Without a terminal nothing is read.

    Args:
        pressed: Called with each key, in the thread.
    """

    def __init__(self, pressed: Callable[[str], None]) -> None:
        self._pressed = pressed
        self._terminal = _Terminal.on_stdin()
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._read_on, name="keys", daemon=True)

    @property
    def are_read(self) -> bool:
        """Whether there is a terminal to read from."""
        return self._terminal is not None

    @contextmanager
    def left_alone(self) -> Iterator[None]:
        """Let go of the terminal for a while: its settings are those from before."""
        if self._terminal is None:
            yield
            return
        self._terminal.give_back(for_now=True)
        yield
        self._terminal.want_again()

    def __enter__(self) -> Keys:
        if self._terminal is not None:
            self._thread.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._closing.set()
        if self._terminal is not None:
            self._thread.join()
            self._terminal.give_back()

    def _read_on(self) -> None:
        """The thread's body."""
        assert self._terminal is not None
        with suppress(OSError):  # the terminal is gone: no more keys
            while not self._closing.is_set():
                if self._terminal.take():
                    for key in self._terminal.keys(LOOK_S):
                        self._pressed(key)
                else:
                    self._closing.wait(LOOK_S)


class _Terminal:
    """A terminal that gives single keys while it is taken, and forgets nothing of how it was."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self._give_back: Callable[[], None] | None = None
        self._is_wanted = True
        self._lock = threading.Lock()

    @classmethod
    def on_stdin(cls) -> _Terminal | None:
        """The terminal of our session on stdin, if there is one."""
        if find_spec("termios") is None:  # Windows
            return None
        with suppress(OSError, ValueError, AttributeError):  # closed, or replaced by a test
            if sys.stdin.isatty():
                terminal = cls(sys.stdin.fileno())
                terminal._is_ours()  # raises for a terminal of another session
                return terminal
        return None

    def take(self) -> bool:
        """Have keys come without Enter and unseen; False while that is not ours to do.

        Raises:
            OSError: The terminal is gone.
        """
        import termios
        import tty

        with self._lock:
            if not self._is_wanted or not self._is_ours():
                return False
            if self._give_back is None:
                try:
                    before = termios.tcgetattr(self._descriptor)
                    tty.setcbreak(self._descriptor, termios.TCSANOW)
                except termios.error as error:
                    raise OSError("the terminal is gone") from error
                self._give_back = lambda: termios.tcsetattr(
                    self._descriptor, termios.TCSADRAIN, before
                )
            return True

    def keys(self, timeout_s: float) -> str:
        """What was pressed, perhaps nothing; not the letters in the code of a function key.

        Raises:
            OSError: The terminal is gone.
        """
        if not select.select([self._descriptor], [], [], timeout_s)[0]:
            return ""
        data = os.read(self._descriptor, 64)
        if not data:
            raise OSError("the terminal was hung up")
        return "" if data.startswith(b"\x1b") else data.decode("utf-8", "ignore")

    def give_back(self, *, for_now: bool = False) -> None:
        """Make it as it was; never raises. In the background the shell has done that already."""
        with self._lock:
            self._is_wanted = not for_now
            give_back, self._give_back = self._give_back, None
            with suppress(Exception):  # the terminal may be gone
                if give_back is not None and self._is_ours():
                    give_back()

    def want_again(self) -> None:
        """Let it be taken again after `give_back`."""
        self._is_wanted = True

    def _is_ours(self) -> bool:
        """Whether we are in its foreground."""
        return os.tcgetpgrp(self._descriptor) == os.getpgrp()
