"""Slow twin of the kernels that find the line: one row at a time, whole numbers and float64.

It follows the same equations in the same order, so that its results are the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthwarp.scanner.frames import Frame
from depthwarp.scanner.laser.line import derivative_filters
from tests.scanner.laser.reference_signal import mirror, own_signal

UNIT = 32
BLUR = (1, 4, 6, 4, 1)
BLURRED_UNIT = 32 * 16
FULL_WIDTH = 5.545177444479562


@dataclass(frozen=True)
class Found:
    """What one row holds: as the kernel writes it."""

    column: float
    sigma: np.float32
    height: np.float32
    width: np.float32
    is_saturated: bool
    is_rival: bool
    is_narrow: bool


class RowFinder:
    """Finds the line in rows of one frame, by a mask of pixels or of cells.

    Args:
        on, off: Frames; off None for a single frame.
        mask: Shape (H, W), or (H // 2, W // 2) for a mosaic.
        channel: 0 blue, 1 green, 2 red.
        suppression: In units of 1 / 32 of each other channel.
        variances: Read noise squared, growth with the level; in numbers of the frame.
        min_snr, max_width: As of the finder.
    """

    def __init__(
        self,
        on: Frame,
        off: Frame | None,
        mask: npt.NDArray[np.bool_],
        channel: int,
        suppression: int,
        variances: tuple[float, float],
        min_snr: float = 4.0,
        max_width: float = 30.0,
    ) -> None:
        self.height, self.width = on.pixels.shape[:2]
        self.mask = np.repeat(mask, 2, axis=0) if on.pixel_format.is_bayer else mask
        self.cell = 2 if on.pixel_format.is_bayer else 1
        self.suppression = suppression if off is None and not on.pixel_format.is_bayer else 0
        self.is_paired = off is not None
        self.on, self.off, self.channel = on, off, channel
        self.full = UNIT * (2**on.bits - 1)
        self.read, self.shot = variances
        self.min_snr, self.max_width = min_snr, max_width
        self._look_along(1)
        self.others = np.zeros_like(self.own)
        if not on.pixel_format.is_bayer:
            numbers = on.pixels.astype(np.int64)
            self.others = numbers.sum(axis=2) - numbers[..., channel]
        self.is_coarse = on.pixel_format.is_bayer and channel != 1
        self.weights, self.limits = derivative_filters()

    def find_all(self) -> dict[int, Found]:
        """The line's crossing of each row that has one; a leaning line is looked for twice."""
        self._look_along(1)
        found = self._found_in(range(self.height))
        if self.on.pixel_format.is_bayer and self.channel == 1:
            reaches = {row: self._reach(found, row) for row in found}
            for reach in sorted(set(reaches.values()) - {1, -1}):
                self._look_along(reach)
                rows = [row for row in reaches if reaches[row] == reach]
                again = self._found_in(rows)
                found = {k: v for k, v in found.items() if k not in rows} | again
        return dict(sorted(found.items()))

    def _found_in(self, rows: Iterable[int]) -> dict[int, Found]:
        return {row: f for row in rows if isinstance(f := self.find(row), Found)}

    def _reach(self, found: dict[int, Found], row: int) -> int:
        """How many rows away the next green sites along the line are; negative: to the left."""
        if row - 4 not in found or row + 4 not in found:
            return 1
        here = found[row].column
        slopes = [
            (found[row - 4].column - here) / -4.0,
            (found[row + 4].column - here) / 4.0,
        ]
        if max(abs(slope) for slope in slopes) > 1.5:
            return 1
        slope = (slopes[0] + slopes[1]) * 0.5
        rows = 3 if abs(slope) > 0.6 else 2 if abs(slope) > 1 / 3 else 1
        rows = max(min(rows, row, self.height - 1 - row), 1)
        return -rows if slope < 0.0 else rows

    def _look_along(self, reach: int) -> None:
        """Fill in what a green mosaic leaves out from sites so many rows away along the line."""
        self.own, self.share = own_signal(self.on, self.channel, reach)
        self.dark = np.zeros_like(self.own)
        if self.off is not None:
            self.dark = own_signal(self.off, self.channel, reach)[0]

    def find(self, row: int) -> Found | str:
        """The line's crossing of a row, or why there is none."""
        if self.mask.shape[0] <= row:  # the odd last row of a mosaic has the cells above
            row_mask = self.mask[-1]
        else:
            row_mask = self.mask[row]
        peaks = []
        reasons = ["empty"]
        for first, last in _runs(row_mask, 8 // self.cell):
            first_pixel = max(first * self.cell - 1, 0)
            last_pixel = min((last + 1) * self.cell, self.width - 1)
            peak = _Peak(self, row, first_pixel, last_pixel)
            reasons.append(peak.state)
            if peak.state == "found":
                peaks.append(peak)
        if not peaks:
            return max(reasons, key=["empty", "weak", "wide", "cut"].index)
        best = max(peaks, key=lambda peak: peak.height)  # the first of equals
        heights = sorted((peak.height for peak in peaks), reverse=True)
        position = best.position()
        if position is None:
            return "weak"
        column, sigma, is_narrow = position
        systematic = 1e-4
        if best.is_saturated:
            shift = 0.054 / max(best.flanks(), 2 / 3)
            systematic = 1e-4 + shift * shift
        if self.is_coarse and best.deviation < 1.5:
            systematic = 0.11
        return Found(
            column,
            np.float32(math.sqrt(sigma * sigma + systematic)),
            np.float32(best.height / BLURRED_UNIT),
            np.float32(best.deviation * math.sqrt(FULL_WIDTH)),
            best.is_saturated,
            len(heights) > 1 and heights[1] >= 0.5 * heights[0],
            is_narrow,
        )


class _Peak:
    """The highest peak of one run of the mask."""

    def __init__(self, finder: RowFinder, row: int, first: int, last: int) -> None:
        self.f, self.row = finder, row
        columns = range(first, last + 1)
        self.is_saturated = any(self.own(c) >= finder.full for c in columns)
        self.suppression = 0 if self.is_saturated else finder.suppression
        self.column = max(columns, key=self.blurred)
        highest = self.blurred(self.column)
        left = [self.blurred(c) for c in range(max(first - 6, 0), self.column)]
        right = [self.blurred(c) for c in range(self.column + 1, min(last + 7, finder.width))]
        self.base = max(min([highest, *left]), min([highest, *right]))
        self.height = highest - self.base
        self.state = self._measure()

    def own(self, column: int) -> int:
        return int(self.f.own[self.row, mirror(column, self.f.width)])

    def dark(self, column: int) -> int:
        return int(self.f.dark[self.row, mirror(column, self.f.width)])

    def signal(self, column: int) -> int:
        at = mirror(column, self.f.width)
        others = self.suppression * int(self.f.others[self.row, at])
        return self.own(column) - self.dark(column) - others

    def blurred(self, column: int) -> int:
        return sum(b * self.signal(column + k - 2) for k, b in enumerate(BLUR))

    def _measure(self) -> str:
        f = self.f
        level = max(self.base, 0) / BLURRED_UNIT
        if f.is_paired:
            level = max(self.dark(self.column), 0) / UNIT
        variance = (f.read + f.shot * level) * (2 if f.is_paired else 1)
        noise = math.sqrt(0.2734375 * variance)
        if self.height <= 0 or self.height < f.min_snr * noise * BLURRED_UNIT:
            return "weak"
        before, behind = self._half(-1), self._half(1)
        width = before + behind
        self.left, self.right = self.column - before, self.column + behind
        variance = width_squared(self.left, self.right) / FULL_WIDTH - 1.0
        self.deviation = math.sqrt(max(variance, 0.0))
        if width > f.max_width:
            return "wide"
        if self.left < 0.75 * width or self.right > (f.width - 1) - 0.75 * width:
            return "cut"
        return "found"

    def _half(self, step: int) -> float:
        half = 2 * self.base + self.height
        limit = int(self.f.max_width) + 1
        inside = 2 * (self.base + self.height)
        for n in range(1, limit):
            outside = 2 * self.blurred(self.column + n * step)
            if outside <= half:
                return (n - 1) + (inside - half) / (inside - outside)
            inside = outside
        return float(limit)

    def flanks(self) -> float:
        """Area of what is not saturated, over the height of what is."""
        width = self.right - self.left
        area, highest = 0, 1
        for column in range(int(self.left - width), int(self.right + width) + 1):
            above = sum(BLUR) * self.signal(column) - self.base
            if self.own(column) < self.f.full:
                area += above
            else:
                highest = max(highest, above)
        return area / highest

    def position(self) -> tuple[float, float, bool] | None:
        """Column, its sigma from noise, and whether three pixels gave it."""
        if self.deviation < 0.8 and not self.f.is_coarse:
            apex = self._apex()
            if apex is not None:
                return *apex, True
        crossing = self._crossing()
        return None if crossing is None else (*crossing, False)

    def _crossing(self) -> tuple[float, float] | None:
        scale = min(int(np.searchsorted(self.f.limits, self.deviation)), len(self.f.limits) - 1)
        reach, *tail = self.f.weights[scale].tolist()
        taps = list(enumerate(tail[:reach], start=1))

        def slope(c: int) -> int:
            return sum(w * (self.signal(c + k) - self.signal(c - k)) for k, w in taps)

        middle = math.floor(0.5 * (self.left + self.right) + 0.5)
        steps = int(0.5 * (self.right - self.left)) + 2
        step = 1 if slope(middle) > 0 else -1
        for _ in range(steps):
            if (slope(middle) > 0) == (slope(middle + step) > 0):
                middle += step
        if (slope(middle) > 0) == (slope(middle + step) > 0):
            return None
        if step < 0:
            middle -= 1
        d0, d1, d2, d3 = (float(slope(middle + k)) for k in (-1, 0, 1, 2))
        c1 = (d2 - d1 * 0.5) - (d0 * 2.0 + d3) / 6.0
        c2 = (d0 + d2) * 0.5 - d1
        c3 = (d3 - d0) / 6.0 + (d1 - d2) * 0.5
        t = d1 / (d1 - d2)
        for _ in range(4):
            value = ((c3 * t + c2) * t + c1) * t + d1
            steepness = (3.0 * c3 * t + 2.0 * c2) * t + c1
            if steepness < 0.0:
                t = min(max(t - value / steepness, 0.0), 1.0)
        steepness = min((3.0 * c3 * t + 2.0 * c2) * t + c1, d2 - d1)
        nearest = middle + int(t + 0.5)
        variance = 0.0
        for k, w in taps:
            sides = self._variance(nearest - k) + self._variance(nearest + k)
            variance += float(w) * float(w) * sides
        return middle + t, math.sqrt(variance * 32.0 * 32.0) / -steepness

    def _apex(self) -> tuple[float, float] | None:
        column = max(
            (self.column, self.column - 1, self.column + 1), key=self.signal
        )  # the first of equals
        base = self.base * 32.0 / BLURRED_UNIT
        left, center, right = ((self.signal(column + k) - base) / 32.0 for k in (-1, 0, 1))
        if left <= 0.0 or right <= 0.0:
            return None
        d = natural_log(left / center) + natural_log(right / center)
        if d >= 0.0:
            return None
        t = 0.5 * natural_log(left / right) / d
        shares = ((0.5 - t) / (d * left), 2.0 * t / (d * center), (0.5 + t) / (d * right))
        variance = 0.0
        for k, share in zip((-1, 0, 1), shares, strict=True):
            variance += share * share * self._variance(column + k)
        return column + t, math.sqrt(variance)

    def _variance(self, column: int) -> float:
        f = self.f
        if self.own(column) >= f.full:
            return 0.0
        variance = f.read + f.shot * (max(self.own(column), 0) / 32.0)
        if f.is_paired:
            variance += f.read + f.shot * (max(self.dark(column), 0) / 32.0)
        share = self.suppression / 32.0
        blend = 1.0 + 2.0 * share * share
        return variance * (float(f.share[self.row, mirror(column, f.width)]) * blend)


def width_squared(left: float, right: float) -> float:
    """The square of a width, from where it begins and ends."""
    return (right - left) * (right - left)


def natural_log(x: float) -> float:
    """The kernel's own logarithm."""
    exponent, m = 0, x
    while m > 1.4142135623730951:
        m, exponent = m * 0.5, exponent + 1
    while m < 0.7071067811865476:
        m, exponent = m * 2.0, exponent - 1
    z = (m - 1.0) / (m + 1.0)
    total = 0.0
    for n in range(10):
        total = total * (z * z) + 1.0 / (19 - 2 * n)
    return 2.0 * z * total + exponent * 0.6931471805599453


def _runs(mask: npt.NDArray[np.bool_], gap: int) -> list[tuple[int, int]]:
    """Runs of set cells, joined where at most `gap` cells lie between."""
    runs: list[tuple[int, int]] = []
    for cell in np.flatnonzero(mask).tolist():
        if runs and cell - runs[-1][1] <= gap + 1:
            runs[-1] = (runs[-1][0], cell)
        else:
            runs.append((cell, cell))
    return runs
