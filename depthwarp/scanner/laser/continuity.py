"""Telling a line from lone peaks: a line goes on in the rows beside."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["MIN_ROWS", "is_connected"]

MIN_ROWS = 4
"""Points that a stretch of line has at least; noise in one cell of a mosaic reaches two rows."""

MAX_GAP = 3  # rows between two points of a stretch
MAX_SLOPE = 4.0  # columns a row


def is_connected(
    rows: npt.NDArray[np.int32], columns: npt.NDArray[np.float64]
) -> npt.NDArray[np.bool_]:
    """Whether each point lies on a stretch of at least `MIN_ROWS` points.

    Args:
        rows: Ascending, shape (M,).
        columns: Shape (M,).

    Returns:
        Shape (M,).
    """
    gaps = np.diff(rows)
    is_break = (gaps > MAX_GAP) | (np.abs(np.diff(columns)) > MAX_SLOPE * gaps)
    stretch = np.concatenate([[0], np.cumsum(is_break)])[: len(rows)]
    lengths = np.bincount(stretch, minlength=1)
    return np.asarray(lengths[stretch] >= MIN_ROWS)
