"""What a command says: results on stdout, progress and people's text on stderr."""

from __future__ import annotations

import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
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

__all__ = ["Reporter"]


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
    def progress(self, name: str, text: str, total: int) -> Iterator[Callable[[int], None]]:
        """Show how far a long step is, with the time left; give a function that takes the count.

        Without a terminal a line is written about every tenth of the way.
        """
        start = time.perf_counter()
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeRemainingColumn(),
        )
        with Progress(
            *columns, console=self._console, disable=not self._console.is_terminal
        ) as bar:
            task = bar.add_task(escape(text), total=total)
            tenths = -1

            def update(done: int) -> None:
                nonlocal tenths
                bar.update(task, completed=done)
                if not self._console.is_terminal and done * 10 // total > tenths:
                    tenths = done * 10 // total
                    self.say(f"{text}: {done} of {total}")

            yield update
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
