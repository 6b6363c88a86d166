"""What a command says: results on stdout, progress and people's text on stderr."""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeRemainingColumn,
)

from depthwarp.errors import LensDomainWarning

__all__ = ["ProgressLine", "Reporter", "quiet_warp"]


class ProgressLine:
    """How far a long step is; called with the count of what is done.

    On a terminal one line that is drawn again and again, else a line about every tenth of the way.

    Args:
        console: Where it is shown.
        text: What is under way.
        total: The count at the end.
        is_live: Whether the line may be drawn again; not while a person is asked things.
    """

    def __init__(self, console: Console, text: str, total: int, *, is_live: bool = True) -> None:
        self._console, self._text, self._total = console, text, total
        self._is_live = is_live and console.is_terminal
        self._tenths = -1
        columns = (
            TextColumn("{task.description}"),
            BarColumn(bar_width=None),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
        )
        self._bar = Progress(*columns, console=console, expand=True, disable=not self._is_live)
        self._task = self._bar.add_task(escape(text), total=total)

    def __call__(self, done: int) -> None:
        """Show that so much is done."""
        self._bar.update(self._task, completed=done)
        if not self._is_live and done * 10 // self._total > self._tenths:
            self._tenths = done * 10 // self._total
            self._console.print(escape(f"{self._text}: {done} of {self._total}"), soft_wrap=True)

    def describe(self, text: str | None = None) -> None:
        """Say something else of what is under way, or again what was said in the beginning."""
        if self._is_live:
            self._bar.update(self._task, description=escape(text or self._text), refresh=True)
        elif text is not None:
            self._console.print(escape(text), soft_wrap=True)

    @contextmanager
    def left_alone(self) -> Iterator[None]:
        """Let go of the terminal for a while."""
        self._bar.stop()
        yield
        self._bar.start()

    def __enter__(self) -> ProgressLine:
        self._bar.start()
        return self

    def __exit__(self, *exception: object) -> None:
        self._bar.stop()


class Reporter:
    """Where a command's words go.

    With `as_json` stdout holds one JSON object and nothing else; all else is on stderr.

    Args:
        as_json: Whether the result is for a program.
    """

    def __init__(self, as_json: bool) -> None:
        self.as_json = as_json
        self._console = Console(stderr=True, highlight=False)
        self.seconds: dict[str, float] = {}

    @contextmanager
    def stage(self, name: str, text: str) -> Iterator[None]:
        """Show that a step is under way, and add how long it took to `seconds[name]` [s]."""
        start = time.perf_counter()
        if self._console.is_terminal:
            with self._console.status(escape(text)):
                yield
        else:
            self.say(text)
            yield
        took = time.perf_counter() - start
        self.seconds[name] = round(self.seconds.get(name, 0.0) + took, 4)

    @contextmanager
    def lens_warnings(self, path: Path) -> Iterator[None]:
        """Show what is wrong with the lenses of a file as lines, each once, without the source."""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", LensDomainWarning)
            yield
        for text in dict.fromkeys(str(warning.message) for warning in caught):
            self.say(f"warning: {path}: {text}")

    @contextmanager
    def progress(
        self, name: str, text: str, total: int, *, is_live: bool = True
    ) -> Iterator[ProgressLine]:
        """Show how far a long step is, and add how long it took to `seconds[name]` [s].

        Args:
            name: Of the step in `seconds`.
            text: What is under way.
            total: The count at the end.
            is_live: See `ProgressLine`.
        """
        start = time.perf_counter()
        with ProgressLine(self._console, text, total, is_live=is_live) as line:
            yield line
        took = time.perf_counter() - start
        self.seconds[name] = round(self.seconds.get(name, 0.0) + took, 4)

    def say(self, text: str) -> None:
        """Text for people, on stderr."""
        self._console.print(escape(text), soft_wrap=True)

    def error(self, text: str) -> None:
        """What went wrong, on stderr; with `as_json` also as the one object on stdout."""
        self._console.print(f"[bold red]error:[/] {escape(text)}", soft_wrap=True)
        if self.as_json:
            self.result({"error": text})

    def result(self, result: Mapping[str, Any]) -> None:
        """The command's result as one JSON object on stdout."""
        json.dump(result, sys.stdout, indent=2)
        sys.stdout.write("\n")


def quiet_warp() -> None:
    """Start Warp without its greeting and its compile messages.

    On a machine without a GPU the native library writes a warning straight to the process's
    stderr; that one line is dropped, `depthwarp doctor` lists the devices. All else is passed on.
    """
    import warp as wp

    wp.config.log_level = wp.LOG_ERROR
    sys.stderr.flush()
    with tempfile.TemporaryFile() as said:
        stderr = os.dup(2)
        os.dup2(said.fileno(), 2)
        try:
            wp.init()
        finally:
            os.dup2(stderr, 2)
            os.close(stderr)
            said.seek(0)
            for line in said:
                if b"NVIDIA CUDA driver" not in line:
                    os.write(2, line)
