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


@dataclass(frozen=True)
class Spacing:
    """Of every pixel: own-layer spacing [px] (0 = empty, 33 = none up to 32 px), extent [px], and
    whether it is of a line; each of shape (H, W).
    """

    own: np.ndarray
    extent: np.ndarray
    line: np.ndarray


def spacing_of(depth: np.ndarray, state: np.ndarray, grid: Grid) -> Spacing:
    """What the companions of every pixel say of it."""
    there = present(depth, state)
    own, extent = np.zeros(depth.shape, int), np.zeros(depth.shape, f32)
    line = np.zeros(depth.shape, bool)
    for row, column in np.argwhere(there):
        four = companions(depth, there, grid, row, column)
        own[row, column] = extent[row, column] = four[-1][0] if len(four) == 4 else NO_RING
        direction = _line_through(four) if len(four) == 4 else None
        if direction is not None:
            across = _ring_across(depth, there, grid, row, column, direction)
            half = f32(0.5) * extent[row, column]
            line[row, column] = across is None
            extent[row, column] = half if across is None else f32(across)
    return Spacing(own, extent, line)


def companions(depth, there, grid, row, column, farthest=FARTHEST_RING):
    """The four nearest companions of a pixel, or fewer, as (ring, right, down): of one ring first
    those found first, rows from the pixel's own outwards, the upper before the lower.
    """
    for reach in (2, 8, FARTHEST_RING):
        reach = min(reach, farthest)
        four: list[tuple[int, int, int]] = []
        most, last = reach, 0
        for right, down in _around(depth, there, grid, row, column, reach):
            if down != last:  # of each row what is nearer than the fourth so far
                most = four[-1][0] - 1 if len(four) == COMPANIONS else reach
                last = down
            ring = max(abs(right), abs(down))
            if ring <= most:
                four = sorted([*four, (ring, right, down)])[:COMPANIONS]
        if len(four) == COMPANIONS or reach == farthest:
            return four
    return []


def _around(depth, there, grid, row, column, reach):
    """What is of the pixel's layer up to a ring, row by row, as (right, down)."""
    own = depth[row, column]
    for right, down in square_round(there, grid, row, column, reach):
        within = f32(0.025) + f32(1.0) * grid.pitch(own) * f32(max(abs(right), abs(down)))
        if abs(depth[row + down, (column + right) % depth.shape[1]] - own) <= within:
            yield right, down


def square_round(there, grid, row, column, reach):
    """Other pixels up to a ring, as (right, down): rows from the pixel's own outwards."""
    rows, columns = there.shape
    for k in range(2 * reach + 1):
        away = (k + 1) // 2
        down = -away if k % 2 else away
        if not 0 <= row + down < rows:
            continue
        for turn in (-1, 0, 1) if grid.wraps else (0,):
            for right in range(-reach, reach + 1):
                c = column + right + turn * columns
                if 0 <= c < columns and (right or down) and there[row + down, c]:
                    yield right, down


def _line_through(four):
    """Direction of the line that four companions lie along, or None: those to them, their angles
    taken twice, add up to 3.2 of 4 or more.
    """
    cosines, sines = f32(0), f32(0)
    for _, right, down in four:
        x, y = f32(right), f32(down)
        share = f32(1) / (x * x + y * y)
        cosines = cosines + (x * x - y * y) * share
        sines = sines + f32(2) * x * y * share
    square = cosines * cosines + sines * sines
    if square <= f32(10.24):
        return None
    half = f32(0.5) * cosines / np.sqrt(square)
    x, y = np.sqrt(max(f32(0.5) + half, f32(0))), np.sqrt(max(f32(0.5) - half, f32(0)))
    return x, -y if sines < 0 else y


def _ring_across(depth, there, grid, row, column, line):
    """Up to 12 px, the ring in which both sides of a line have a companion, over 30 degrees off."""
    nearest: dict[bool, int] = {}
    for right, down in _around(depth, there, grid, row, column, 12):
        across = line[0] * f32(down) - line[1] * f32(right)
        if f32(4) * across * across > f32(right * right + down * down):
            ring = max(abs(right), abs(down))
            nearest[across > 0] = min(nearest.get(across > 0, ring), ring)
    return max(nearest.values()) if len(nearest) == 2 else None


def limit_of(spacing: np.ndarray) -> int:
    """Spacing above which a pixel is isolated: 8 times the median, from 16 to 32 px."""
    drawn = np.sort(spacing[spacing > 0])
    median = int(drawn[(len(drawn) - 1) // 2]) if len(drawn) else 0
    return min(max(8 * median, 16), FARTHEST_RING)


def pyramid_of(depth: np.ndarray, spacing: Spacing) -> list[list[list[tuple | None]]]:
    """Of every area of 1, 2, 4, ... pixels a side the nearest (depth, row, column), or None; of
    equal depths that of the least extent, then those of no line, then the least spacing.
    """
    rows, columns = depth.shape
    known = (spacing.own > 0) & (spacing.own <= limit_of(spacing.own))
    maps = depth, spacing.extent, spacing.line, spacing.own
    levels = []
    for level in range(LEVELS):
        side = 1 << level
        cells = []
        for top in range(0, rows, side):
            line = []
            for left in range(0, columns, side):
                area = [
                    (*(values[row, column] for values in maps), row, column)
                    for row in range(top, min(top + side, rows))
                    for column in range(left, min(left + side, columns))
                    if known[row, column]
                ]
                nearest = min(area) if area else None
                line.append(nearest and (nearest[0], *nearest[-2:]))
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
