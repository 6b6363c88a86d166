"""Points on a device, of a plain cloud or a prepared one, as the splat takes them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import warp as wp

from depthwarp.prepared import PreparedCloud
from depthwarp_kernels import packed_points, point_source

__all__ = ["Points", "points_of"]


@dataclass(frozen=True)
class Points:
    """Points that a splat draws.

    Attributes:
        source: What kernels have to know of them at compile time.
        arrays: The source's struct.
        count: Points that can be drawn.
        whole_blocks: Blocks that a kernel may read to their end.
        not_finite: Points that were left out because a coordinate is not finite.
    """

    source: point_source.PointSource
    arrays: Any
    count: int
    whole_blocks: int
    not_finite: int = 0

    @property
    def block_arrays(self) -> list[Any]:
        """Coordinates, boxes, original rows and plain points, as the kernel for blocks wants."""
        own, box = self.arrays, _unused(packed_points.PackedBlock)
        if self.source is point_source.PREPARED:
            return [own.x, own.y, own.z, box, own.original, _unused(wp.vec3f)]
        if self.source is packed_points.PACKED:
            words = [own.first, own.second, own.third]
            return [*words, own.boxes, own.original, _unused(wp.vec3f)]
        apart = _unused(wp.float32)
        return [apart, apart, apart, box, _unused(wp.int32), own.points_world]

    @property
    def total(self) -> int:
        """All points of the cloud."""
        return self.count + self.not_finite


@cache
def _unused(dtype: Any) -> Any:
    """An array in the place of one that a kernel does not read; the kernel wants none empty."""
    return wp.zeros(1, dtype=dtype, device="cpu")


def points_of(cloud: Any) -> Points:
    """Points of a prepared cloud, or of a `wp.array` of `wp.vec3f`, shape (N,)."""
    if isinstance(cloud, PreparedCloud):
        return Points(cloud.kind, cloud.source, cloud.finite, cloud.blocks, cloud.not_finite)
    plain: Any = point_source.PlainPoints()
    plain.points_world = cloud
    count = cloud.shape[0]
    return Points(point_source.PLAIN, plain, count, count // point_source.BLOCK)
