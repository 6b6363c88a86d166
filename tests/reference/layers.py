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


def spacing_of(depth: np.ndarray, state: np.ndarray, grid: Grid) -> tuple[np.ndarray, np.ndarray]:
    """Own-layer spacing S of every pixel [px]; 0 = empty, 33 = none up to 32 px. And whether the
    four companions lie along a line."""
    there = present(depth, state)
    spacing, lines = np.zeros(depth.shape, int), np.zeros(depth.shape, bool)
    for row, column in np.argwhere(there):
        spacing[row, column] = NO_RING
        for reach in (2, 8, FARTHEST_RING):
            four = _companions(depth, there, grid, row, column, reach)
            if len(four) == COMPANIONS:
                spacing[row, column] = four[-1][0]
                lines[row, column] = _lie_along_line(four)
                break
    return spacing, lines


def _companions(depth, there, grid, row, column, reach):
    """The four nearest companions, as (ring, right, down): rows from the pixel's own outwards, of
    each the pixels in nearer rings than that of the fourth so far."""
    rows, columns = depth.shape
    own = depth[row, column]
    four: list[tuple[int, int, int]] = []
    for k in range(2 * reach + 1):
        away = (k + 1) // 2
        down = -away if k % 2 else away
        if not 0 <= row + down < rows:
            continue
        most = four[-1][0] - 1 if len(four) == COMPANIONS else reach
        for turn in (-1, 0, 1) if grid.wraps else (0,):
            for right in range(-most, most + 1):
                c = column + right + turn * columns
                ring = max(abs(right), away)
                if not 0 <= c < columns or ring == 0 or not there[row + down, c]:
                    continue
                within = f32(0.03) + f32(1.0) * grid.pitch(own) * f32(ring)
                if away <= most and abs(depth[row + down, c] - own) <= within:
                    four = sorted([*four, (ring, right, down)])[:COMPANIONS]
    return four


def _lie_along_line(four) -> bool:
    """Whether directions, their angles taken twice, add up to 3.4 of 4 or more."""
    cosines, sines = f32(0), f32(0)
    for _, right, down in four:
        x, y = f32(right), f32(down)
        share = f32(1) / (x * x + y * y)
        cosines = cosines + (x * x - y * y) * share
        sines = sines + f32(2) * x * y * share
    return bool(cosines * cosines + sines * sines > f32(11.56))


def limit_of(spacing: np.ndarray) -> int:
    """Spacing above which a pixel is isolated: 8 times the median, from 16 to 32 px."""
    drawn = np.sort(spacing[spacing > 0])
    median = int(drawn[(len(drawn) - 1) // 2]) if len(drawn) else 0
    return min(max(8 * median, 16), FARTHEST_RING)


def pyramid_of(
    depth: np.ndarray, spacing: np.ndarray, lines: np.ndarray
) -> list[list[list[tuple | None]]]:
    """Of every area of 1, 2, 4, ... pixels a side the nearest (depth, S, row, column), or None; of
    equal depths first those not along a line, then those of the smaller S."""
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
                    (depth[row, column], lines[row, column], int(spacing[row, column]), row, column)
                    for row in range(top, min(top + side, rows))
                    for column in range(left, min(left + side, columns))
                    if known[row, column]
                ]
                nearest = min(area) if area else None
                line.append(nearest and (nearest[0], *nearest[2:]))
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
