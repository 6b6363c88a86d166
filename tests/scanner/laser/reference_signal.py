"""Slow twin of the kernels' signal: the laser's channel at every pixel of a frame."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthwarp.scanner.frames import Frame
from depthwarp.scanner.laser.colors import channel_sites


def mirror(i: int, count: int) -> int:
    """An index folded back about the outermost pixels."""
    i = -i if i < 0 else i
    i = 2 * (count - 1) - i if i >= count else i
    return min(max(i, 0), count - 1)


def own_signal(
    frame: Frame, channel: int, reach: int
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.float64]]:
    """The channel at all pixels in units of 1 / 32, and the share of a number's variance there."""
    aside = abs(reach) - 1 if reach > 0 else 1 - abs(reach)
    numbers = frame.pixels.astype(np.int64)
    if not frame.pixel_format.is_bayer:
        return 32 * numbers[..., channel], np.ones(numbers.shape[:2])
    height, width = numbers.shape
    own, share = np.zeros_like(numbers), np.zeros(numbers.shape)
    sites = {(r % 2, c % 2) for r, c in channel_sites(frame.pixel_format)[channel]}

    def row_of_sites(r: int, c: int) -> int:
        r = mirror(r, height)
        if (r % 2, c % 2) in sites:
            return 16 * int(numbers[r, c])
        near, far = (
            int(numbers[r, mirror(c - k, width)]) + int(numbers[r, mirror(c + k, width)])
            for k in (1, 3)
        )
        return 9 * near - far

    for r in range(height):
        for c in range(width):
            if channel == 1 and (r % 2, c % 2) in sites:
                own[r, c], share[r, c] = 32 * numbers[r, c], 1.0
            elif channel == 1:
                above, below = (
                    numbers[mirror(r + side * abs(reach), height), mirror(c + side * aside, width)]
                    for side in (-1, 1)
                )
                own[r, c], share[r, c] = 16 * (above + below), 0.5
            elif any(r % 2 == site_row for site_row, _ in sites):
                own[r, c], share[r, c] = 2 * row_of_sites(r, c), 2.0
            else:
                own[r, c] = row_of_sites(r - 1, c) + row_of_sites(r + 1, c)
                share[r, c] = 1.0
    return own, share
