"""What the tests of quantized clouds share: the check of the bound, and a cloud of all kinds."""

from __future__ import annotations

import numpy as np

import depthwarp as dw
from depthwarp_kernels.point_source import BLOCK

BOUNDS = [1e-9, 1e-6, 1e-4, 1e-3, 0.02, 1.0, 1e6, 1e37]
"""Bounds [m] from nothing to everything."""


def planes_of(chunks: dw.PreparedCloud) -> np.ndarray:
    """Planes of each block: 1, 2 or 3."""
    return chunks.source.boxes.numpy()["planes"]


def moved_by(drawn: np.ndarray, points: np.ndarray) -> float:
    """Largest move of a coordinate [m], of the points that are finite."""
    finite = np.isfinite(points).all(axis=1)
    return float(np.abs(drawn.astype(np.float64) - points)[finite].max(initial=0.0))


def assert_quantized(points: np.ndarray, max_error: float, device: str = "cpu"):
    """Decoded points keep the bound, the caller's order and NaN; returns the cloud."""
    chunks = dw.PointCloud(points).prepare(device=device, max_error=max_error)
    drawn = chunks.points_world()
    assert drawn.shape == points.shape and drawn.dtype == np.float32
    assert moved_by(drawn, points) <= max_error
    finite = np.isfinite(points).all(axis=1)
    assert np.isfinite(drawn[finite]).all() and np.isnan(drawn[~finite]).all()
    return chunks


def three_kinds() -> np.ndarray:
    """Blocks of 4, 8 and 12 bytes at 0.1 mm, and the last not full; some rows not finite."""
    rng = np.random.default_rng(5)
    far = rng.uniform(-1000, 1000, (4 * BLOCK, 3))
    wide = rng.uniform(-9, 9, (20 * BLOCK, 3))
    near = rng.uniform(-0.09, 0.09, (30 * BLOCK + 77, 3))
    points = rng.permutation(np.concatenate([far, wide, near])).astype(np.float32)
    points[::97, 1] = np.nan
    points[1::97] = points[2::97]  # ties, whose lowest row wins
    return points
