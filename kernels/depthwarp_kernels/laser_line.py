"""The crossing of a laser line with each row of a frame.

A row is searched where the colour mask says "line"; the highest peak there is the line's. The order
of every floating-point operation is part of the contract: the NumPy twin repeats it bit for bit.
"""

from typing import Any

import warp as wp

from depthwarp_kernels.laser_peak import (
    BLURRED_UNIT,
    ROW_EMPTY,
    ROW_FOUND,
    ROW_WEAK,
    Peak,
    measure_peak,
)
from depthwarp_kernels.laser_position import position_of
from depthwarp_kernels.laser_signal import (
    MOSAIC_RED_OR_BLUE,
    SignalLayout,
    is_saturated,
    suited_to_run,
)
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

BLUR_VARIANCE = 1.0  # of the blur under which peaks are measured [px^2]
EIGHT_LOG_2 = 5.545177444479562  # (width at half height / standard deviation)^2 of a Gaussian
GAUSS_BELOW = 0.8  # standard deviation of a line [px] below which three pixels hold it

# What noise does not explain, measured on lines without noise [px^2]: pixel phase and
# interpolation, 0.01 px; the steep flanks of a saturated line, 0.025 px (0.02 to 0.07, by width and
# phase); a red or blue line that is narrower than the pitch of its sites, 1/3 px.
SYSTEMATIC = wp.constant(wp.float64(1.0e-4))
SYSTEMATIC_SATURATED = wp.constant(wp.float64(6.25e-4))
SYSTEMATIC_COARSE = wp.constant(wp.float64(0.11))
COARSE_BELOW = 1.5  # standard deviation of that line [px]

# Flags beside the state of a row.
FLAG_SATURATED = wp.constant(256)
FLAG_RIVAL = wp.constant(512)
FLAG_GAUSS = wp.constant(1024)
STATE_BITS = 255


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
def line_deviation(peak: Peak):
    """Standard deviation of a Gaussian as wide as a peak was before the blur [px]."""
    width = peak.right - peak.left
    variance = width * width / wp.float64(EIGHT_LOG_2) - wp.float64(BLUR_VARIANCE)
    return wp.sqrt(wp.max(variance, wp.float64(0.0)))


@wp.func
def systematic_variance(s: SignalLayout, deviation: wp.float64, saturated: bool):
    """Variance of a position that does not come from noise [px^2]."""
    if s.kind == MOSAIC_RED_OR_BLUE and deviation < wp.float64(COARSE_BELOW):
        return SYSTEMATIC_COARSE
    if saturated:
        return SYSTEMATIC_SATURATED
    return SYSTEMATIC


# Launch over the rows. `weights` and `limits` are the derivative filters and the widest line
# [px, standard deviation] that each is for. quality: sigma [px], height (in numbers of the frame),
# width at half height [px].
@wp.kernel
def find_line(
    # In:
    on: wp.array[Any],
    off: wp.array[Any],
    s: SignalLayout,
    search: LineSearch,
    mask: wp.array2d[wp.uint8],
    weights: wp.array2d[wp.int32],
    limits: wp.array[wp.float64],
    # Out:
    column_out: wp.array[wp.float64],
    quality_out: wp.array[wp.vec3f],
    state_out: wp.array[wp.int32],
):
    row = wp.tid()
    mask_row = wp.min(row / search.cell, mask.shape[0] - 1)
    state = int(ROW_EMPTY)
    best_height = int(0)
    best_first = int(0)
    best_last = int(0)
    rival_height = int(0)
    run = run_from(mask, mask_row, 0, search.bridge)
    while run[0] >= 0:
        first = wp.max(run[0] * search.cell - 1, 0)
        last = wp.min((run[1] + 1) * search.cell, s.width - 1)
        suited = suited_to_run(on, s, row, first, last)
        peak = measure_peak(on, off, suited, search.min_snr, search.max_width, row, first, last)
        state = wp.max(state, peak.state)
        if peak.state == ROW_FOUND:
            if peak.height > best_height:
                rival_height = best_height
                best_height = peak.height
                best_first = first
                best_last = last
            elif peak.height > rival_height:
                rival_height = peak.height
        run = run_from(mask, mask_row, run[1] + 1, search.bridge)
    if state == ROW_FOUND:
        chosen = suited_to_run(on, s, row, best_first, best_last)
        line = measure_peak(
            on, off, chosen, search.min_snr, search.max_width, row, best_first, best_last
        )
        saturated = is_saturated(on, s, row, best_first, best_last)
        deviation = line_deviation(line)
        scale = int(0)
        while scale < limits.shape[0] - 1 and limits[scale] < deviation:
            scale += 1
        narrow = deviation < wp.float64(GAUSS_BELOW) and s.kind != MOSAIC_RED_OR_BLUE
        position = position_of(on, off, chosen, weights, scale, row, line, narrow)
        if position[1] >= wp.float64(0.0):
            systematic = systematic_variance(s, deviation, saturated)
            if wp.float64(rival_height) >= search.rival_share * wp.float64(best_height):
                state += FLAG_RIVAL
            if saturated:
                state += FLAG_SATURATED
            if position[2] > wp.float64(0.0):
                state += FLAG_GAUSS
            column_out[row] = position[0]
            quality_out[row] = wp.vec3f(
                wp.float32(wp.sqrt(position[1] * position[1] + systematic)),
                wp.float32(wp.float64(line.height) / BLURRED_UNIT),
                wp.float32(deviation * wp.sqrt(wp.float64(EIGHT_LOG_2))),
            )
        else:
            state = ROW_WEAK
    state_out[row] = state


for _number in (wp.uint8, wp.uint16):
    wp.overload(find_line, {"on": wp.array[_number], "off": wp.array[_number]})
