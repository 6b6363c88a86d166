"""Checks of scalar arguments, one message shape for all: name, expected, got."""

from __future__ import annotations

import math
import numbers
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError

__all__ = [
    "MAX_SIDE",
    "check_choice",
    "check_count",
    "check_finite_vector",
    "check_fov",
    "check_matrix",
    "check_points",
    "check_positive",
    "check_size",
    "check_window",
    "is_number",
]

MAX_SIDE = 1 << 20
"""Longest image side [px]: far below 2^23, where float32 pixel coordinates stop being exact."""

Choice = TypeVar("Choice", bound=str)


def check_positive(name: str, value: float, unit: str = "") -> float:
    """Return `value` if it is a finite number above zero."""
    if not is_number(value) or not (math.isfinite(value) and value > 0):
        got = value if is_number(value) else repr(value)
        raise InputError(f"{name} must be a finite number above 0{unit and ' ' + unit}, got {got}")
    return float(value)


def check_count(name: str, value: int, least: int = 0) -> int:
    """Return a whole number from `least`."""
    if not is_number(value) or not _is_whole(value) or value < least:
        raise InputError(f"{name} must be a whole number from {least}, got {value!r}")
    return int(value)


def check_finite_vector(name: str, values: Sequence[float], length: int) -> tuple[float, ...]:
    """Return `values` as a tuple of `length` finite floats."""
    try:
        vector = tuple(float(value) for value in values)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} must be {length} numbers, got {values!r}") from error
    if len(vector) != length or not all(math.isfinite(value) for value in vector):
        raise InputError(f"{name} must be {length} finite numbers, got {vector}")
    return vector


def check_fov(fov: Sequence[float]) -> tuple[float, float]:
    """Return (horizontal, vertical) field of view [degrees], each strictly between 0 and 180."""
    horizontal, vertical = check_finite_vector("fov", fov, 2)
    for name, angle in (("horizontal", horizontal), ("vertical", vertical)):
        if not 0.0 < angle < 180.0:
            raise InputError(
                f"fov: the {name} angle must be above 0 and below 180 degrees, got {angle}"
            )
    return horizontal, vertical


def check_size(size: Sequence[int]) -> tuple[int, int]:
    """Return an image size (width, height) [px] of whole numbers from 1 to `MAX_SIDE`."""
    try:
        sides = tuple(size)
    except TypeError:  # one number
        sides = ()
    if len(sides) != 2 or not all(_is_whole(side) for side in sides):
        got = f"({', '.join(map(str, sides))})" if sides else size
        raise InputError(f"size must be two whole numbers in one tuple (width, height), got {got}")
    width, height = int(size[0]), int(size[1])
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE):
        raise InputError(f"size must be from 1 to {MAX_SIDE} pixels a side, got {width} x {height}")
    return width, height


def check_window(name: str, side: int, most: int = MAX_SIDE) -> int:
    """Return the side or radius of a window [px], a whole number from 1 to `most`."""
    if not is_number(side) or not _is_whole(side) or not 1 <= side <= most:
        raise InputError(f"{name} must be a whole number from 1 to {most} pixels, got {side}")
    return int(side)


def check_matrix(name: str, values: npt.ArrayLike, side: int) -> npt.NDArray[np.float64]:
    """Return `values` as a square matrix of finite numbers, float64."""
    expected = f"{name} must be a finite {side} x {side} matrix"
    try:
        matrix = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"{expected}, got {values!r}") from error
    if matrix.shape != (side, side):
        raise InputError(f"{expected}, got shape {matrix.shape}")
    for row, column in np.argwhere(~np.isfinite(matrix)).tolist():
        raise InputError(f"{expected}, got {matrix[row, column]} at [{row}, {column}]")
    return matrix


def check_points(values: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """Return points as an array of shape (N, 3), float64; they may hold NaN."""
    try:
        points = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InputError(f"points_world must be numbers of shape (N, 3): {error}") from error
    if points.ndim != 2 or points.shape[1] != 3:
        one = ": one point is [[x, y, z]]" if points.shape == (3,) else ""
        raise InputError(f"points_world must have the shape (N, 3), got {points.shape}{one}")
    return points


def check_choice(name: str, value: Choice, choices: Sequence[Choice]) -> Choice:
    """Return `value` if it is one of `choices`."""
    if value not in choices:
        raise InputError(f"{name} must be one of {', '.join(map(repr, choices))}, got {value!r}")
    return value


def is_number(value: object) -> bool:
    """Whether a value is one real number, infinity and NaN included; a truth value is none."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    return isinstance(value, numbers.Real) and not isinstance(value, bool)


def _is_whole(value: float) -> bool:
    try:
        return value == int(value)
    except (TypeError, ValueError, OverflowError):  # not a number, NaN, infinite
        return False
