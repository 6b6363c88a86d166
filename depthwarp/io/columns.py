"""Named columns of a file, whatever its format, become the points and attributes of a cloud."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.cloud import PointCloud, to_float32_points
from depthwarp.errors import FileFormatError

__all__ = ["COLOR_COLUMNS", "Offset", "cloud_from_columns", "find_columns", "points_from_columns"]

Offset = tuple[float, float, float]
"""x, y, z [m] that a reader subtracts from the file's coordinates in float64."""

POINT_COLUMNS = (("x", "y", "z"),)
COLOR_COLUMNS = (("red", "green", "blue"), ("r", "g", "b"))
NORMAL_COLUMNS = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"))

# The attribute's name and the names it has in files, the likeliest first.
SCALAR_COLUMNS = {
    "intensity": ("intensity", "scalar_intensity"),
    "ring": ("ring",),
    "time": ("time", "timestamp", "t"),
}


def cloud_from_columns(
    columns: Mapping[str, npt.NDArray[Any]], path: Path, offset: Offset | None
) -> PointCloud:
    """Build a cloud from a file's columns, by name, in any letter case.

    x, y, z become the points; three columns of colour or of the normal become `color` and
    `normals`; intensity, ring and time get their standard name; every other column keeps its own.

    Args:
        columns: One array a column, shape (N,) or, for a column of k values, (N, k).
        path: The file, for error messages.
        offset: Subtracted from the coordinates [m] in float64, or None.

    Raises:
        FileFormatError: No x, y, z, or a column that cannot keep its name.
        InputError: Coordinates that float32 would move by more than 1 mm.
    """
    position = find_columns(columns, POINT_COLUMNS)
    if position is None:
        raise FileFormatError(
            f"{path}: no columns x, y, z with one number a point; it has {', '.join(columns)}"
        )
    points = points_from_columns([columns[name] for name in position], path, offset)
    used = set(position)
    attributes: dict[str, npt.NDArray[Any]] = {}

    color = find_columns(columns, COLOR_COLUMNS)
    if color is not None and "color" not in columns:
        attributes["color"] = _color([columns[name] for name in color])
        used.update(color)
    normal = find_columns(columns, NORMAL_COLUMNS)
    if normal is not None and "normals" not in columns:
        attributes["normals"] = _stack([columns[name] for name in normal], np.dtype(np.float32))
        used.update(normal)
    for attribute, aliases in SCALAR_COLUMNS.items():
        found = next(filter(None, (_find(columns, alias) for alias in aliases)), None)
        if found is not None:
            attributes[attribute] = _own_copy(columns[found])
            used.add(found)
    for name, values in columns.items():
        if name not in used:
            attributes[name] = _own_copy(values)
    if "points" in attributes:
        raise FileFormatError(
            f"{path}: a column is called 'points', the name of the coordinates: rename it"
        )
    return PointCloud(points, attributes)


def points_from_columns(
    columns: Sequence[npt.NDArray[Any]], path: Path, offset: Offset | None
) -> npt.NDArray[np.float32]:
    """Return x, y, z columns as points [m], shape (N, 3), float32, less the offset.

    Raises:
        FileFormatError: A column that is not of real numbers.
        InputError: Coordinates that float32 would move by more than 1 mm.
    """
    for axis, column in zip("xyz", columns, strict=True):
        if column.dtype.kind not in "fiu":
            raise FileFormatError(f"{path}: {axis} must be real numbers, got {column.dtype}")
    exact = offset is None and all(column.dtype.newbyteorder("=") == "f4" for column in columns)
    points = _stack(columns, np.dtype(np.float32 if exact else np.float64))
    with np.errstate(invalid="ignore", over="ignore"):  # as in _stack
        if offset is not None:
            points -= np.asarray(offset, np.float64)
        return to_float32_points(points, name=f"{path}: coordinates")


def find_columns(
    columns: Mapping[str, npt.NDArray[Any]], choices: Iterable[tuple[str, str, str]]
) -> tuple[str, str, str] | None:
    """Return the three columns, as the file spells them, of the first choice that is complete."""
    for choice in choices:
        first, second, third = (_find(columns, name) for name in choice)
        if first is None or second is None or third is None:
            continue
        if all(columns[name].ndim == 1 for name in (first, second, third)):
            return first, second, third
    return None


def _find(columns: Mapping[str, npt.NDArray[Any]], name: str) -> str | None:
    """The column of this name: spelt exactly so, or else in another letter case."""
    if name in columns:
        return name
    return next((own for own in columns if own.lower() == name), None)


def _color(columns: Sequence[npt.NDArray[Any]]) -> npt.NDArray[Any]:
    """Colour without loss: bytes and 16-bit stay, wider integers shrink if they fit, floats stay.

    Text and some writers store bytes as wide integers; uint16 is never narrowed, because a dark
    16-bit colour may well lie below 256.
    """
    common = np.result_type(*columns)
    if common.kind == "f":
        return _stack(columns, np.dtype(np.float32))
    if common.kind in "iu" and common not in (np.uint8, np.uint16):
        for narrow in (np.dtype(np.uint8), np.dtype(np.uint16)):
            largest = np.iinfo(narrow).max
            if all(
                column.min(initial=0) >= 0 and column.max(initial=0) <= largest
                for column in columns
            ):
                return _stack(columns, narrow)
    return _stack(columns, common)


def _stack(columns: Sequence[npt.NDArray[Any]], dtype: np.dtype[Any]) -> npt.NDArray[Any]:
    """Columns side by side, shape (N, k), filled one by one: no copy besides the result."""
    stacked = np.empty((len(columns[0]), len(columns)), dtype)
    # A NaN may be a signalling one, and a colour or normal too large for float32 becomes infinite.
    with np.errstate(invalid="ignore", over="ignore"):
        for k, column in enumerate(columns):
            stacked[:, k] = column
    return stacked


def _own_copy(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """A contiguous copy in this machine's byte order, so that the file's rows can be let go."""
    return np.array(values, dtype=values.dtype.newbyteorder("="), order="C")
