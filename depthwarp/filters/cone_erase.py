"""Erasing pixels that see too little of what lies towards the camera."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import warp as wp

from depthwarp import arrays
from depthwarp.checks import check_positive, check_window
from depthwarp.errors import InputError
from depthwarp.filters.maps import DeviceMaps
from depthwarp.filters.options import check_truth
from depthwarp.filters.rows import row_launch
from depthwarp.filters.sectors import device_sectors
from depthwarp_kernels.filters_cone import REACH, copy_present, erase_by_cone

__all__ = ["ConeErase"]


@dataclass(frozen=True)
class ConeErase:
    """Erase by free solid angle: a pixel goes if less is free before it than a cone would be.

    In each of 8 sectors the neighbour that stands highest towards the camera, as seen from the
    pixel, bounds what is free; neighbours nearer by 2 cm or less do not count. After R. Pintus,
    E. Gobbetti, M. Agus, "Real-time rendering of massive unstructured raw point clouds using
    screen-space operators", VAST 2011. Images of a full turn go round.

    Attributes:
        radius: How far a pixel looks round [px], at most 31.
        angle: Half the opening of the cone about the viewing ray whose solid angle has to be free
            [degrees].
        keep_depth: Whether an erased pixel keeps its depth and index.
    """

    radius: int = 10
    angle: float = 30.0
    keep_depth: bool = False

    scratch_bytes = 4
    margin = 0.02

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", check_window("radius", self.radius, REACH))
        check_positive("angle", self.angle, "degrees")
        if self.angle >= 90:
            raise InputError(f"angle must be below 90 degrees, got {self.angle}")
        object.__setattr__(self, "keep_depth", check_truth("keep_depth", self.keep_depth))

    def build(self, maps: DeviceMaps) -> Callable[[], None]:
        """Allocate a copy of the depth and return the step; see `Filter.build`."""
        depth = maps.depth
        before = arrays.empty(depth.shape, wp.float32, depth.device)
        copy = row_launch(copy_present, maps, [depth, maps.state], [before])
        least_free = 1 - math.cos(math.radians(self.angle))
        numbers = [self.radius, least_free, self.margin, int(self.keep_depth)]
        erase = row_launch(
            erase_by_cone,
            maps,
            [before, device_sectors(depth.device), maps.grids, *numbers],
            [depth, maps.index, maps.state],
        )

        def step() -> None:
            copy()
            erase()

        return step
