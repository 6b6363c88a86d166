"""Rows of numbers, binary or text, with the header's claim checked against the file's real size."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.cloud import MAX_POINTS
from depthwarp.errors import FileFormatError, InputError

__all__ = ["TextTable", "binary_rows", "check_rows_fit"]

LINES_A_SEARCH = 4096
"""Lines parsed at once while looking for the one that is wrong."""


def binary_rows(
    path: Path, dtype: np.dtype[Any], *, start: int, count: int, is_last: bool
) -> npt.NDArray[Any]:
    """Map `count` binary rows that begin at byte `start`; nothing is read before it is used.

    Args:
        path: The file.
        dtype: Structured type of one row, with its byte order.
        start: Offset of the first row [byte].
        count: Rows that the header claims.
        is_last: Whether nothing may follow the rows (except padding with zeros or line ends).

    Returns:
        Read-only rows, shape (count,), `dtype`.

    Raises:
        FileFormatError: The file holds fewer rows, or more.
    """
    available = path.stat().st_size - start
    present = max(0, available) // dtype.itemsize
    check_rows_fit(path, claimed=count, present=present)
    if is_last and present > count:
        with path.open("rb") as file:
            file.seek(start + count * dtype.itemsize)
            # A look at the first rows is enough: padding is all zeros or line ends.
            if file.read(16 * dtype.itemsize).strip(b"\0\r\n \t"):
                raise _more_than_claimed(path, claimed=count, present=f"{present}")
    if count == 0:
        return np.empty(0, dtype)  # an empty range cannot be mapped
    return np.memmap(path, dtype, mode="r", offset=start, shape=(count,))


@dataclass(frozen=True)
class TextTable:
    """Rows of text in a file.

    Attributes:
        path: The file.
        row: Structured type of one row; a field of k values stands for k columns.
        start: Offset of the first line [byte].
        skip_lines: Lines to pass over after `start`.
        delimiter: What separates columns; None means any white space.
        comments: What begins a comment.
    """

    path: Path
    row: np.dtype[Any]
    start: int
    skip_lines: int = 0
    delimiter: str | None = None
    comments: tuple[str, ...] = ()

    @property
    def columns(self) -> int:
        """Number of text columns."""
        return sum(int(np.prod(self.row[name].shape)) for name in self.row.names or ())

    def read(self, count: int | None = None, *, is_last: bool = True) -> npt.NDArray[Any]:
        """Parse the rows.

        Args:
            count: Rows that the header claims, or None for all lines to the end.
            is_last: Whether nothing may follow the claimed rows.

        Returns:
            Rows, shape (count,), of type `row`.

        Raises:
            FileFormatError: Fewer rows than claimed, more rows, or a line that is not such a row:
                the message names the line.
        """
        if count is not None:
            self._check_claim(count)
        # One row more than claimed shows that there are more, at no cost.
        limit = count if count is None or not is_last else count + 1
        if limit == 0:
            return np.empty(0, self.row)
        try:
            with self._lines() as lines:
                rows = self._parse(lines, limit)
        except (ValueError, Warning) as error:
            raise self._locate(error) from error
        if count is not None:
            check_rows_fit(self.path, claimed=count, present=rows.size)
            if rows.size > count:
                raise _more_than_claimed(self.path, claimed=count, present="more")
        return rows

    def _check_claim(self, count: int) -> None:
        """Refuse a count that cannot be true, before memory for it is set aside."""
        available = self.path.stat().st_size - self.start
        if self.skip_lines > available:
            raise FileFormatError(
                f"{self.path}: the header claims {self.skip_lines} lines before the points, the "
                f"file holds {available} bytes; it is cut short: copy the file again"
            )
        # A value takes a digit and a separator at least.
        if count * 2 * self.columns + self.skip_lines > available + 1:
            with self._lines() as lines:
                present = sum(1 for line in lines if line.strip())
            check_rows_fit(self.path, claimed=count, present=present)
        check_rows_fit(self.path, claimed=count, present=count)

    @contextmanager
    def _lines(self) -> Iterator[Iterator[str]]:
        """The open file's lines from the first row on."""
        with self.path.open("rb") as file:
            file.seek(self.start)
            with io.TextIOWrapper(file, encoding="latin-1") as text:
                yield islice(text, self.skip_lines, None)

    def _parse(self, lines: Iterable[str], limit: int | None = None) -> npt.NDArray[Any]:
        """Rows of `lines`; raises a ValueError or a Warning for what is not such a row."""
        with warnings.catch_warnings():
            # Old numpy versions only warn where '1.7' is cut to an integer.
            warnings.simplefilter("error")
            # Blank lines, and no rows at all, are for the caller to judge.
            warnings.filterwarnings("ignore", message=".*contained no data")
            return np.loadtxt(
                lines,
                dtype=self.row,
                comments=self.comments or None,
                delimiter=self.delimiter,
                max_rows=limit,
                ndmin=1,
            )

    def _locate(self, error: Exception) -> FileFormatError:
        """The error of a parse again, with the number of the line that caused it."""
        with self.path.open("rb") as file:
            head = io.TextIOWrapper(io.BytesIO(file.read(self.start)), encoding="latin-1")
            number = sum(1 for _ in head) + self.skip_lines
        with self._lines() as lines:
            while (block := list(islice(lines, LINES_A_SEARCH))) and self._error_of(block) is None:
                number += len(block)
        for line in block:
            number += 1
            if (line_error := self._error_of([line])) is not None:
                return FileFormatError(
                    f"{self.path}: line {number}: {self._why(line, line_error)}; correct the line, "
                    "or copy the file again if it was cut short"
                )
        return FileFormatError(f"{self.path}: {error}; copy the file again")

    def _error_of(self, lines: list[str]) -> Exception | None:
        try:
            self._parse(lines)
        except (ValueError, Warning) as error:
            return error
        return None

    def _why(self, line: str, error: Exception) -> str:
        """What is wrong with one line, in the words of someone who looks at the file."""
        for mark in self.comments:
            line = line.split(mark)[0]
        found = len(line.strip().split(self.delimiter))
        if found != self.columns:
            return f"{found} values, expected {self.columns}"
        return str(error).split(" at row ")[0]


def check_rows_fit(path: Path, *, claimed: int, present: int) -> None:
    """Check a header's number of points against the file and against what a cloud can hold.

    Raises:
        FileFormatError: Fewer rows are present than claimed.
        InputError: More points than one cloud can hold.
    """
    if present < claimed:
        raise FileFormatError(
            f"{path}: the header claims {claimed} points, the file holds {present}; it is cut "
            "short or its header is wrong: copy the file again"
        )
    if claimed > MAX_POINTS:
        raise InputError(
            f"{path}: {claimed} points, at most {MAX_POINTS} fit one cloud: split the file"
        )


def _more_than_claimed(path: Path, *, claimed: int, present: str) -> FileFormatError:
    return FileFormatError(
        f"{path}: the header claims {claimed} points, the file holds {present}; correct the "
        "header or copy the file again"
    )
