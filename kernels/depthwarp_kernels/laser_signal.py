"""The signal of a laser line along the rows of a frame, and the variance of its noise.

Signals are whole numbers, `SIGNAL_UNIT` times the numbers of the frame, so that all devices agree.
"""

from typing import Any

import warp as wp

SIGNAL_UNIT = 32
UNIT = wp.constant(wp.float64(SIGNAL_UNIT))

# Where the laser's own channel is.
BGR = wp.constant(0)
MOSAIC_GREEN = wp.constant(1)
MOSAIC_RED_OR_BLUE = wp.constant(2)


# A frame lies flat, `row_step` numbers a row. `own` is the laser's channel of BGR, of whose others
# `suppression` / 32 each is taken away; for a mosaic `row_phase` and `column_phase` are the
# parities of a site of the channel. What a mosaic leaves out of green comes from the sites `reach`
# rows above and below, `lean` columns to the left and right. `full` is full scale. The variance of
# a number v is read_variance + shot_variance * v.
@wp.struct
class SignalLayout:
    kind: wp.int32
    width: wp.int32
    height: wp.int32
    row_step: wp.int32
    own: wp.int32
    suppression: wp.int32
    row_phase: wp.int32
    column_phase: wp.int32
    reach: wp.int32
    lean: wp.int32
    is_paired: wp.int32
    full: wp.int32
    read_variance: wp.float64
    shot_variance: wp.float64


@wp.func
def mirror(i: wp.int32, count: wp.int32):
    """An index folded back into 0 to count - 1 about the outermost pixels: its parity stays."""
    if i < 0:
        i = -i
    if i >= count:
        i = 2 * (count - 1) - i
    return wp.clamp(i, 0, count - 1)


@wp.func
def row_of_sites(numbers: wp.array[Any], s: SignalLayout, row: wp.int32, column: wp.int32):
    """16 times the red or blue of a row of its sites; between two of them a cubic through four."""
    first = row * s.row_step
    if (column & 1) == s.column_phase:
        return 16 * wp.int32(numbers[first + column])
    near = wp.int32(numbers[first + mirror(column - 1, s.width)])
    near += wp.int32(numbers[first + mirror(column + 1, s.width)])
    far = wp.int32(numbers[first + mirror(column - 3, s.width)])
    far += wp.int32(numbers[first + mirror(column + 3, s.width)])
    return 9 * near - far


# What a mosaic leaves out comes from rows above and below, along the line: that shifts nothing
# along the row, also where the line is narrower than the mosaic's pitch.
@wp.func
def own_at(numbers: wp.array[Any], s: SignalLayout, row: wp.int32, column: wp.int32):
    """The laser's own channel at a pixel, in units of `SIGNAL_UNIT`; columns may lie outside."""
    column = mirror(column, s.width)
    if s.kind == BGR:
        return 32 * wp.int32(numbers[row * s.row_step + 3 * column + s.own])
    if s.kind == MOSAIC_GREEN:
        if ((row + column) & 1) == s.column_phase:
            return 32 * wp.int32(numbers[row * s.row_step + column])
        first = mirror(row - s.reach, s.height) * s.row_step
        sides = wp.int32(numbers[first + mirror(column - s.lean, s.width)])
        first = mirror(row + s.reach, s.height) * s.row_step
        return 16 * (sides + wp.int32(numbers[first + mirror(column + s.lean, s.width)]))
    above = mirror(row - 1, s.height)
    below = mirror(row + 1, s.height)
    if (row & 1) == s.row_phase:
        return 2 * row_of_sites(numbers, s, row, column)
    return row_of_sites(numbers, s, above, column) + row_of_sites(numbers, s, below, column)


@wp.func
def signal_at(
    on: wp.array[Any], off: wp.array[Any], s: SignalLayout, row: wp.int32, column: wp.int32
):
    """What the line adds: lit less off, or its channel less a share of the others."""
    signal = own_at(on, s, row, column)
    if s.is_paired != 0:
        signal -= own_at(off, s, row, column)
    elif s.suppression > 0:
        first = row * s.row_step + 3 * mirror(column, s.width)
        others = wp.int32(on[first]) + wp.int32(on[first + 1]) + wp.int32(on[first + 2])
        others -= wp.int32(on[first + s.own])
        signal -= s.suppression * others
    return signal


# Interpolated numbers weigh as what they are made of: means of two rows by half; a row in which
# every second number is interpolated carries half the information along the row.
@wp.func
def noise_share(s: SignalLayout, row: wp.int32, column: wp.int32):
    """Variance of a pixel's signal over that of a number of the frame."""
    if s.kind == BGR:
        if s.is_paired != 0:
            return wp.float64(1.0)
        share = wp.float64(s.suppression) / UNIT
        return wp.float64(1.0) + wp.float64(2.0) * share * share
    if s.kind == MOSAIC_GREEN:
        if ((row + column) & 1) == s.column_phase:
            return wp.float64(1.0)
        return wp.float64(0.5)
    if (row & 1) == s.row_phase:
        return wp.float64(2.0)
    return wp.float64(1.0)


@wp.func
def variance_at(
    on: wp.array[Any], off: wp.array[Any], s: SignalLayout, row: wp.int32, column: wp.int32
):
    """Noise variance of the signal at a pixel [numbers of the frame squared]; 0 if saturated."""
    level = own_at(on, s, row, column)
    if level >= SIGNAL_UNIT * s.full:
        return wp.float64(0.0)
    variance = s.read_variance + s.shot_variance * (wp.float64(wp.max(level, 0)) / UNIT)
    if s.is_paired != 0:
        dark = wp.float64(wp.max(own_at(off, s, row, column), 0)) / UNIT
        variance += s.read_variance + s.shot_variance * dark
    return variance * noise_share(s, row, mirror(column, s.width))


@wp.func
def is_saturated(
    on: wp.array[Any], s: SignalLayout, row: wp.int32, first: wp.int32, last: wp.int32
):
    """Whether any pixel from column `first` to `last` is at full scale."""
    highest = own_at(on, s, row, first)
    for column in range(first + 1, last + 1):
        highest = wp.max(highest, own_at(on, s, row, column))
    return highest >= SIGNAL_UNIT * s.full


@wp.func
def changed(s: SignalLayout, suppression: wp.int32, reach: wp.int32, lean: wp.int32):
    """The layout with another suppression, reach and lean."""
    new = SignalLayout()
    new.kind = s.kind
    new.width = s.width
    new.height = s.height
    new.row_step = s.row_step
    new.own = s.own
    new.suppression = suppression
    new.row_phase = s.row_phase
    new.column_phase = s.column_phase
    new.reach = reach
    new.lean = lean
    new.is_paired = s.is_paired
    new.full = s.full
    new.read_variance = s.read_variance
    new.shot_variance = s.shot_variance
    return new


# A saturated core is nearly white: less the other channels it would be a dip in the line.
@wp.func
def suited_to_run(
    on: wp.array[Any], s: SignalLayout, row: wp.int32, first: wp.int32, last: wp.int32
):
    """The layout for a run of a row: where it is saturated, the own channel alone."""
    suppression = s.suppression
    if suppression > 0 and is_saturated(on, s, row, first, last):
        suppression = 0
    return changed(s, suppression, s.reach, s.lean)
