"""Erasing pixels that nearer ones surround, each within the spacing of its own surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from depthwarp.filters.maps import DeviceMaps
from depthwarp.filters.pyramid import PYRAMID_BYTES, Pyramid
from depthwarp.filters.rows import row_launch
from depthwarp.filters.sectors import device_sectors
from depthwarp_kernels.filters_hidden import RUN, erase_surrounded

__all__ = ["SurroundErase"]


@dataclass(frozen=True)
class SurroundErase:
    """Erase by surrounding: a pixel p goes if nearer pixels stand round it on all sides.

    A pixel q hides towards p if it is nearer by more than 0.02 m + 0.002 z_p + d g, with d the
    distance of the two [px] and g the metres between neighbouring pixels at q's depth
    (`Camera.pixel_pitch`), if d is at most 2.5 times q's own spacing S, or 1.5 px where S is 1, and
    if S is at most 6 times that of p and not 1 for both. S is the radius of the smallest square
    ring [px] that holds 4 pixels of q's layer: within 0.03 m + r g of its depth, r px away. A q
    with S above 8 times the view's median (from 16 to 32 px) is isolated and hides nothing. p goes
    when the directions of what hides leave no run of more than 6 of 16 sectors empty: what lies on
    one side of a straight line leaves 7 at least.

    The distance terms spare slanted surfaces, the sectors true edges, and the spacing makes the
    reach fit the density of every surface. The numbers were chosen on simulated scans of analytic
    scenes, see `benchmarks/quality`. Of every area of 1, 2, 4, 8 and 16 px a side only the nearest
    pixel is looked at, in 3 x 3 areas of each size. Images of a full turn go round.

    Attributes:
        keep_depth: Whether an erased pixel keeps its depth and index.
    """

    keep_depth: bool = False

    scratch_bytes = PYRAMID_BYTES

    def build(self, maps: DeviceMaps) -> Callable[[], None]:
        """Allocate the pyramid and return the step; see `Filter.build`."""
        pyramid = Pyramid(maps)
        _, rows, columns = maps.depth.shape
        erase = row_launch(
            erase_surrounded,
            maps,
            [
                pyramid.cells,
                pyramid.spacing,
                device_sectors(maps.depth.device),
                maps.grids,
                int(self.keep_depth),
            ],
            [maps.depth, maps.index, maps.state],
            (rows, -(-columns // RUN)),
        )

        def step() -> None:
            pyramid.build()
            erase()

        return step
