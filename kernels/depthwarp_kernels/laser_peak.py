"""Peaks of the blurred signal along a row: height over the background, and width at half height."""

from typing import Any

import warp as wp

from depthwarp_kernels.laser_signal import SIGNAL_UNIT, UNIT, SignalLayout, own_at, signal_at

# What became of a peak, or of a row: why it holds no point, the later reason winning.
ROW_EMPTY = wp.constant(0)
ROW_WEAK = wp.constant(1)
ROW_WIDE = wp.constant(2)
ROW_CUT = wp.constant(3)
ROW_FOUND = wp.constant(4)

BLUR_UNIT = 16  # sum of the blur 1 4 6 4 1
BLURRED_UNIT = wp.constant(wp.float64(SIGNAL_UNIT * BLUR_UNIT))
BLUR_VARIANCE = 1.0  # px^2
EIGHT_LOG_2 = 5.545177444479562  # (width at half height / standard deviation)^2 of a Gaussian
BLUR_NOISE = 0.2734375  # sum of its squared weights, each over the sum
EDGE_MARGIN = wp.constant(wp.float64(0.75))  # widths that the derivative filter sees beside a line
PAD = 6  # pixels beside a run of the mask in which the background is looked for


# A peak of the blurred signal: its column, its height over the background and the background
# (in SIGNAL_UNIT * BLUR_UNIT), where it crosses half height, and what became of it.
@wp.struct
class Peak:
    column: wp.int32
    height: wp.int32
    base: wp.int32
    left: wp.float64
    right: wp.float64
    state: wp.int32


@wp.func
def blurred_at(
    on: wp.array[Any], off: wp.array[Any], s: SignalLayout, row: wp.int32, column: wp.int32
):
    """The signal under the blur 1 4 6 4 1."""
    outer = signal_at(on, off, s, row, column - 2) + signal_at(on, off, s, row, column + 2)
    inner = signal_at(on, off, s, row, column - 1) + signal_at(on, off, s, row, column + 1)
    return outer + 4 * inner + 6 * signal_at(on, off, s, row, column)


# The steps of the walk are bounded by the greatest width, whatever the frame holds.
@wp.func
def half_crossing(
    on: wp.array[Any],
    off: wp.array[Any],
    s: SignalLayout,
    row: wp.int32,
    peak: Peak,
    step: wp.int32,
    limit: wp.int32,
):
    """Distance from a peak to half its height, going by `step`; `limit` if that is not nearer."""
    half = 2 * peak.base + peak.height
    inside = int(2 * (peak.base + peak.height))
    for n in range(1, limit):
        outside = 2 * blurred_at(on, off, s, row, peak.column + n * step)
        if outside <= half:
            part = wp.float64(inside - half) / wp.float64(inside - outside)
            return wp.float64(n - 1) + part
        inside = outside
    return wp.float64(limit)


@wp.func
def background_variance(off: wp.array[Any], s: SignalLayout, row: wp.int32, peak: Peak):
    """Noise variance of the signal at a peak if the line were not there."""
    level = wp.float64(wp.max(peak.base, 0)) / BLURRED_UNIT
    if s.is_paired != 0:
        level = wp.float64(wp.max(own_at(off, s, row, peak.column), 0)) / UNIT
    variance = s.read_variance + s.shot_variance * level
    if s.is_paired != 0:
        variance += variance
    return variance


@wp.func
def measure_peak(
    on: wp.array[Any],
    off: wp.array[Any],
    s: SignalLayout,
    min_snr: wp.float64,
    max_width: wp.float64,
    row: wp.int32,
    first: wp.int32,
    last: wp.int32,
):
    """The highest blurred peak from column `first` to `last`, its background and its width."""
    peak = Peak()
    peak.column = first
    highest = int(blurred_at(on, off, s, row, first))
    for column in range(first + 1, last + 1):
        value = blurred_at(on, off, s, row, column)
        if value > highest:
            highest = value
            peak.column = column
    left = int(highest)
    for column in range(wp.max(first - PAD, 0), peak.column):
        left = wp.min(left, blurred_at(on, off, s, row, column))
    right = int(highest)
    for column in range(peak.column + 1, wp.min(last + PAD + 1, s.width)):
        right = wp.min(right, blurred_at(on, off, s, row, column))
    peak.base = wp.max(left, right)
    peak.height = highest - peak.base

    noise = wp.sqrt(wp.float64(BLUR_NOISE) * background_variance(off, s, row, peak))
    if peak.height <= 0 or wp.float64(peak.height) < min_snr * noise * BLURRED_UNIT:
        peak.state = ROW_WEAK
        return peak
    limit = wp.int32(max_width) + 1
    before = half_crossing(on, off, s, row, peak, -1, limit)
    behind = half_crossing(on, off, s, row, peak, 1, limit)
    width = before + behind
    peak.left = wp.float64(peak.column) - before
    peak.right = wp.float64(peak.column) + behind
    peak.state = ROW_FOUND
    if width > max_width:
        peak.state = ROW_WIDE
    elif peak.left < EDGE_MARGIN * width:
        peak.state = ROW_CUT
    elif peak.right > wp.float64(s.width - 1) - EDGE_MARGIN * width:
        peak.state = ROW_CUT
    return peak


@wp.func
def line_deviation(peak: Peak):
    """Standard deviation of a Gaussian as wide as a peak was before the blur [px]."""
    width = peak.right - peak.left
    variance = width * width / wp.float64(EIGHT_LOG_2) - wp.float64(BLUR_VARIANCE)
    return wp.sqrt(wp.max(variance, wp.float64(0.0)))
