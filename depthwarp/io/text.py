"""Rows of text: XYZ, TXT, CSV, PTS; with or without a row of column names."""

from __future__ import annotations

import mmap
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.cloud import PointCloud
from depthwarp.errors import FileFormatError
from depthwarp.io.columns import COLOR_COLUMNS, Offset, cloud_from_columns, find_columns
from depthwarp.io.header import parse_count
from depthwarp.io.rows import TextTable, check_rows_fit

__all__ = ["read_pts", "read_text"]

BYTE_ORDER_MARK = b"\xef\xbb\xbf"

MAX_LINE = 1 << 16
"""Longest line [character] before the first point: text has shorter ones."""

COORDINATES = ("x", "y", "z")
NORMAL = ("nx", "ny", "nz")
COLOR = COLOR_COLUMNS[0]

FLOAT64_WHOLE = 2.0**53
"""Largest value up to which float64 holds every whole number."""


@dataclass(frozen=True)
class Layout:
    """What the lines before the first point, and the first point's own line, say about a file.

    Attributes:
        start: Offset of the first point's line [byte].
        first_row: Its values, as they are written.
        delimiter: What separates them; None is white space.
        names: Column names that the file gives, or None.
        count: Points that the first line claims, or None.
    """

    start: int
    first_row: list[str]
    delimiter: str | None
    names: list[str] | None
    count: int | None


def read_text(path: Path, offset: Offset | None) -> PointCloud:
    """Read .xyz, .txt or .csv: white space, comma or semicolon, `#` and `//` comments.

    Column names come from a first row of names, also one that is commented out. Without one,
    3 columns are x y z, 4 add intensity, 6 add the colour if all are whole numbers from 0 to 255
    and else the normal; other columns are `column_4` and so on. Columns of whole numbers become
    int64, others float64.

    Raises:
        FileFormatError: No points, or a line that is no row of numbers; the message names it.
        InputError: Coordinates that float32 would move by more than 1 mm.
    """
    return _read(path, offset, is_pts=False)


def read_pts(path: Path, offset: Offset | None) -> PointCloud:
    """Read .pts: the number of points, then x y z [intensity] [red green blue] a line.

    Raises:
        FileFormatError: No count, another count of rows, or a line that is no row of numbers.
        InputError: Coordinates that float32 would move by more than 1 mm.
    """
    return _read(path, offset, is_pts=True)


def _read(path: Path, offset: Offset | None, *, is_pts: bool) -> PointCloud:
    layout = _inspect(path, has_count=is_pts)
    if layout.count == 0 and not layout.first_row:
        return PointCloud(np.empty((0, 3), np.float32))
    names = layout.names or _default_names(len(layout.first_row), is_pts, path)
    if len(names) != len(layout.first_row):
        raise FileFormatError(
            f"{path}: {len(names)} column names, but {len(layout.first_row)} columns; correct the "
            "row of names"
        )
    columns = _read_columns(path, layout, names)
    if layout.names is None and names[3:] == list(COLOR) and not _is_byte_color(columns):
        columns = {NORMAL[COLOR.index(n)] if n in COLOR else n: c for n, c in columns.items()}
    return cloud_from_columns(columns, path, offset)


def _inspect(path: Path, *, has_count: bool) -> Layout:
    """Look at a file up to its first point."""
    count: int | None = None
    names: list[str] | None = None
    comment = ""
    with path.open("rb") as file:
        marked = file.read(len(BYTE_ORDER_MARK)) == BYTE_ORDER_MARK
    # newline="" keeps line ends, so that lengths add up to the offset of the first point.
    with path.open(encoding="latin-1", newline="") as file:
        start = len(file.read(len(BYTE_ORDER_MARK))) if marked else 0
        for number, line in enumerate(iter(lambda: file.readline(MAX_LINE), ""), start=1):
            if len(line) == MAX_LINE or "\0" in line:
                raise FileFormatError(f"{path}: line {number}: not text; check the suffix")
            content = re.split("#|//", line)[0].strip()
            delimiter = next((mark for mark in ";," if mark in content), None)
            words = [word.strip().strip('"') for word in content.split(delimiter)]
            if not content:
                comment = line.strip() or comment
            elif has_count and count is None:
                if len(words) != 1:
                    raise FileFormatError(
                        f"{path}: line {number}: a .pts file begins with the number of points; "
                        "if it is missing, name the file .xyz"
                    )
                count = parse_count(path, number, words[0])
            elif names is None and not all(map(_is_number, words)):
                names = _column_names(words, path, number)
            else:
                names = names or _commented_names(comment, len(words))
                return Layout(start, words, delimiter, names, count)
            start += len(line)
    if count is None:
        raise FileFormatError(f"{path}: no points: the file has no row of numbers")
    check_rows_fit(path, claimed=count, present=0)
    return Layout(start, [], None, names, count)


