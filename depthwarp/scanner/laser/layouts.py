"""How a frame's numbers are to be read by the kernels of the laser line."""

from __future__ import annotations

from typing import Any

import warp as wp

from depthwarp.scanner.frames import PixelFormat
from depthwarp.scanner.laser.colors import FULL_LEVEL, channel_sites
from depthwarp_kernels import laser_color, laser_signal

__all__ = ["color_layout", "signal_layout"]

GREEN = 1


def color_layout(size: tuple[int, int], pixel_format: PixelFormat, bits: int) -> Any:
    """A `ColorLayout` for frames of a size (width, height), format and depth."""
    width = size[0]
    layout: Any = laser_color.ColorLayout()
    if pixel_format.is_bayer:
        layout.step, layout.row_step = 2, 2 * width
        blue, green, red = (
            [row * width + column for row, column in sites] for sites in channel_sites(pixel_format)
        )
        layout.blue, layout.green, layout.green_other, layout.red = *blue, *green, *red
    else:
        layout.step, layout.row_step = 3, 3 * width
        layout.blue, layout.green, layout.green_other, layout.red = 0, 1, 1, 2
    layout.factor = wp.uint32(round(FULL_LEVEL / (2 * (2**bits - 1)) * 2**24))
    return layout


def signal_layout(
    size: tuple[int, int],
    pixel_format: PixelFormat,
    bits: int,
    channel: int,
    suppression: float,
    variances: tuple[float, float],
) -> Any:
    """A `SignalLayout` for frames of a size (width, height), format and depth.

    Args:
        size: (width, height) [px].
        pixel_format: BGR or a mosaic.
        bits: Significant bits of a number.
        channel: The laser's own, 0 blue, 1 green, 2 red.
        suppression: Share of the other channels' mean that the signal loses; of a mosaic only the
            own channel is used, because the others are sampled too coarsely for a position.
        variances: Read noise squared, and growth of the variance with the number.
    """
    layout: Any = laser_signal.SignalLayout()
    layout.width, layout.height = size
    layout.row_step = size[0] * (1 if pixel_format.is_bayer else 3)
    layout.own = channel
    layout.full = 2**bits - 1
    layout.read_variance, layout.shot_variance = variances
    if not pixel_format.is_bayer:
        layout.kind = laser_signal.BGR
        layout.suppression = round(suppression * laser_signal.SIGNAL_UNIT / 2)
        return layout
    row, column = channel_sites(pixel_format)[channel][0]
    layout.row_phase, layout.column_phase = row, column
    layout.reach = 1
    layout.kind = laser_signal.MOSAIC_RED_OR_BLUE
    if channel == GREEN:
        layout.kind, layout.column_phase = laser_signal.MOSAIC_GREEN, (row + column) % 2
    return layout
