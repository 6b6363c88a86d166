"""How far `depthwarp batch` is, and how a signal ends it."""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from types import FrameType
from typing import TYPE_CHECKING, Any, TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from depthwarp.cli.signals import ENDING
from depthwarp.errors import DepthwarpError

if TYPE_CHECKING:
    from depthwarp.depth_map import DepthMap

__all__ = ["DrawnLine", "Interruption"]

T = TypeVar("T")


class DrawnLine:
    """How many views are written, how fast, and how long the rest will take.

    On a terminal one line that is drawn again and again, else a line about every tenth of the way.
    Called with the maps of each tile that is written, in any thread.

    Args:
        total: Number of views.
        before: Those that were there in the beginning.

    Attributes:
        empty: Maps so far that show no point.
    """

    def __init__(self, total: int, before: int) -> None:
        self.empty = 0
        self._total, self._before, self._done = total, before, before
        self._begun = time.perf_counter()
        self._tenths = before * 10 // total
        self._console = Console(stderr=True, highlight=False)
        columns = (
            TextColumn("drawing"),
            BarColumn(bar_width=None),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]} views/s"),
            TextColumn("{task.fields[left]}"),
        )
        is_live = self._console.is_terminal
        self._bar = Progress(*columns, console=self._console, expand=True, disable=not is_live)
        self._task = self._bar.add_task("", total=total, completed=before, rate="-", left="-:--")

    def __call__(self, maps: Sequence[DepthMap]) -> None:
        """Show that more views are written."""
        self._done += len(maps)
        self.empty += sum(depth_map.stats.drawn == 0 for depth_map in maps)
        rate = (self._done - self._before) / max(time.perf_counter() - self._begun, 1e-9)
        left = (self._total - self._done) / rate
        self._bar.update(self._task, completed=self._done, rate=f"{rate:,.0f}", left=_minutes(left))
        if self._bar.disable and self._done * 10 // self._total > self._tenths:
            self._tenths = self._done * 10 // self._total
            self._console.print(
                f"drawing: {self._done:,} of {self._total:,}, {rate:,.1f} views/s, "
                f"{left:,.0f} s left",
                soft_wrap=True,
            )

    def __enter__(self) -> DrawnLine:
        self._begun = time.perf_counter()
        self._bar.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._bar.stop()


def _minutes(seconds: float) -> str:
    """A time as minutes and seconds, from an hour on with the hours before them."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02}:{rest:02}" if hours else f"{minutes}:{rest:02}"


class Interruption:
    """What the signals that end a program do: at once, or where it is awaited a little later.

    A second signal does not wait. Signals that whoever started us had ignored stay so.

    Attributes:
        has_come: Whether the work should end soon.
    """

    def __init__(self) -> None:
        self.has_come = False
        self._waits = False
        self._before: dict[signal.Signals, Any] = {}

    def __enter__(self) -> Interruption:
        before = {number: signal.getsignal(number) for number in ENDING}
        self._before = {n: old for n, old in before.items() if old is not signal.SIG_IGN}
        for number in self._before:
            signal.signal(number, self._come)
        return self

    def __exit__(self, kind: object, error: BaseException | None, trace: object) -> None:
        for number, old in self._before.items():
            signal.signal(number, old)
        # A signal in a library's import comes out of it as an ImportError, for example.
        if self.has_come and isinstance(error, Exception) and not isinstance(error, DepthwarpError):
            raise KeyboardInterrupt from error

    @contextmanager
    def is_awaited(self) -> Iterator[None]:
        """The work in the block looks at `has_come` by itself."""
        self._waits = True
        try:
            yield
        finally:
            self._waits = False

    @contextmanager
    def held_off(self, context: AbstractContextManager[T]) -> Iterator[T]:
        """Enter and leave a context whole: a signal waits until it is entered, or left.

        Raises:
            KeyboardInterrupt: The signal that has waited.
        """
        with self.is_awaited():
            entered = context.__enter__()
        try:
            if self.has_come:
                raise KeyboardInterrupt
            yield entered
        finally:
            with self.is_awaited():
                context.__exit__(*sys.exc_info())

    def _come(self, number: int, frame: FrameType | None) -> None:
        is_second, self.has_come = self.has_come, True
        if is_second or not self._waits:
            raise KeyboardInterrupt
