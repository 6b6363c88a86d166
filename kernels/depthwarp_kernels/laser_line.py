"""The crossing of a laser line with each row of a frame.

A row is searched where the colour mask says "line"; the highest peak there is the line's. The order
of every floating-point operation is part of the contract: the NumPy twin repeats it bit for bit.
"""

from typing import Any

import warp as wp

from depthwarp_kernels.laser_peak import (
    BLURRED_UNIT,
    EIGHT_LOG_2,
    ROW_EMPTY,
    ROW_FOUND,
    ROW_WEAK,
    Peak,
    line_deviation,
    measure_peak,
)
from depthwarp_kernels.laser_position import Filters, position_of
from depthwarp_kernels.laser_signal import (
    MOSAIC_RED_OR_BLUE,
    SignalLayout,
    changed,
    is_saturated,
    suited_to_run,
)
from depthwarp_kernels.laser_systematic import systematic_variance
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

GAUSS_BELOW = 0.8  # standard deviation of a line [px] below which three pixels hold it

# Flags beside the state of a row.
FLAG_SATURATED = wp.constant(256)
FLAG_RIVAL = wp.constant(512)
FLAG_GAUSS = wp.constant(1024)
STATE_BITS = 255

# The slope of a line is taken from rows so far above and below, and believed up to so many columns
# a row. The sites of green next along a line of slope s are (reach, reach - 1) rows and columns
# away; of 1, 2, 3 rows that reach is the best for which reach - 1 - reach s is the smallest.
SLOPE_ROWS = wp.constant(4)
MAX_SLOPE = wp.constant(wp.float64(1.5))
REACH_2_FROM = wp.constant(wp.float64(1.0 / 3.0))
REACH_3_FROM = wp.constant(wp.float64(0.6))


# min_snr: least height of a blurred peak over its background, in deviations of its noise.
# max_width: greatest width at half height [px]. bridge: cells between two runs of the mask that
# still are one. cell: side of a cell of the mask [px]. rival_share: share of the line's height from
# which another peak of the row is a rival.
@wp.struct
class LineSearch:
    min_snr: wp.float64
    max_width: wp.float64
    bridge: wp.int32
    cell: wp.int32
    rival_share: wp.float64


# The highest peak of a row, and the run of the mask that holds it, in pixels; the height of the
# highest among the others; what became of the row's peaks.
@wp.struct
class BestRun:
    peak: Peak
    first: wp.int32
    last: wp.int32
    rival_height: wp.int32
    state: wp.int32


@wp.func
def run_from(mask: wp.array2d[wp.uint8], row: wp.int32, start: wp.int32, gap: wp.int32):
    """First and last cell of the next run of the mask, gaps bridged; the first is -1 at the end."""
    count = mask.shape[1]
    first = int(start)
    while first < count and mask[row, first] == wp.uint8(0):
        first += 1
    if first >= count:
        return wp.vec2i(-1, count)
    last = int(first)
    cell = int(first + 1)
    while cell < count and cell - last <= gap + 1:
        if mask[row, cell] != wp.uint8(0):
            last = cell
        cell += 1
    return wp.vec2i(first, last)


@wp.func
def best_run(
    on: wp.array[Any],
    off: wp.array[Any],
    s: SignalLayout,
    search: LineSearch,
    mask: wp.array2d[wp.uint8],
    row: wp.int32,
):
    """The run of the mask that holds the highest peak of a row."""
    best = BestRun()
    best.state = ROW_EMPTY
    mask_row = wp.min(row / search.cell, mask.shape[0] - 1)
    run = run_from(mask, mask_row, 0, search.bridge)
    while run[0] >= 0:
        first = wp.max(run[0] * search.cell - 1, 0)
        last = wp.min((run[1] + 1) * search.cell, s.width - 1)
        suited = suited_to_run(on, s, row, first, last)
        peak = measure_peak(on, off, suited, search.min_snr, search.max_width, row, first, last)
        best.state = wp.max(best.state, peak.state)
        if peak.state == ROW_FOUND:
            if peak.height > best.peak.height:
                best.rival_height = best.peak.height
                best.peak = peak
                best.first = first
                best.last = last
            elif peak.height > best.rival_height:
                best.rival_height = peak.height
        run = run_from(mask, mask_row, run[1] + 1, search.bridge)
    return best


@wp.func
def scale_for(filters: Filters, deviation: wp.float64):
    """The derivative filter for a line of a standard deviation [px]."""
    scale = int(0)
    widest = filters.limits.shape[0] - 1
    while scale < widest and filters.limits[scale] < deviation:
        scale += 1
    return scale


