"""Solids that stand together, and the first of them along any ray."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import warp as wp

from benchmarks.quality import cast_kernels
from benchmarks.quality.solids import Solid
from depthwarp.errors import InputError
from depthwarp.threads import thread_pool

__all__ = ["Hits", "World"]

Float64Array = npt.NDArray[np.float64]

BOUNDS_SLACK_M = 1e-3
"""The tree's boxes are float32: they are made larger than the solids by this and a millionth."""


class Hits(NamedTuple):
    """What rays met first.

    Attributes:
        distance: Along the ray, in units of its direction's length, inf where nothing is met; (N,).
        solid: Which solid, -1 where nothing is met, shape (N,).
        normal: Its outward unit normal there, world frame, shape (N, 3).
    """

    distance: Float64Array
    solid: npt.NDArray[np.int32]
    normal: Float64Array


class World:
    """Solids that stop rays, in a tree of their bounding boxes; all arithmetic in float64.

    Args:
        solids: What stands there; at least one.

    Raises:
        InputError: No solid.
    """

    def __init__(self, solids: Sequence[Solid]) -> None:
        if not solids:
            raise InputError("a world must hold at least one solid")
        center = np.array([solid.center for solid in solids], dtype=np.float64)
        reach = np.array([solid.reach() for solid in solids], dtype=np.float64)
        reach += BOUNDS_SLACK_M + 1e-6 * (np.abs(center) + reach)
        self._tree = wp.Bvh(_array(center - reach, wp.vec3f), _array(center + reach, wp.vec3f))
        self._solids: Any = cast_kernels.Solids()
        self._solids.kind = _array([int(solid.kind) for solid in solids], wp.int32)
        self._solids.center = _array(center, wp.vec3d)
        self._solids.half = _array([solid.half for solid in solids], wp.vec3d)
        self._solids.axes = _array([solid.axes for solid in solids], wp.mat33d)

    def cast(self, origins: npt.ArrayLike, directions: npt.ArrayLike) -> Hits:
        """Find the first surface along each ray; a ray that starts inside a solid misses that one.

        Args:
            origins: Ray starts, world frame [m], shape (N, 3), or (3,) for one that all share.
            directions: Of any length but 0, world frame, shape (N, 3).
        """
        rays = _array(directions, wp.vec3d)
        starts = _array(np.atleast_2d(np.asarray(origins, dtype=np.float64)), wp.vec3d)
        count = len(rays)
        outputs = [wp.empty(count, dtype=kind, device="cpu") for kind in OUTPUT_KINDS]
        threads = os.cpu_count() or 1
        bounds = np.linspace(0, count, 8 * threads + 1).astype(int)

        def run(part: int) -> None:
            inputs = [self._tree.id, self._solids, starts, rays, int(bounds[part])]
            dim = int(bounds[part + 1] - bounds[part])
            wp.launch(cast_kernels.cast_rays, dim=dim, inputs=inputs, outputs=outputs, device="cpu")

        wp.load_module(cast_kernels, device="cpu")
        list(thread_pool(threads).map(run, range(8 * threads)))
        distance, solid, normal = (array.numpy() for array in outputs)
        return Hits(distance, solid, normal)

    def sees(self, origin: npt.ArrayLike, points: Float64Array, tolerance: float) -> Hits:
        """Cast rays from one place to points, shape (N, 3): distance 1 is the point itself.

        Args:
            origin: Where the rays start, world frame [m], shape (3,).
            points: Where they lead, world frame [m].
            tolerance: Only what is nearer than the point by more than this stops a ray [m].

        Returns:
            What each ray met; the distance is exactly 1 for what lies within the tolerance.
        """
        ways = points - np.asarray(origin, dtype=np.float64)
        hits = self.cast(origin, ways)
        near = np.abs(hits.distance - 1) * np.linalg.norm(ways, axis=1) <= tolerance
        hits.distance[near] = 1.0
        return hits


OUTPUT_KINDS = (wp.float64, wp.int32, wp.vec3d)


def _array(values: npt.ArrayLike, dtype: Any) -> Any:
    kind = np.int32 if dtype is wp.int32 else None
    return wp.array(np.asarray(values, dtype=kind), dtype=dtype, device="cpu")
