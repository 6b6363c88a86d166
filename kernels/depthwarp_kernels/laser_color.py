"""Colours of a laser line: a table of all colours of 8 bits a channel, and its use on frames.

A word of the table covers 4 x 4 x 4 colours, one bit each: the upper 6 bits of the channels choose
the word, the lower 2 the bit.
"""

from typing import Any

import warp as wp

from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

TABLE_WORDS = 64 * 64 * 64
SPAN = 64


# One Gaussian: log(weight * density) = log_scale - |whiten (color - mean)|^2 / 2.
@wp.struct
class ColorComponent:
    log_scale: wp.float64
    mean: wp.vec3d
    whiten: wp.mat33d


# Where a frame, flat, holds the colours of one pixel of BGR or one 2 x 2 cell of a mosaic: offsets
# from its first number, `step` numbers from one to the next along a row, `row_step` from one row of
# them to the next. BGR names its green twice. (sum of two numbers * factor + 2^23) >> 24 is a grey
# level of 255, to the nearest; the product stays within 32 bits for numbers of 16 bits.
@wp.struct
class ColorLayout:
    step: wp.int32
    row_step: wp.int32
    blue: wp.int32
    green: wp.int32
    green_other: wp.int32
    red: wp.int32
    factor: wp.uint32
    is_paired: wp.int32


@wp.func
def log_joint(component: ColorComponent, color: wp.vec3d):
    """log(weight * density) of one Gaussian at a colour; `whiten` is lower triangular."""
    d = color - component.mean
    w = component.whiten
    x = w[0, 0] * d[0]
    y = w[1, 0] * d[0] + w[1, 1] * d[1]
    z = (w[2, 0] * d[0] + w[2, 1] * d[1]) + w[2, 2] * d[2]
    return component.log_scale - wp.float64(0.5) * ((x * x + y * y) + z * z)


@wp.func
def log_highest(
    components: wp.array[ColorComponent], first: wp.int32, last: wp.int32, color: wp.vec3d
):
    """Logarithm of the highest density among components first to last - 1."""
    highest = log_joint(components[first], color)
    for k in range(first + 1, last):
        highest = wp.max(highest, log_joint(components[k], color))
    return highest


@wp.func
def log_sum(
    components: wp.array[ColorComponent],
    first: wp.int32,
    last: wp.int32,
    color: wp.vec3d,
    highest: wp.float64,
):
    """Logarithm of the summed densities of components first to last - 1."""
    total = wp.float64(0.0)
    for k in range(first, last):
        total += wp.exp(log_joint(components[k], color) - highest)
    return highest + wp.log(total)


# A sum of K densities lies between the highest one and K times it, which decides most colours
# without an exponential.
@wp.func
def is_laser(
    components: wp.array[ColorComponent],
    laser_count: wp.int32,
    log_counts: wp.vec2d,
    color: wp.vec3d,
    least: wp.float64,
):
    """Whether the log odds of a colour reach `least`; `log_counts` are of line and scene."""
    count = components.shape[0]
    laser = log_highest(components, 0, laser_count, color)
    scene = log_highest(components, laser_count, count, color)
    if laser + log_counts[0] - scene < least:
        return False
    if laser - (scene + log_counts[1]) > least:
        return True
    laser = log_sum(components, 0, laser_count, color, laser)
    scene = log_sum(components, laser_count, count, color, scene)
    return laser - scene >= least


# Launch over the words. The first `laser_count` components are the line's, the others the scene's.
@wp.kernel
def bake(
    # In:
    components: wp.array[ColorComponent],
    laser_count: wp.int32,
    least: wp.float64,
    # Out:
    words_out: wp.array[wp.uint64],
):
    word = wp.tid()
    scene_count = components.shape[0] - laser_count
    log_counts = wp.vec2d(wp.log(wp.float64(laser_count)), wp.log(wp.float64(scene_count)))
    bits = wp.uint64(0)
    for bit in range(64):
        color = wp.vec3d(
            wp.float64((word >> 12) * 4 + (bit >> 4)),
            wp.float64(((word >> 6) & 63) * 4 + ((bit >> 2) & 3)),
            wp.float64((word & 63) * 4 + (bit & 3)),
        )
        if is_laser(components, laser_count, log_counts, color, least):
            bits = bits | (wp.uint64(1) << wp.uint64(bit))
    words_out[word] = bits


# Numbers become indices of colours in a loop that compilers vectorize, for which the step has to be
# a constant; only the look-ups go one by one. What a difference makes negative is 0.
LEVELS = """
    for (int k = 0; k < count; ++k) {
        const int at = k * STEP;
        int blue = 2 * lit[at + layout.blue];
        int green = lit[at + layout.green] + lit[at + layout.green_other];
        int red = 2 * lit[at + layout.red];
        if (layout.is_paired) {
            blue = wp::max(blue - 2 * dark[at + layout.blue], 0);
            green = wp::max(green - dark[at + layout.green] - dark[at + layout.green_other], 0);
            red = wp::max(red - 2 * dark[at + layout.red], 0);
        }
        blues[k] = (blue * layout.factor + half) >> 24;
        greens[k] = (green * layout.factor + half) >> 24;
        reds[k] = (red * layout.factor + half) >> 24;
    }
"""
LOOK_UP = """
    for (int k = 0; k < count; ++k) {
        const unsigned b = blues[k], g = greens[k], r = reds[k];
        const unsigned bit = (b & 3) << 4 | (g & 3) << 2 | (r & 3);
        out[k] = (words.data[(b >> 2) << 12 | (g >> 2) << 6 | r >> 2] >> bit) & 1;
    }
"""
CLASSIFY_SPAN = f"""
    const auto* lit = on.data + row * layout.row_step + first * layout.step;
    const auto* dark = off.data + row * layout.row_step + first * layout.step;
    auto* out = mask_out.data + row * mask_out.shape[1] + first;
    const unsigned half = 1u << 23;
    unsigned blues[{SPAN}], greens[{SPAN}], reds[{SPAN}];
    if (layout.step == 2) {{ {LEVELS.replace("STEP", "2")} }}
    else {{ {LEVELS.replace("STEP", "3")} }}
    {LOOK_UP}
"""


@wp.func_native(CLASSIFY_SPAN)
def classify_span(
    on: wp.array[Any],
    off: wp.array[Any],
    layout: ColorLayout,
    words: wp.array[wp.uint64],
    row: int,
    first: int,
    count: int,
    mask_out: wp.array2d[wp.uint8],
):
    """Look up `count` colours of a row, at most `SPAN`."""
    ...


# Launch over (rows, spans) of the mask. Arrays are contiguous.
@wp.kernel
def classify(
    # In:
    on: wp.array[Any],
    off: wp.array[Any],
    layout: ColorLayout,
    words: wp.array[wp.uint64],
    # Out:
    mask_out: wp.array2d[wp.uint8],
):
    row, span = wp.tid()
    first = span * SPAN
    count = wp.min(SPAN, mask_out.shape[1] - first)
    classify_span(on, off, layout, words, row, first, count, mask_out)


for _number in (wp.uint8, wp.uint16):
    wp.overload(classify, {"on": wp.array[_number], "off": wp.array[_number]})