@wp.func
def measure_run(
    on: wp.array[Any],
    off: wp.array[Any],
    s: SignalLayout,
    search: LineSearch,
    filters: Filters,
    best: BestRun,
    row: wp.int32,
    column_out: wp.array[wp.float64],
    quality_out: wp.array[wp.vec3f],
):
    """Write where the line crosses a row, and return the state of the row with its flags."""
    suited = suited_to_run(on, s, row, best.first, best.last)
    line = best.peak
    saturated = is_saturated(on, s, row, best.first, best.last)
    deviation = line_deviation(line)
    scale = scale_for(filters, deviation)
    narrow = deviation < wp.float64(GAUSS_BELOW) and s.kind != MOSAIC_RED_OR_BLUE
    position = position_of(on, off, suited, filters, scale, row, line, narrow)
    if position[1] < wp.float64(0.0):
        return ROW_WEAK
    systematic = systematic_variance(on, off, suited, row, line, saturated)
    column_out[row] = position[0]
    quality_out[row] = wp.vec3f(
        wp.float32(wp.sqrt(position[1] * position[1] + systematic)),
        wp.float32(wp.float64(line.height) / BLURRED_UNIT),
        wp.float32(deviation * wp.sqrt(wp.float64(EIGHT_LOG_2))),
    )
    state = int(ROW_FOUND)
    if wp.float64(best.rival_height) >= search.rival_share * wp.float64(line.height):
        state += FLAG_RIVAL
    if saturated:
        state += FLAG_SATURATED
    if position[2] > wp.float64(0.0):
        state += FLAG_GAUSS
    return state


@wp.func
def find_in_row(
    on: wp.array[Any],
    off: wp.array[Any],
    s: SignalLayout,
    search: LineSearch,
    mask: wp.array2d[wp.uint8],
    filters: Filters,
    row: wp.int32,
    column_out: wp.array[wp.float64],
    quality_out: wp.array[wp.vec3f],
    state_out: wp.array[wp.int32],
):
    """Write the line's crossing of a row, or why there is none."""
    best = best_run(on, off, s, search, mask, row)
    state = int(best.state)
    if state == ROW_FOUND:
        state = measure_run(on, off, s, search, filters, best, row, column_out, quality_out)
    state_out[row] = state


# Launch over the rows. quality: sigma [px], height (in numbers of the frame), width at half height
# [px].
@wp.kernel
def find_line(
    # In:
    on: wp.array[Any],
    off: wp.array[Any],
    s: SignalLayout,
    search: LineSearch,
    mask: wp.array2d[wp.uint8],
    filters: Filters,
    # Out:
    column_out: wp.array[wp.float64],
    quality_out: wp.array[wp.vec3f],
    state_out: wp.array[wp.int32],
):
    row = wp.tid()
    find_in_row(on, off, s, search, mask, filters, row, column_out, quality_out, state_out)


@wp.func
def slope_to(
    column: wp.array[wp.float64], state: wp.array[wp.int32], row: wp.int32, other: wp.int32
):
    """Columns a row from a row to another, and 1; zeros where no line joins them."""
    nothing = wp.vec2d(wp.float64(0.0), wp.float64(0.0))
    if other < 0 or other >= column.shape[0]:
        return nothing
    if (state[row] & STATE_BITS) != ROW_FOUND or (state[other] & STATE_BITS) != ROW_FOUND:
        return nothing
    slope = (column[other] - column[row]) / wp.float64(other - row)
    if wp.abs(slope) > MAX_SLOPE:
        return nothing
    return wp.vec2d(slope, wp.float64(1.0))


# Launch over the rows. The reach is negative where the line leans to the left going down.
@wp.kernel
def find_reach(
    # In:
    column: wp.array[wp.float64],
    state: wp.array[wp.int32],
    # Out:
    reach_out: wp.array[wp.int32],
):
    row = wp.tid()
    both = slope_to(column, state, row, row - SLOPE_ROWS)
    both += slope_to(column, state, row, row + SLOPE_ROWS)
    slope = wp.float64(0.0)
    if both[1] == wp.float64(2.0):
        slope = both[0] * wp.float64(0.5)
    reach = int(1)
    if wp.abs(slope) > REACH_3_FROM:
        reach = 3
    elif wp.abs(slope) > REACH_2_FROM:
        reach = 2
    reach = wp.max(wp.min(reach, wp.min(row, column.shape[0] - 1 - row)), 1)
    if slope < wp.float64(0.0):
        reach = -reach
    reach_out[row] = reach


# Launch over the rows of a green mosaic, after `find_line` and `find_reach`: the rows in which the
# line leans are searched again, what the mosaic leaves out now taken along the line.
@wp.kernel
def find_leaning_line(
    # In:
    on: wp.array[Any],
    off: wp.array[Any],
    s: SignalLayout,
    search: LineSearch,
    mask: wp.array2d[wp.uint8],
    filters: Filters,
    reach: wp.array[wp.int32],
    # Out:
    column_out: wp.array[wp.float64],
    quality_out: wp.array[wp.vec3f],
    state_out: wp.array[wp.int32],
):
    row = wp.tid()
    rows = wp.abs(reach[row])
    if rows > 1:
        lean = (rows - 1) * wp.sign(reach[row])
        leaning = changed(s, s.suppression, rows, lean)
        find_in_row(
            on, off, leaning, search, mask, filters, row, column_out, quality_out, state_out
        )


for _number in (wp.uint8, wp.uint16):
    wp.overload(find_line, {"on": wp.array[_number], "off": wp.array[_number]})
    wp.overload(find_leaning_line, {"on": wp.array[_number], "off": wp.array[_number]})
