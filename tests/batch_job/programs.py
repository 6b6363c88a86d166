"""The program in a process of its own, to be killed, stopped and starved."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PATIENCE_S = 60.0

LIMIT = """
import os, resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]),) * 2)
os.execv(sys.executable, [sys.executable, "-m", "depthwarp", *sys.argv[2:]])
"""
"""Becomes the program, with a limit to the size of its files."""


@contextmanager
def started(*arguments: object, largest: int | None = None) -> Iterator[subprocess.Popen[str]]:
    """The program while it runs; in the end it is gone, whatever it does.

    Args:
        arguments: Of the command line.
        largest: Size that no file may exceed [bytes]: a disk that is full, for one file.
    """
    command = [sys.executable, *(("-c", LIMIT, str(largest)) if largest else ("-m", "depthwarp"))]
    process = subprocess.Popen(
        [*command, *map(str, arguments)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    with process:  # its pipe is closed in the end
        try:
            yield process
        finally:
            if process.poll() is None:
                process.kill()


def end_of(process: subprocess.Popen[str]) -> tuple[int, str]:
    """Exit code of a program that comes to its end, and what it said on stderr."""
    _, said = process.communicate(timeout=PATIENCE_S)
    return process.returncode, said


def lines_of(folder: Path) -> int:
    """Views that the journal holds."""
    journal = folder / "views.jsonl"
    return journal.read_bytes().count(b"\n") if journal.exists() else 0


def wait_for_lines(process: subprocess.Popen[str], folder: Path, count: int) -> None:
    """Wait until so many views are written, or the process is at its end."""
    while lines_of(folder) < count and process.poll() is None:
        time.sleep(0.001)


def folder_of(output: Path) -> Path:
    """Where the journal of an output is."""
    return output.with_name(output.name + ".part") if output.suffix else output
