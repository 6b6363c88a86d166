"""Text files with one record a line: numbers, separated by white space."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from depthwarp.cameras.formats.content import beginning
from depthwarp.errors import FileFormatError, InputError

__all__ = [
    "begins_with_numbers",
    "data_lines",
    "finite_numbers",
    "place_errors",
    "text_lines",
    "whole_number",
]


def text_lines(path: Path) -> Iterator[tuple[int, str]]:
    """The lines of a text file without white space around them, counted from 1.

    Raises:
        FileFormatError: The content is not text, or there is none.
    """
    is_empty = True
    try:
        with path.open(encoding="utf-8-sig", newline="\n") as file:
            for number, line in enumerate(file, start=1):
                if "\0" in line:
                    raise FileFormatError(f"{path}: line {number}: not a text file (a zero byte)")
                is_empty = is_empty and not line.strip()
                yield number, line.strip()
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path}: not a text file ({error.reason})") from error
    if is_empty:
        raise FileFormatError(f"{path}: the file is empty; copy or write it again")


def data_lines(path: Path) -> Iterator[tuple[int, str]]:
    """The lines of a text file that are neither blank nor a comment (`#`), counted from 1.

    Raises:
        FileFormatError: The content is not text, or there is none.
    """
    for number, line in text_lines(path):
        if line and not line.startswith("#"):
            yield number, line


def begins_with_numbers(path: Path, count: int) -> bool:
    """Whether the first line that is neither blank nor a comment is so many numbers."""
    for line in beginning(path).split("\n"):
        if line.strip() and not line.lstrip().startswith("#"):
            return len(line.split()) == count and all(map(_is_number, line.split()))
    return False


def finite_numbers(path: Path, line: int, words: Sequence[str], what: str) -> list[float]:
    """The numbers of a line.

    Raises:
        FileFormatError: A word that is no number or a number that is not finite.
    """
    numbers = []
    for word in words:
        number = float(word) if _is_number(word) else math.nan
        if not math.isfinite(number):
            raise FileFormatError(
                f"{path}: line {line}: {what} must be finite numbers, got '{word[:40]}'"
            )
        numbers.append(number)
    return numbers


def whole_number(path: Path, line: int, word: str, what: str) -> int:
    """A whole number of a line, at least 0.

    Raises:
        FileFormatError: Another word.
    """
    if not (word.isascii() and word.isdigit() and len(word) < 20):
        raise FileFormatError(
            f"{path}: line {line}: {what} must be a whole number, got '{word[:40]}'"
        )
    return int(word)


@contextmanager
def place_errors(path: Path, place: str) -> Iterator[None]:
    """Name the file and the place in it of every error that its numbers cause.

    Raises:
        FileFormatError: In place of an InputError.
    """
    try:
        yield
    except InputError as error:
        raise FileFormatError(f"{path}: {place}: {error}") from error


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return "_" not in word  # Python's own way to group digits
