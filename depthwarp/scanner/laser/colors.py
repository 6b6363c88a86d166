"""Colours of a frame: one a pixel of a BGR frame, one a 2 x 2 cell of a Bayer mosaic."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError
from depthwarp.scanner.frames import Frame, PixelFormat

__all__ = ["CHANNELS", "FULL_LEVEL", "channel_sites", "check_pair", "frame_colors"]

FULL_LEVEL = 255.0
"""Colours of any bit depth are given in grey levels with this full scale."""

CHANNELS = ("blue", "green", "red")


def channel_sites(pixel_format: PixelFormat) -> tuple[list[tuple[int, int]], ...]:
    """(row, column) within a 2 x 2 cell of the blue, the green and the red sites of a mosaic."""
    names = pixel_format.value.removeprefix("bayer_")
    return tuple([divmod(i, 2) for i in range(4) if names[i] == name[0]] for name in CHANNELS)


def check_pair(frame: Frame, off: Frame) -> None:
    """Refuse two frames that cannot be subtracted.

    Raises:
        InputError: Their size, format or bits differ.
    """
    both = [(f.pixels.shape, f.pixel_format.value, f.bits) for f in (frame, off)]
    if both[0] != both[1]:
        raise InputError(
            "a frame and its off frame must have the same shape, format and bits, got "
            f"{both[0]} and {both[1]}: take both with the same settings"
        )


def frame_colors(frame: Frame, off: Frame | None = None) -> npt.NDArray[np.float64]:
    """Colours of a frame, or of the difference to a frame taken with the laser off.

    Args:
        frame: BGR, or a Bayer mosaic, whose cells are taken as they are, without demosaicing: the
            mean of their two green sites. An odd last row or column belongs to no cell.
        off: The same view without the laser, subtracted; what would be negative is 0.

    Returns:
        Shape (H, W, 3), or (H // 2, W // 2, 3) for a mosaic: blue, green, red [levels of 255].

    Raises:
        InputError: A MONO frame, which has no colour, or two frames that do not match.
    """
    if frame.pixel_format is PixelFormat.MONO:
        raise InputError("the laser line is found by colour: need a BGR or Bayer frame, got mono")
    colors = _sites_mean(frame)
    if off is not None:
        check_pair(frame, off)
        colors = np.maximum(colors - _sites_mean(off), 0.0)
    return np.asarray(colors * (FULL_LEVEL / (2**frame.bits - 1)))


def _sites_mean(frame: Frame) -> npt.NDArray[np.float64]:
    pixels = frame.pixels.astype(np.float64)
    if not frame.pixel_format.is_bayer:
        return pixels
    height, width = (side // 2 * 2 for side in pixels.shape)
    channels = [
        sum((pixels[row:height:2, column:width:2] for row, column in sites), np.float64(0.0))
        / len(sites)
        for sites in channel_sites(frame.pixel_format)
    ]
    return np.stack(channels, axis=-1)
