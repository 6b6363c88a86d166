"""What a scanner would have measured: points with noise, gaps and blunders, and what is true."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchmarks.quality.jumps import jumps
from benchmarks.quality.scenes import Scene
from benchmarks.quality.solids import Vector
from benchmarks.quality.world import Hits, World

__all__ = ["ELEVATION_DEG", "LEAST_INCIDENCE_DEG", "Scan", "scan"]

Float64Array = npt.NDArray[np.float64]

ELEVATION_DEG = (-60.0, 90.0)
LEAST_INCIDENCE_DEG = 3.0
"""A ray that meets a surface at a smaller angle gives no return."""

NOISE_M, NOISE_FAR_M, FAR_M = 0.003, 0.004, 20.0
"""Standard deviation of the range: 3 mm near the scanner, 4 mm from 20 m."""

DROP_OUTS = 0.02
MIXED_SHARE = 0.30  # of the jumps between neighbouring rays
STRAY_SHARE = 0.0005
NEAREST_STRAY_M = 0.5


@dataclass(frozen=True, eq=False)
class Scan:
    """A cloud whose truth is known.

    Attributes:
        points: What the scanner says, world frame [m], shape (N, 3), float32.
        exact: Where each point's ray truly ends, world frame [m], shape (N, 3), float64.
        bogus: Mixed pixels and strays, shape (N,): nothing is where they say.
    """

    points: npt.NDArray[np.float32]
    exact: Float64Array
    bogus: npt.NDArray[np.bool_]


def scan(scene: Scene, world: World, rays: int, dirty: bool = False, seed: int = 0) -> Scan:
    """Scan a scene from all its places.

    Args:
        scene: What to scan.
        world: Its solids.
        rays: Rays of all places together; fewer return.
        dirty: Whether range jumps give mixed pixels, and points stray.
        seed: Of the noise.
    """
    generator = np.random.default_rng([seed, rays, int(dirty)])
    parts = [
        _scan_from(place, scene.scanner_reach, world, rays // len(scene.scanners), dirty, generator)
        for place in scene.scanners
    ]
    return Scan(
        points=np.concatenate([part.points for part in parts]),
        exact=np.concatenate([part.exact for part in parts]),
        bogus=np.concatenate([part.bogus for part in parts]),
    )


def _scan_from(
    place: Vector,
    reach: float,
    world: World,
    rays: int,
    dirty: bool,
    generator: np.random.Generator,
) -> Scan:
    directions, shape = _directions(rays)
    hits = world.cast(place, directions)
    exact = _returns(hits, directions, reach)
    sigma = np.interp(exact, (0.0, FAR_M), (NOISE_M, NOISE_FAR_M))
    measured = exact + sigma * generator.standard_normal(len(exact))
    bogus = np.zeros(len(exact), dtype=bool)
    if dirty:
        mixed = _mixed(exact, hits, directions, shape, generator)
        bogus = ~np.isnan(mixed)
        measured = np.where(bogus, mixed, measured)
        stray = generator.random(len(exact)) < STRAY_SHARE
        free = np.where(np.isfinite(exact), exact, reach)
        distance = NEAREST_STRAY_M + generator.random(len(exact)) * (free - NEAREST_STRAY_M)
        measured[stray] = distance[stray]
        bogus |= stray
    kept = np.isfinite(measured) & (generator.random(len(exact)) >= DROP_OUTS)
    return Scan(
        points=(place + directions[kept] * measured[kept, None]).astype(np.float32),
        exact=place + directions[kept] * np.nan_to_num(exact[kept, None], posinf=reach),
        bogus=bogus[kept],
    )


def _directions(rays: int) -> tuple[Float64Array, tuple[int, int]]:
    """Unit vectors (N, 3) in equal steps of azimuth and elevation, and (elevations, azimuths)."""
    low, high = ELEVATION_DEG
    step = math.sqrt(360.0 * (high - low) / rays)
    shape = round((high - low) / step), round(360.0 / step)
    elevation = np.radians(low + (high - low) * (np.arange(shape[0]) + 0.5) / shape[0])[:, None]
    azimuth = (2 * math.pi * (np.arange(shape[1]) + 0.5) / shape[1])[None, :]
    level = np.cos(elevation)
    grid = np.broadcast_arrays(level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation))
    return np.stack(grid, axis=-1).reshape(-1, 3), shape


def _returns(hits: Hits, directions: Float64Array, reach: float) -> Float64Array:
    """Ranges [m], inf where nothing returns."""
    incidence = np.abs(np.einsum("ij,ij->i", hits.normal, directions))
    returns = (incidence >= math.sin(math.radians(LEAST_INCIDENCE_DEG))) & (hits.distance <= reach)
    return np.where(returns, hits.distance, np.inf)


def _mixed(
    exact: Float64Array,
    hits: Hits,
    directions: Float64Array,
    shape: tuple[int, int],
    generator: np.random.Generator,
) -> Float64Array:
    """Ranges of mixed pixels, NaN for the other rays.

    A beam that falls on two surfaces reports a range between them: at a share of the jumps to the
    next elevation or azimuth, the ray before the jump.
    """
    depth = np.where(np.isfinite(exact), exact, 0.0).reshape(shape)
    normal, rays = (values.reshape(*shape, 3) for values in (hits.normal, directions))
    mixed = np.full(shape, np.nan)
    for axis in (0, 1):
        following = np.roll(depth, -1, axis)
        chosen = jumps(depth, normal, rays, axis) & (depth > 0) & (following > 0)
        chosen &= generator.random(shape) < MIXED_SHARE
        between = depth + (following - depth) * generator.random(shape)
        mixed = np.where(chosen, between, mixed)
    return mixed.ravel()
