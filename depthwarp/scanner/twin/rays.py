"""The ray of every pixel, and which solids a tile of pixels can see."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError
from depthwarp.scanner.geometry import Lens
from depthwarp.scanner.lens import undistort

__all__ = ["TILE", "PixelRays", "TileLists", "pixel_rays", "solids_of_tiles"]

TILE = 32
"""Side of a tile [px]."""

NODES = 512
"""Pixels of a row or a column that are undistorted by iteration."""

NEAR = 1e-4
"""Solids are clipped this far in front of the camera [m]."""

CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
EDGES = np.array([(a, b) for a, b in combinations(range(8), 2) if (a ^ b).bit_count() == 1])


@dataclass(frozen=True, eq=False)
class PixelRays:
    """Undistorted rays of a lens.

    Attributes:
        slopes: (x / z, y / z) of the ray through each pixel's middle, shape (H, W, 2), float32.
        tile_low: Least slopes in each tile and its surrounding, shape (tiles, 2).
        tile_high: Greatest slopes, likewise.
        tiles_across: Tiles in a row of tiles.
    """

    slopes: npt.NDArray[np.float32]
    tile_low: npt.NDArray[np.float64]
    tile_high: npt.NDArray[np.float64]
    tiles_across: int


@dataclass(frozen=True, eq=False)
class TileLists:
    """The solids that each tile can see: those of tile i are `items[first[i]:first[i + 1]]`."""

    first: npt.NDArray[np.int32]
    items: npt.NDArray[np.int32]


@lru_cache(maxsize=4)
def pixel_rays(lens: Lens) -> PixelRays:
    """Undistort every pixel of a lens; what was found is remembered.

    A grid of 512 x 512 pixels is undistorted by iteration; between those, cubic polynomials agree
    with it to the rounding of float32, and a full sensor takes a tenth of the time.

    Raises:
        InputError: The distortion cannot be undone over the whole frame.
    """
    width, height = lens.size
    columns, of_columns = _cubic(width)
    rows, of_rows = _cubic(height)
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    nodes = undistort(lens, pixels).reshape(len(rows), len(columns), 2)
    if not np.all(np.isfinite(nodes)):
        raise InputError(
            f"lens.distortion {lens.distortion} folds back before the corners of a frame of "
            f"{width} x {height} px: use a milder distortion or a smaller frame"
        )
    slopes = np.stack([of_rows @ nodes[..., axis] @ of_columns.T for axis in (0, 1)], axis=-1)
    low, high = _tile_bounds(slopes)
    return PixelRays(slopes.astype(np.float32), low, high, -(-width // TILE))


def _cubic(length: int) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Nodes over pixels 0 to `length` - 1, and weights, shape (length, nodes).

    The weights are those of Lagrange's cubic through the four nodes around each pixel.
    """
    count = max(4, min(length, NODES))
    step = float(max(length - 1, 1)) / (count - 1)
    at = np.arange(length) / step
    first = np.clip(np.floor(at).astype(np.int64) - 1, 0, count - 4)
    weights = np.zeros((length, count))
    for own in range(4):
        product = np.ones(length)
        for other in set(range(4)) - {own}:
            product *= (at - first - other) / (own - other)
        weights[np.arange(length), first + own] = product
    return np.arange(count, dtype=np.float64) * step, weights


def _tile_bounds(
    slopes: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Least and greatest slopes in each tile, a pixel beyond its rim included."""
    height, width = slopes.shape[:2]
    low, high = [], []
    for row in range(0, height, TILE):
        for column in range(0, width, TILE):
            rows = slice(max(row - 1, 0), row + TILE + 1)
            tile = slopes[rows, max(column - 1, 0) : column + TILE + 1]
            low.append(tile.min(axis=(0, 1)))
            high.append(tile.max(axis=(0, 1)))
    return np.array(low), np.array(high)


def solids_of_tiles(
    rays: PixelRays,
    optical_from_local: npt.NDArray[np.float64],
    centers: npt.NDArray[np.float64],
    halves: npt.NDArray[np.float64],
) -> TileLists:
    """List the solids that each tile can see, by their bounds in the picture.

    Args:
        rays: The rays of the lens.
        optical_from_local: Rotations of the solids, shape (N, 3, 3).
        centers: Their middles, optical frame [m], shape (N, 3).
        halves: Half their edge lengths [m], shape (N, 3).
    """
    low, high = _picture_bounds(optical_from_local, centers, halves)
    meets = np.all(
        (low[None] <= rays.tile_high[:, None]) & (high[None] >= rays.tile_low[:, None]), axis=2
    )
    first = np.concatenate([[0], np.cumsum(meets.sum(axis=1))])
    return TileLists(first.astype(np.int32), np.nonzero(meets)[1].astype(np.int32))


def _picture_bounds(
    rotations: npt.NDArray[np.float64],
    centers: npt.NDArray[np.float64],
    halves: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Least and greatest slopes, shape (N, 2), of what of each solid is ahead of the camera."""
    corners = (
        np.einsum("nij,nkj->nki", rotations, CORNERS[None] * halves[:, None]) + centers[:, None]
    )
    start, end = corners[:, EDGES[:, 0]], corners[:, EDGES[:, 1]]
    crosses = (start[..., 2] < NEAR) != (end[..., 2] < NEAR)
    rise = np.where(crosses, end[..., 2] - start[..., 2], 1.0)
    cuts = start + (end - start) * ((NEAR - start[..., 2]) / rise)[..., None]
    points = np.concatenate([corners, cuts], axis=1)
    ahead = np.concatenate([corners[..., 2] >= NEAR, crosses], axis=1)[..., None]
    # A cut lies at NEAR but for rounding.
    slopes = points[..., :2] / np.where(ahead, np.maximum(points[..., 2:], NEAR / 2), 1.0)
    low = np.where(ahead, slopes, np.inf).min(axis=1)
    high = np.where(ahead, slopes, -np.inf).max(axis=1)
    return low, high
