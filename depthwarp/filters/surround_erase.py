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
from depthwarp_kernels.filters_surround import erase_surrounded, erase_thinned

__all__ = ["SurroundErase"]


@dataclass(frozen=True)
class SurroundErase:
    """Erase by surrounding: a pixel p goes if nearer pixels stand closely round it on all sides.

    Every pixel q stands for its surface up to E px round it. E is its own spacing S, the radius
    of the smallest square ring [px] that holds 4 pixels of q's layer: within 0.03 m + r g of its
    depth, r px away, g the metres between neighbouring pixels there (`Camera.pixel_pitch`); and
    0.6 S where those 4 lie along a line: their directions, angles doubled, add up to over 3.4. q
    hides towards p, d px away, if it is nearer by more than 0.02 m + 0.002 z_p + 0.5 d g, if d is
    at most 3 E, or 1.5 px where S is 1, and if S is at most 12 px or 6 times that of p, and not 1
    for both. A q with S above 8 times the view's median (from
    16 to 32 px) is isolated and hides nothing.

    p goes when the directions of what hides leave no longer run of 32 sectors empty than 14, and
    when that run + 8 w is at most 23.5; 19.5 where p's own companions lie along a line. w is the
    width of the gap: of two hiding pixels in octants 3 to 5 apart, so over 90 degrees, the
    least sum of (d - 0.5) / E, or of d where S is 1. What lies on one side of a straight line
    leaves a run of 15 at least. Then a pixel goes, too, whose S, at most 22, has become 1.5 times
    what it was, or more: of a surface that is hidden most went before.

    The distance term spares slanted surfaces, the sectors true edges, the gap what is seen through
    windows, and the spacing makes the reach fit the density of every surface. The numbers were
    chosen on simulated scans of analytic scenes, see `benchmarks/quality`. Of every area of 1, 2,
    4, 8 and 16 px a side only the nearest pixel is looked at, in 3 x 3 areas of each size. Images
    of a full turn go round.

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
