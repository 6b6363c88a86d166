"""Ends of a line: rows that see it only in part, and hold a point beside it.

Where a line ends or jumps to another depth, a row of pixels lies across the end: the lens blurs
light from beyond into it, and of a slanted line only one side is left. The peak of such a row is
pulled aside, which its own noise does not tell; the rows further in do.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthwarp.scanner.laser.continuity import MAX_GAP, MAX_SLOPE

__all__ = ["is_beside_end"]

END_ROWS = 4  # points at an end that may be pulled aside
FIT_ROWS = 8  # points further in through which the line is drawn
TOLERANCE_PX = 0.3  # bend of a real line over so few rows
TOLERANCE_SIGMAS = 3.0


def is_beside_end(
    rows: npt.NDArray[np.int32],
    columns: npt.NDArray[np.float64],
    sigma_px: npt.NDArray[np.float64],
) -> npt.NDArray[np.bool_]:
    """Whether each point belongs to an end that bends away from its stretch of line.

    A straight line through the points further in goes on to the end. From the innermost point that
    lies off it, all points to the end are marked. Stretches too short for that are left alone.

    Args:
        rows: Ascending, shape (M,).
        columns: Shape (M,).
        sigma_px: Standard deviation of the columns, shape (M,).

    Returns:
        Shape (M,).
    """
    beside = np.zeros(len(rows), bool)
    gaps = np.diff(rows)
    is_break = (gaps > MAX_GAP) | (np.abs(np.diff(columns)) > MAX_SLOPE * gaps)
    first = np.concatenate([[0], np.flatnonzero(is_break) + 1])
    last = np.concatenate([first[1:], [len(rows)]]) - 1
    is_long = last - first + 1 >= 2 * END_ROWS + FIT_ROWS
    for ends, inwards in ((first[is_long], 1), (last[is_long], -1)):
        near = ends[:, None] + inwards * np.arange(END_ROWS)
        inner = ends[:, None] + inwards * np.arange(END_ROWS, END_ROWS + FIT_ROWS)
        middle = rows[inner].mean(axis=1, keepdims=True)
        across = rows[inner] - middle
        spread = (across**2).sum(axis=1, keepdims=True)
        slope = (across * columns[inner]).sum(axis=1, keepdims=True) / spread
        away = rows[near] - middle
        offset = columns[near] - columns[inner].mean(axis=1, keepdims=True) - slope * away
        fit_variance = (sigma_px[inner] ** 2).mean(axis=1, keepdims=True)
        variance = sigma_px[near] ** 2 + fit_variance * (1 / FIT_ROWS + away**2 / spread)
        is_off = np.abs(offset) > TOLERANCE_PX + TOLERANCE_SIGMAS * np.sqrt(variance)
        to_the_end = np.logical_or.accumulate(is_off[:, ::-1], axis=1)[:, ::-1]
        beside[near[to_the_end]] = True
    return beside
