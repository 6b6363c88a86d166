"""The position of a peak along a row, to a fraction of a pixel, with its standard deviation.

The derivative of a Gaussian as wide as the line, correlated with the signal, crosses zero there
(Canny 1986; the FIR filter of Forest, Salvi, Cabruja, Pous 2004). For a line narrower than a pixel
it is the apex of a Gaussian through three pixels.
"""

from typing import Any

import warp as wp

from depthwarp_kernels.laser_peak import BLURRED_UNIT, Peak
from depthwarp_kernels.laser_signal import UNIT, SignalLayout, signal_at, variance_at


# Derivative filters: `weights[scale, k]` is the weight at distance k from the middle,
# `weights[scale, 0]` the reach; `limits` are the widest lines that each is for [px, standard
# deviation].
@wp.struct
class Filters:
    weights: wp.array2d[wp.int32]
    limits: wp.array[wp.float64]


@wp.func
def slope_at(
    on: wp.array[Any],
    off: wp.array[Any],
    s: SignalLayout,
    filters: Filters,
    scale: wp.int32,
    row: wp.int32,
    column: wp.int32,
):
    """The derivative filter of a scale at a pixel: positive where the signal rises."""
    total = wp.int64(0)
    for k in range(1, filters.weights[scale, 0] + 1):
        rise = signal_at(on, off, s, row, column + k) - signal_at(on, off, s, row, column - k)
        total += wp.int64(filters.weights[scale, k]) * wp.int64(rise)
    return total


@wp.func
def slope_variance(
    on: wp.array[Any],
    off: wp.array[Any],
    s: SignalLayout,
    filters: Filters,
    scale: wp.int32,
    row: wp.int32,
    column: wp.int32,
):
    """Noise variance of the derivative filter at a pixel, in its own units."""
    total = wp.float64(0.0)
    for k in range(1, filters.weights[scale, 0] + 1):
        weight = wp.float64(filters.weights[scale, k])
        sides = variance_at(on, off, s, row, column - k)
        sides += variance_at(on, off, s, row, column + k)
        total += weight * weight * sides
    return total * UNIT * UNIT


# The zero lies between two pixels; the cubic through four pixels is solved by Newton's steps from
# the chord. First-order propagation of the noise: sigma = deviation of the filter's output there
# over the steepness of its crossing.
@wp.func
def zero_crossing(
    on: wp.array[Any],
    off: wp.array[Any],
    s: SignalLayout,
    filters: Filters,
    scale: wp.int32,
    row: wp.int32,
    peak: Peak,
):
    """Where the derivative filter crosses zero, falling, next to the middle of a peak."""
    middle = wp.float64(0.5) * (peak.left + peak.right)
    column = wp.int32(wp.floor(middle + wp.float64(0.5)))
    reach = wp.int32(wp.float64(0.5) * (peak.right - peak.left)) + 2
    here = slope_at(on, off, s, filters, scale, row, column)
    step = int(1)
    if here <= wp.int64(0):
        step = -1
    there = slope_at(on, off, s, filters, scale, row, column + step)
    for _n in range(reach):
        if (here > wp.int64(0)) == (there > wp.int64(0)):
            column += step
            here = there
            there = slope_at(on, off, s, filters, scale, row, column + step)
    if (here > wp.int64(0)) == (there > wp.int64(0)):
        return wp.vec2d(wp.float64(0.0), wp.float64(-1.0))
    d1 = wp.float64(here)
    d2 = wp.float64(there)
    if step < 0:
        column -= 1
        d1 = wp.float64(there)
        d2 = wp.float64(here)
    d0 = wp.float64(slope_at(on, off, s, filters, scale, row, column - 1))
    d3 = wp.float64(slope_at(on, off, s, filters, scale, row, column + 2))
    c1 = (d2 - d1 * wp.float64(0.5)) - (d0 * wp.float64(2.0) + d3) / wp.float64(6.0)
    c2 = (d0 + d2) * wp.float64(0.5) - d1
    c3 = (d3 - d0) / wp.float64(6.0) + (d1 - d2) * wp.float64(0.5)
    t = d1 / (d1 - d2)
    for _n in range(4):
        value = ((c3 * t + c2) * t + c1) * t + d1
        steepness = (wp.float64(3.0) * c3 * t + wp.float64(2.0) * c2) * t + c1
        if steepness < wp.float64(0.0):
            t = wp.clamp(t - value / steepness, wp.float64(0.0), wp.float64(1.0))
    steepness = wp.min((wp.float64(3.0) * c3 * t + wp.float64(2.0) * c2) * t + c1, d2 - d1)
    nearest = column + wp.int32(t + wp.float64(0.5))
    variance = slope_variance(on, off, s, filters, scale, row, nearest)
    sigma = wp.sqrt(variance) / -steepness
    return wp.vec2d(wp.float64(column) + t, sigma)


