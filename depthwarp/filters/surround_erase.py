"""Erasing pixels that nearer ones surround, each within the spacing of its own surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import warp as wp

from depthwarp import arrays
from depthwarp.filters.maps import DeviceMaps
from depthwarp.filters.pyramid import PYRAMID_BYTES, Pyramid
from depthwarp.filters.rows import row_launch
from depthwarp.filters.sectors import device_sectors
from depthwarp_kernels import filters_spacing as spacings
from depthwarp_kernels.filters_hidden import erase_surrounded, erase_thinned

__all__ = ["SurroundErase"]


@dataclass(frozen=True)
class SurroundErase:
    """Erase by surrounding: a pixel p goes if nearer pixels stand round it on all sides.

    A pixel q hides towards p if it is nearer by more than 0.02 m + 0.002 z_p + 0.5 d g, with d the
    distance of the two [px] and g the metres between neighbouring pixels at q's depth
    (`Camera.pixel_pitch`), if d is at most 2.5 times q's own spacing S, or 1.5 px where S is 1, and
    if S is at most 6 times that of p and not 1 for both. S is the radius of the smallest square
    ring [px] that holds 4 pixels of q's layer: within 0.03 m + r g of its depth, r px away. A q
    with S above 8 times the view's median (from 16 to 32 px) is isolated and hides nothing. p goes
    when the directions of what hides leave no run of more than 11 of 32 sectors empty: what lies on
    one side of a straight line leaves 15 at least. Then a pixel goes, too, whose S, at most 22, has
    become 1.5 times what it was, or more: of a surface that is hidden most went before.

    The distance term spares slanted surfaces, the sectors true edges, and the spacing makes the
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
        device = maps.depth.device
        _, rows, columns = maps.depth.shape
        runs = -(-columns // spacings.RUN)
        erased = arrays.empty(pyramid.words.shape, wp.uint32, device)
        kept = int(self.keep_depth)
        written = [maps.depth, maps.index, maps.state]
        erase = row_launch(
            erase_surrounded,
            maps,
            [pyramid.cells, pyramid.spacing, device_sectors(device), maps.grids, kept],
            [*written, pyramid.words, erased],
            (rows, runs),
        )
        mark = row_launch(
            spacings.mark_thinned,
            maps,
            [maps.depth, pyramid.words, erased, maps.grids],
            [pyramid.spacing],
            (rows, runs),
        )
        erase_more = row_launch(
            erase_thinned, maps, [pyramid.spacing, kept], written, pyramid.words.shape[1:]
        )

        def step() -> None:
            pyramid.build()
            erased.zero_()
            erase()
            mark()
            erase_more()

        return step
