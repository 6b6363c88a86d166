"""Worlds, poses and an index map for the tests of gradients, and the same formulas in NumPy."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from depthwarp.sim.se3 import se3_exp

WORLDS, CAMERAS, ROWS, COLUMNS, POINTS, STATIC = 2, 2, 5, 4, 6, 5
LENS = (50.0, 40.0, 1.5, 2.0)


class Scene(NamedTuple):
    """What winners depend on, float64."""

    points: Any
    static_map: Any
    poses: Any
    intrinsics: Any


def make_scene(seed: int = 0) -> Scene:
    """Points some metres ahead of slightly turned cameras, each with a lens of its own."""
    rng = np.random.default_rng(seed)
    ahead = np.array([0.0, 0.0, 6.0])
    return Scene(
        ahead + rng.normal(size=(WORLDS, POINTS, 3)),
        ahead + rng.normal(size=(STATIC, 3)),
        se3_exp(0.2 * rng.normal(size=(WORLDS, CAMERAS, 6))),
        LENS + rng.uniform(0, 1, (WORLDS, CAMERAS, 4)),
    )


def make_index(seed: int = 0) -> Any:
    """Winners of both kinds, some of more than one pixel, and empty pixels."""
    rng = np.random.default_rng(seed)
    index = rng.integers(-1, STATIC + POINTS, (WORLDS, CAMERAS, ROWS, COLUMNS))
    index[0, 0, 0, :3] = -1, 0, STATIC
    return index.astype(np.int32)


def expected(scene: Scene, index: Any, kind: str) -> tuple[Any, Any]:
    """Depth and (u, v) of the winners, pixel by pixel, float64."""
    depth, uv = np.zeros(index.shape), np.zeros((*index.shape, 2))
    for pixel in np.argwhere(index >= 0):
        world, camera, row, column = pixel
        i = index[tuple(pixel)]
        point = scene.static_map[i] if i < STATIC else scene.points[world, i - STATIC]
        x, y, z, _ = scene.poses[world, camera] @ np.append(point, 1.0)
        fx, fy, cx, cy = scene.intrinsics[world, camera]
        depth[tuple(pixel)] = z if kind == "z" else np.sqrt(x * x + y * y + z * z)
        uv[world, camera, row, column] = cx + fx * x / z, cy + fy * y / z
    return depth, uv


def seeds_of(index: Any, seed: int = 1) -> tuple[Any, Any]:
    """Random weights of each pixel's depth and position."""
    rng = np.random.default_rng(seed)
    return rng.normal(size=index.shape), 0.1 * rng.normal(size=(*index.shape, 2))


@cache
def expected_gradients(kind: str, step: float = 1e-6) -> Scene:
    """Central differences of the weighted sum of `expected` by each number of the scene."""
    scene, index = make_scene(), make_index()
    by_depth, by_uv = seeds_of(index)

    def total(changed: Scene) -> float:
        depth, uv = expected(changed, index, kind)
        return float((by_depth * depth).sum() + (by_uv * uv).sum())

    gradients = []
    for name, values in scene._asdict().items():
        gradient = np.zeros(values.shape)
        for place in np.ndindex(values.shape):
            moved = [values.copy(), values.copy()]
            moved[0][place] += step
            moved[1][place] -= step
            ahead, behind = (total(scene._replace(**{name: value})) for value in moved)
            gradient[place] = (ahead - behind) / (2 * step)
        gradients.append(gradient)
    return Scene(*gradients)