# log by its own series, because libraries round it differently: x = m 2^n with m from 1/sqrt(2) to
# sqrt(2), log m = 2 artanh((m - 1) / (m + 1)); 10 terms leave less than 1e-15.
@wp.func
def natural_log(x: wp.float64):
    """Natural logarithm of a positive number from +, -, *, / alone."""
    exponent = int(0)
    m = wp.float64(x)
    while m > wp.float64(1.4142135623730951):
        m = m * wp.float64(0.5)
        exponent += 1
    while m < wp.float64(0.7071067811865476):
        m = m * wp.float64(2.0)
        exponent -= 1
    z = (m - wp.float64(1.0)) / (m + wp.float64(1.0))
    square = z * z
    total = wp.float64(0.0)
    for n in range(10):
        total = total * square + wp.float64(1.0) / wp.float64(19 - 2 * n)
    return wp.float64(2.0) * z * total + wp.float64(exponent) * wp.float64(0.6931471805599453)


# A Gaussian's logarithm is a parabola: with l, c, r the logarithms at three pixels, the apex is at
# n / d, n = (l - r) / 2, d = l - 2 c + r. First-order propagation of the noise of the three.
@wp.func
def gauss_apex(on: wp.array[Any], off: wp.array[Any], s: SignalLayout, row: wp.int32, peak: Peak):
    """The apex of a Gaussian through the highest pixel near a peak and its two neighbours."""
    column = int(peak.column)
    for candidate in range(peak.column - 1, peak.column + 2):
        if signal_at(on, off, s, row, candidate) > signal_at(on, off, s, row, column):
            column = candidate
    base = wp.float64(peak.base) * UNIT / BLURRED_UNIT
    left = (wp.float64(signal_at(on, off, s, row, column - 1)) - base) / UNIT
    center = (wp.float64(signal_at(on, off, s, row, column)) - base) / UNIT
    right = (wp.float64(signal_at(on, off, s, row, column + 1)) - base) / UNIT
    if left <= wp.float64(0.0) or right <= wp.float64(0.0):
        return wp.vec2d(wp.float64(0.0), wp.float64(-1.0))
    d = natural_log(left / center) + natural_log(right / center)
    if d >= wp.float64(0.0):
        return wp.vec2d(wp.float64(0.0), wp.float64(-1.0))
    t = wp.float64(0.5) * natural_log(left / right) / d
    by_left = (wp.float64(0.5) - t) / (d * left)
    by_center = wp.float64(2.0) * t / (d * center)
    by_right = (wp.float64(0.5) + t) / (d * right)
    variance = by_left * by_left * variance_at(on, off, s, row, column - 1)
    variance += by_center * by_center * variance_at(on, off, s, row, column)
    variance += by_right * by_right * variance_at(on, off, s, row, column + 1)
    return wp.vec2d(wp.float64(column) + t, wp.sqrt(variance))


@wp.func
def position_of(
    on: wp.array[Any],
    off: wp.array[Any],
    s: SignalLayout,
    filters: Filters,
    scale: wp.int32,
    row: wp.int32,
    peak: Peak,
    is_narrow: bool,
):
    """Column of a peak, its sigma (negative: none), and 1 where three pixels gave it."""
    if is_narrow:
        apex = gauss_apex(on, off, s, row, peak)
        if apex[1] >= wp.float64(0.0):
            return wp.vec3d(apex[0], apex[1], wp.float64(1.0))
    crossing = zero_crossing(on, off, s, filters, scale, row, peak)
    return wp.vec3d(crossing[0], crossing[1], wp.float64(0.0))