def _column_names(words: list[str], path: Path, number: int) -> list[str]:
    """The names in a first row, checked."""
    names = [word or f"column_{k}" for k, word in enumerate(words, start=1)]
    if not set(COORDINATES) <= {name.lower() for name in names}:
        raise FileFormatError(
            f"{path}: line {number}: neither numbers nor column names with x, y, z: "
            f"'{' '.join(words)[:80]}'"
        )
    if doubled := {name for name in names if names.count(name) > 1}:
        raise FileFormatError(f"{path}: line {number}: two columns are called '{min(doubled)}'")
    return names


def _commented_names(comment: str, columns: int) -> list[str] | None:
    """Column names in the last comment before the first point, such as `//X Y Z R G B`."""
    names = [name.strip('"') for name in re.split(r"[\s,;]+", comment.strip("#/ \t"))]
    is_list = len(names) == columns == len(set(names))
    return names if is_list and set(COORDINATES) <= {name.lower() for name in names} else None


def _default_names(columns: int, is_pts: bool, path: Path) -> list[str]:
    """What columns without names are."""
    if columns < 3:
        raise FileFormatError(f"{path}: rows have {columns} values, expected x y z at least")
    if columns == 4:
        return [*COORDINATES, "intensity"]
    if columns == 6:
        return [*COORDINATES, *COLOR]  # or the normal, as their values say
    if columns == 7 and is_pts:
        return [*COORDINATES, "intensity", *COLOR]
    return [*COORDINATES, *(f"column_{k}" for k in range(4, columns + 1))]


def _read_columns(path: Path, layout: Layout, names: list[str]) -> dict[str, npt.NDArray[Any]]:
    """All columns: int64 where all values are whole numbers, else float64."""
    comments = _comments(path, layout.start)

    def read(types: list[str]) -> dict[str, npt.NDArray[Any]]:
        row = np.dtype([(f"f{k}", type_) for k, type_ in enumerate(types)])
        rows = TextTable(
            path, row, layout.start, delimiter=layout.delimiter, comments=comments
        ).read(layout.count)
        return {name: rows[f"f{k}"] for k, name in enumerate(names)}

    columns = read(["f8"] * len(names))
    color = find_columns(columns, COLOR_COLUMNS) or ()
    bright = any(columns[name].max() > 1.0 for name in color)
    whole = {
        name
        for name, word in zip(names, layout.first_row, strict=True)
        # '1.0' is a real number that happens to be whole, except in a colour that exceeds 0..1.
        if name.lower() not in COORDINATES
        and (re.fullmatch("[+-]?[0-9]+", word) or (name in color and bright))
        and _is_whole(columns[name])
    }
    inexact = {name for name in whole if np.abs(columns[name]).max() > FLOAT64_WHOLE}
    if inexact:  # such as times in nanoseconds: read them again as integers
        columns = read(["i8" if name in inexact else "f8" for name in names])
    return {
        name: values.astype(np.int64) if name in whole else values
        for name, values in columns.items()
    }


def _is_whole(values: npt.NDArray[np.float64]) -> bool:
    """Whether all values are whole numbers that int64 holds."""
    return bool(np.all(np.abs(values) < 2.0**63) and np.all(values == np.rint(values)))


def _is_byte_color(columns: dict[str, npt.NDArray[Any]]) -> bool:
    return all(
        columns[name].dtype == np.int64
        and columns[name].min() >= 0
        and columns[name].max() <= np.iinfo(np.uint8).max
        for name in COLOR
    )


def _comments(path: Path, start: int) -> tuple[str, ...]:
    """The comment marks to look for from `start`: a second one makes parsing slower."""
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
        return ("#", "//") if data.find(b"//", start) >= 0 else ("#",)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
