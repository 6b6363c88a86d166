"""Directions in an image as sectors of a turn, in a table instead of an arc tangent."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp_kernels.filters_sectors import HALF_REACH, SECTORS

__all__ = ["device_sectors", "sector_of"]


def sector_of(right: npt.ArrayLike, down: npt.ArrayLike) -> npt.NDArray[np.int64]:
    """Sector of offsets [px]: 0 begins to the right, then on by way of downwards, 11.25 degrees."""
    angle = np.arctan2(np.asarray(down, np.float64), np.asarray(right, np.float64))
    # Multiples of 45 degrees come out of arctan2 an ulp off: nudged into the sector they begin.
    turns = (angle / (2 * np.pi)) % 1.0
    return np.asarray(np.floor(turns * SECTORS + 1e-9), np.int64) % SECTORS


@cache
def _sector_bits() -> npt.NDArray[np.uint32]:
    offsets = np.arange(-HALF_REACH, HALF_REACH + 1)
    right, down = np.meshgrid(offsets, offsets)
    bits = np.where((right == 0) & (down == 0), 0, np.int64(1) << sector_of(right, down))
    return bits.ravel().astype(np.uint32)


def device_sectors(device: Any) -> Any:
    """Sector bits of offsets in half pixels, row by row, on a device; no bit of no offset."""
    return wp.array(_sector_bits(), dtype=wp.uint32, device=device)
