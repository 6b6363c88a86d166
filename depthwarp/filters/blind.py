"""Pixels that a lens has no ray for: what a filter fills there is taken back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp import arrays
from depthwarp.cameras import Camera, DepthKind
from depthwarp.filters.maps import DeviceMaps
from depthwarp.filters.rows import row_launch
from depthwarp_kernels.filters_blind import copy_blind
from depthwarp_kernels.filters_layers import WORD

__all__ = ["blind_pixels", "device_blind_pixels", "sparing_blind"]

GRID = 65
"""Columns and rows, corners among them, where a lens is asked first."""

KNOWN_LENSES = 32
"""Lenses whose pixels are kept, so that cameras that move are not asked again."""

Words = npt.NDArray[np.uint32]


@dataclass(frozen=True)
class _Lens:
    """A camera wherever it stands; two with the same numbers are equal."""

    numbers: tuple[Any, ...]
    camera: Camera = field(compare=False)
    kind: DepthKind

    @classmethod
    def of(cls, camera: Camera, kind: DepthKind) -> _Lens:
        names = [one.name for one in fields(camera)]  # type: ignore[arg-type]
        numbers = [getattr(camera, name) for name in names if not name.startswith("pose")]
        return cls((type(camera), *numbers), camera, kind)


def blind_pixels(cameras: Sequence[Camera], kind: DepthKind) -> Words | None:
    """Which pixels have no ray, or none with this kind of depth.

    Args:
        cameras: Cameras of one image size.
        kind: Which depth their maps hold.

    Returns:
        32 columns a word, the first one in the lowest bit, shape (V, H, words), uint32; None if all
        pixels of all cameras have a ray.
    """
    of_views = [_blind_of(_Lens.of(camera, kind)) for camera in cameras]
    found = next((words for words in of_views if words is not None), None)
    if found is None:
        return None
    return np.stack([np.zeros_like(found) if words is None else words for words in of_views])


def device_blind_pixels(cameras: Sequence[Camera], kind: DepthKind, device: Any) -> Any:
    """The same on a device."""
    words = blind_pixels(cameras, kind)
    return None if words is None else wp.array(words, dtype=wp.uint32, device=device)


def sparing_blind(
    steps: Sequence[Callable[[], None]], maps: DeviceMaps
) -> list[Callable[[], None]]:
    """The steps, after each of which what it filled where `maps.blind` has a bit is as before."""
    own = [maps.depth, maps.index, maps.state]
    kept = [arrays.empty(array.shape, array.dtype, array.device) for array in own]
    size = maps.blind.shape[1:]
    keep = row_launch(copy_blind, maps, [0, maps.blind, *own], kept, size)
    put_back = row_launch(copy_blind, maps, [1, maps.blind, *kept], own, size)
    return [part for step in steps for part in (keep, step, put_back)]


@lru_cache(KNOWN_LENSES)
def _blind_of(lens: _Lens) -> Words | None:
    width, height = lens.camera.size
    some = [np.linspace(0, side - 1, min(side, GRID)) for side in (height, width)]
    if not _is_blind(lens, *some).any():
        return None
    bits = np.zeros((height, -(-width // WORD) * WORD), bool)
    for row in range(height):  # one by one: rays take 24 bytes a pixel
        bits[row, :width] = _is_blind(lens, np.array([row]), np.arange(width))[0]
    return np.packbits(bits, axis=1, bitorder="little").view("<u4").astype(np.uint32)


def _is_blind(
    lens: _Lens, rows: npt.NDArray[Any], columns: npt.NDArray[Any]
) -> npt.NDArray[np.bool_]:
    u, v = np.meshgrid(columns.astype(np.float64), rows.astype(np.float64))
    with np.errstate(all="ignore"):
        points = lens.camera.points_of(u, v, np.ones_like(u), lens.kind)
    return np.asarray(~np.isfinite(points).all(axis=-1))
