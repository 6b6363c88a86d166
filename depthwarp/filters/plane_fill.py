"""Filling with planes through the layers that surround an empty pixel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from depthwarp.filters.maps import DeviceMaps
from depthwarp.filters.pyramid import PYRAMID_BYTES, Pyramid
from depthwarp.filters.rows import row_launch
from depthwarp.filters.sectors import device_sectors
from depthwarp.filters.surround_erase import SurroundStep
from depthwarp_kernels.filters_fill import fill_planes

__all__ = ["PlaneFill"]


@dataclass(frozen=True)
class PlaneFill:
    """Layered plane fill: an empty pixel takes the nearest surface that surrounds it.

    Samples of a block of pixels are those whose reach, 1.5 times their own spacing S (see
    `SurroundErase`), covers its middle; of every area of 1 to 16 px a side only the nearest pixel
    is looked at, from small areas to large ones until there are 4 samples. A layer is the nearest
    sample and all within 0.03 m + 4 d g behind it, d px from it, g the metres between neighbouring
    pixels there. Of three layers, from the nearest on, the first is taken whose directions leave no
    run of more than 18 of 32 sectors empty. Through its sample closest in the image, and all so
    little before or behind that one, a plane 1/z = a + b u + c v is fitted with weights
    1 / (d^2 + 0.25 px^2). Its depth, kept within half the samples' range of them, is written as
    FILLED.

    What no layer surrounds takes, as FILLED_BORDER, such a plane through the closest of the samples
    that are at most their own S away. It stays empty without one; and where a mistake would be
    likely and large: if d / S of that sample times the range of all samples' depths is above 0.16
    of the largest, unless it is beside the pixels. The index is that of the closest sample.

    A block of 4 x 4 is filled as one where all its samples, which reach 1.5 px farther then, are
    one layer that surrounds it. Else each 2 x 2 of it is filled by itself. Isolated pixels are no
    samples. Images of a full turn go round, with the limit of `SurroundErase` beside the seam.
    The numbers were chosen on simulated scans of analytic scenes, see `benchmarks/quality`.
    """

    scratch_bytes = PYRAMID_BYTES

    def build(self, maps: DeviceMaps) -> Callable[[], None]:
        """Allocate the pyramid and return the step; see `Filter.build`."""
        pyramid = Pyramid(maps)
        return _fill_step(maps, pyramid, pyramid.reading(extents=False))

    def build_after(self, erase: SurroundStep) -> Callable[[], None]:
        """The same step for right after another, whose pyramid it goes on with."""
        return _fill_step(erase.maps, erase.pyramid, erase.pyramid.leaving_out(erase.erased))


def _fill_step(maps: DeviceMaps, pyramid: Pyramid, build: Callable[[], None]) -> Callable[[], None]:
    _, rows, columns = maps.depth.shape
    blocks = -(-rows // 4), -(-columns // 4)
    fill = row_launch(
        fill_planes,
        maps,
        [pyramid.words, pyramid.cells, device_sectors(maps.depth.device), maps.grids],
        [maps.depth, maps.index, maps.state],
        blocks,
    )

    def step() -> None:
        build()
        fill()

    return step
