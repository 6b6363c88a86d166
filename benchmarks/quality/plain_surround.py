"""The plain surround rule: what `dw.filters.best()` began as, written in NumPy.

A pixel is hidden when nearer ones stand round it in enough directions, each within 1.5 times the
spacing of its own surface. No gaps, no lines, no companions: it shows what those bring.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

import depthwarp as dw
from benchmarks.quality.maps import Step, erase_where

__all__ = ["hidden_pixels", "plain_surround"]

Image = npt.NDArray[np.float32]
Indices = npt.NDArray[np.intp]

COMPANIONS, FARTHEST = 4, 32
LAYER_MARGIN_M, SLOPE = 0.03, 1.5
HIDING_MARGIN_M, HIDING_SHARE = 0.02, 0.002
REACH = 1.5
LEVELS, SECTORS, MOST_EMPTY = 5, 16, 8


def plain_surround() -> Step:
    """Erase what the rule calls hidden; images of a full turn do not go round."""

    def erase(depth_map: dw.DepthMap, cloud: dw.PointCloud) -> dw.DepthMap:
        pitch = depth_map.camera.pixel_pitch
        return erase_where(depth_map, hidden_pixels(depth_map.depth, pitch))

    return erase


def hidden_pixels(depth: Image, pitch: tuple[float, float]) -> npt.NDArray[np.bool_]:
    """Which pixels nearer ones surround.

    Args:
        depth: Depth [m], 0 where empty, shape (H, W).
        pitch: Metres between neighbouring pixels: (a metre of depth, constant [m]).

    Returns:
        Shape (H, W).
    """
    rows, columns = np.nonzero(depth)
    z = depth[rows, columns].astype(np.float64)
    metres = pitch[0] * z + pitch[1]
    spacing = _spacing(depth, rows, columns, z, metres)
    limit = np.clip(6 * np.median(spacing), 12, FARTHEST) if z.size else 0
    speaks = np.flatnonzero(spacing <= limit)
    bits = np.zeros(z.size, np.uint32)
    for level in range(LEVELS):
        nearest = _nearest_of_areas(rows, columns, z, speaks, depth.shape, level)
        for down in (0, 1, 2):
            for right in (0, 1, 2):
                q = nearest[(rows >> level) + down, (columns >> level) + right]
                bits |= _hiding_bits(rows, columns, z, metres, spacing, q)
    hidden = np.zeros(depth.shape, bool)
    hidden[rows, columns] = _longest_empty_run(bits) <= MOST_EMPTY
    return hidden


def _spacing(
    depth: Image,
    rows: Indices,
    columns: Indices,
    z: npt.NDArray[np.float64],
    metres: npt.NDArray[np.float64],
) -> Indices:
    """Own-layer spacing of every pixel with a depth [px]; one more than the farthest: none."""
    padded = np.pad(depth, FARTHEST)
    spacing = np.full(z.size, FARTHEST + 1)
    left, count = np.arange(z.size), np.zeros(z.size, int)
    for ring in range(1, FARTHEST + 1):
        within = LAYER_MARGIN_M + SLOPE * ring * metres[left]
        r, c = rows[left] + FARTHEST, columns[left] + FARTHEST
        for down, right in _ring(ring):
            other = padded[r + down, c + right]
            count[left] += (other > 0) & (np.abs(other - z[left]) <= within)
        found = count[left] >= COMPANIONS
        spacing[left[found]] = ring
        left = left[~found]
    return spacing


def _ring(radius: int) -> list[tuple[int, int]]:
    """Offsets (down, right) of a square ring."""
    side = range(-radius, radius + 1)
    return [(y, x) for y in side for x in side if max(abs(y), abs(x)) == radius]


def _nearest_of_areas(
    rows: Indices,
    columns: Indices,
    z: npt.NDArray[np.float64],
    speaks: Indices,
    shape: tuple[int, ...],
    level: int,
) -> Indices:
    """The nearest pixel of every area of 1, 2, 4, ... px a side, -1 without one; a border of -1."""
    areas = np.full(((shape[0] - 1 >> level) + 3, (shape[1] - 1 >> level) + 3), -1)
    order = speaks[np.argsort(-z[speaks], kind="stable")]  # the last that is written stays
    areas[(rows[order] >> level) + 1, (columns[order] >> level) + 1] = order
    return areas


def _hiding_bits(
    rows: Indices,
    columns: Indices,
    z: npt.NDArray[np.float64],
    metres: npt.NDArray[np.float64],
    spacing: Indices,
    q: Indices,
) -> npt.NDArray[np.uint32]:
    """The sector, as a bit, in which pixel q hides each pixel; 0 where it does not."""
    down, right = rows[q] - rows, columns[q] - columns
    way = np.hypot(down, right)
    margin = HIDING_MARGIN_M + HIDING_SHARE * z + SLOPE * way * metres[q]
    hides = (q >= 0) & (z - z[q] > margin) & (way <= REACH * spacing[q])
    turn = np.arctan2(down, right) / (2 * np.pi) % 1.0
    sector = np.floor(SECTORS * turn + 1e-9).astype(np.uint32) % SECTORS
    return np.where(hides, np.uint32(1) << sector, np.uint32(0))


def _longest_empty_run(bits: npt.NDArray[np.uint32]) -> npt.NDArray[np.int_]:
    """Longest run of empty sectors round the turn."""
    twice = np.concatenate(
        [~bits[:, None] >> np.arange(SECTORS, dtype=np.uint32) & np.uint32(1)] * 2, axis=1
    )
    longest, run = (np.zeros(bits.size, int) for _ in range(2))
    for empty in twice.T:
        run = (run + 1) * empty.astype(int)
        longest = np.maximum(longest, run)
    return np.minimum(longest, SECTORS)
