"""The error of a line's position that is not noise: pixel phase, mosaic, saturation."""

from typing import Any

import warp as wp

from depthwarp_kernels.laser_peak import BLUR_UNIT, Peak, line_deviation
from depthwarp_kernels.laser_signal import (
    MOSAIC_RED_OR_BLUE,
    SIGNAL_UNIT,
    SignalLayout,
    own_at,
    signal_at,
)

# What noise does not explain, measured on lines without noise [px^2]: pixel phase and
# interpolation, 0.01 px; a red or blue line that is narrower than the pitch of its sites, 1/3 px.
SYSTEMATIC = wp.constant(wp.float64(1.0e-4))
SYSTEMATIC_COARSE = wp.constant(wp.float64(0.11))
COARSE_BELOW = 1.5  # standard deviation of that line [px]

# Where a flank leaves full scale it has a kink, whose place between the pixels is not seen. That
# shifts the line by 0.027 px times the flank's fall there, in full scales a pixel: measured without
# noise on lines of 0.6 to 3.5 px, up to 12 times full scale (0.015 to 0.036, and 0.1 px at most
# where a flank lies within a pixel). An exponential flank falls by one over its area.
SATURATED_SHIFT = wp.constant(wp.float64(0.054))  # times one over the area of both flanks [px^2]
LEAST_FLANKS = wp.constant(wp.float64(2.0 / 3.0))  # that area, where it lies within a pixel [px]


# The flanks are the pixels below full scale up to a width beside the line, less its background;
# their height is that of the saturated pixels.
@wp.func
def flank_area(on: wp.array[Any], off: wp.array[Any], s: SignalLayout, row: wp.int32, peak: Peak):
    """Area of the flanks of a saturated line over its height [px]."""
    width = peak.right - peak.left
    highest = int(1)
    area = wp.int64(0)
    for column in range(wp.int32(peak.left - width), wp.int32(peak.right + width) + 1):
        above = BLUR_UNIT * signal_at(on, off, s, row, column) - peak.base
        if own_at(on, s, row, column) < SIGNAL_UNIT * s.full:
            area += wp.int64(above)
        else:
            highest = wp.max(highest, above)
    return wp.float64(area) / wp.float64(highest)


@wp.func
def systematic_variance(
    on: wp.array[Any],
    off: wp.array[Any],
    s: SignalLayout,
    row: wp.int32,
    peak: Peak,
    saturated: bool,
):
    """Variance of a position that does not come from noise [px^2]."""
    if s.kind == MOSAIC_RED_OR_BLUE and line_deviation(peak) < wp.float64(COARSE_BELOW):
        return SYSTEMATIC_COARSE
    if saturated:
        flanks = wp.max(flank_area(on, off, s, row, peak), LEAST_FLANKS)
        shift = SATURATED_SHIFT / flanks
        return SYSTEMATIC + shift * shift
    return SYSTEMATIC
