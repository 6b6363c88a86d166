"""Pictures that the tests of the frame sources feed in, and what must come out of them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthwarp.scanner.frames import PixelFormat

BAYER = [pattern for pattern in PixelFormat if pattern.is_bayer]

CHANNEL = {"b": 0, "g": 1, "r": 2}
"""Place of a colour in a BGR pixel."""


def colourful(width: int, height: int, seed: int = 0) -> npt.NDArray[np.uint8]:
    """A BGR picture of which no two pixels, channels or turns are alike."""
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def mosaic(bgr: npt.NDArray[np.uint8], pattern: PixelFormat) -> npt.NDArray[np.uint8]:
    """What a sensor with this Bayer pattern sees of a BGR picture: one channel at each site."""
    letters = pattern.value.removeprefix("bayer_")
    rows, columns = np.indices(bgr.shape[:2])
    channel = np.array([CHANNEL[letter] for letter in letters])[2 * (rows % 2) + columns % 2]
    return np.take_along_axis(bgr, channel[:, :, None], axis=2)[:, :, 0]


def upright(raw: npt.NDArray[np.uint8], rotation: int) -> npt.NDArray[np.uint8]:
    """The picture turned clockwise, by NumPy."""
    return np.ascontiguousarray(np.rot90(raw, -(rotation // 90)))
