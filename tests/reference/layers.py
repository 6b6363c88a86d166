"""Layers of a depth map in plain loops: own-layer spacing, and the nearest pixel of every area.

All numbers are float32 and every sum is taken in the kernels' order: the results are the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ERASED = 3
COMPANIONS, FARTHEST_RING, NO_RING, LEVELS = 4, 32, 33, 5
f32 = np.float32


@dataclass(frozen=True)
class Grid:
    """Metres between neighbouring pixels (a metre of depth, constant), and whether columns wrap."""

    slope: float
    constant: float = 0.0
    wraps: bool = False

    def pitch(self, depth: np.float32) -> np.float32:
        """Metres between neighbouring pixels at a depth."""
        return f32(self.slope) * depth + f32(self.constant)

    def column(self, column: int, columns: int) -> int:
        """The column, round the turn at most once; -1 outside."""
        if self.wraps and column < 0:
            column += columns
        elif self.wraps and column >= columns:
            column -= columns
        return column if 0 <= column < columns else -1

    def offset(self, right: int, columns: int) -> int:
        """The shorter way between columns."""
        if self.wraps and 2 * right > columns:
            return right - columns
        if self.wraps and 2 * right < -columns:
            return right + columns
        return right


def present(depth: np.ndarray, state: np.ndarray) -> np.ndarray:
    """Pixels that hold a depth and were not erased."""
    with np.errstate(invalid="ignore"):
        return (depth > 0) & (depth < f32(3e38)) & (state != ERASED)


def spacing_of(depth: np.ndarray, state: np.ndarray, grid: Grid) -> np.ndarray:
    """Own-layer spacing S of every pixel [px]; 0 = empty, 33 = none up to 32 px."""
    rows, columns = depth.shape
    there = present(depth, state)
    spacing = np.zeros(depth.shape, int)
    for row, column in np.argwhere(there):
        own = depth[row, column]
        found, r = 0, 0
        while found < COMPANIONS and r < FARTHEST_RING:
            r += 1
            within = f32(0.03) + f32(1.0) * grid.pitch(own) * f32(r)
            for y in range(-r, r + 1):
                for x in range(-r, r + 1):
                    c = grid.column(column + x, columns)
                    if max(abs(x), abs(y)) < r or not 0 <= row + y < rows or c < 0:
                        continue
                    if there[row + y, c] and abs(depth[row + y, c] - own) <= within:
                        found += 1
        spacing[row, column] = r if found >= COMPANIONS else NO_RING
    return spacing


def limit_of(spacing: np.ndarray) -> int:
    """Spacing above which a pixel is isolated: 8 times the median, from 16 to 32 px."""
    drawn = np.sort(spacing[spacing > 0])
    median = int(drawn[(len(drawn) - 1) // 2]) if len(drawn) else 0
    return min(max(8 * median, 16), FARTHEST_RING)


def pyramid_of(depth: np.ndarray, spacing: np.ndarray) -> list[list[list[tuple | None]]]:
    """Of every area of 1, 2, 4, ... pixels a side the nearest (depth, S, row, column), or None."""
    rows, columns = depth.shape
    known = (spacing > 0) & (spacing <= limit_of(spacing))
    levels = []
    for level in range(LEVELS):
        side = 1 << level
        cells = []
        for top in range(0, rows, side):
            line = []
            for left in range(0, columns, side):
                area = [
                    (depth[row, column], int(spacing[row, column]), row, column)
                    for row in range(top, min(top + side, rows))
                    for column in range(left, min(left + side, columns))
                    if known[row, column]
                ]
                line.append(min(area) if area else None)
            cells.append(line)
        levels.append(cells)
    return levels


def sector(right: float, down: float) -> int:
    """Sector of 32 that a direction lies in; 0 begins to the right, then downwards."""
    turns = (np.arctan2(down, right) / (2 * np.pi)) % 1.0
    return int(np.floor(turns * 32 + 1e-9)) % 32


def surrounded(sectors: set[int], most_empty: int) -> bool:
    """Whether no run of more empty sectors is left round the turn."""
    runs = range(most_empty + 1)
    return all(any((first + k) % 32 in sectors for k in runs) for first in range(32))
