"""The text header that PLY and PCD files begin with."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from depthwarp.errors import FileFormatError

__all__ = ["parse_count", "read_header"]

MAX_HEADER_BYTES = 1 << 20
"""Longest header that is looked at: real ones have a few hundred bytes."""


def read_header(
    path: Path, *, first: str, is_last: Callable[[list[str]], bool], last: str
) -> tuple[list[list[str]], int]:
    """Return the words of each header line and the byte offset of what follows the header.

    Args:
        path: The file.
        first: What the first line must begin with, for telling the format.
        is_last: Whether a line, given as its words, ends the header.
        last: What that line looks like, for the error message.

    Raises:
        FileFormatError: Another first line, or no last line within 1 MB.
    """
    lines: list[list[str]] = []
    with path.open("rb") as file:
        while file.tell() < MAX_HEADER_BYTES:
            line = file.readline(MAX_HEADER_BYTES).decode("latin-1")
            if not lines and not line.startswith(first):
                raise FileFormatError(
                    f"{path}: the first line must begin with '{first}', got {line[:20]!r}; check "
                    "that the suffix names the real format"
                )
            if not line:
                break
            lines.append(line.split())
            if is_last(lines[-1]):
                return lines, file.tell()
    raise FileFormatError(
        f"{path}: the header has no line '{last}' in its first {len(lines)} lines; "
        "the file is cut short or damaged: copy it again"
    )


def parse_count(path: Path, line_number: int, word: str) -> int:
    """Return a count [1] written in a header, at least zero.

    Raises:
        FileFormatError: Not a whole number, or a negative one.
    """
    if not (word.isascii() and word.isdigit() and len(word) < 100):
        raise FileFormatError(
            f"{path}: line {line_number}: expected a whole number, got '{word[:40]}'"
        )
    return int(word)
