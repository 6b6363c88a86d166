"""Erasing pixels that nearer ones surround, each as far as it stands for its surface; strays."""

from __future__ import annotations

from dataclasses import dataclass

import warp as wp

from depthwarp import arrays
from depthwarp.filters.maps import DeviceMaps
from depthwarp.filters.options import check_truth
from depthwarp.filters.pyramid import PYRAMID_BYTES, Pyramid
from depthwarp.filters.rows import row_launch
from depthwarp.filters.sectors import device_sectors
from depthwarp_kernels.filters_spacing import RUN
from depthwarp_kernels.filters_strays import add_strays
from depthwarp_kernels.filters_surround import erase_marked, find_freedom, mark_hidden

__all__ = ["SurroundErase", "SurroundStep"]

FREEDOM_BYTES = 2
"""Working memory a pixel beside the pyramid: its freedom, and bits."""


@dataclass(frozen=True)
class SurroundErase:
    """Erase by surrounding: a pixel goes if it lies in the gaps of nearer surfaces.

    **Spacing S** of a pixel: the radius of the smallest square ring [px], up to 32, that holds 4
    pixels of its layer, its companions: within 0.025 m + r g of its depth, r px away, g the metres
    between neighbouring pixels there (`Camera.pixel_pitch`).

    **Extent E** of a pixel, how far it stands for its surface: S. Companions lie along a line if
    their directions, angles doubled, add up to over 3.2. Then E is the way to the farther of two
    companions off the line, by 30 degrees, one on each side and at most 12 px away; without such,
    half of S, and the pixel is of a line: a pole or a wire.

    **Hiding.** q hides towards p, d px away, if it is nearer by more than
    0.02 m + 0.004 z_p + 0.5 d g, if d is at most 3 E, or 1.5 px where S is 1, and if S is at most
    12 px or 6 times that of p, and not 1 for both. A q with S above 8 times the view's median
    (from 16 to 32 px) is isolated and hides nothing. Of every area of 1, 2, 4, 8 and 16 px a side
    only the nearest pixel is looked at, in 3 x 3 areas of each size.

    **Freedom** of p: n + 8 w, and 6 more if p is of a line; at most 27, and 27 where n is above 14.
    n is the longest run of 32 sectors round p in which nothing hides: what lies on one side of a
    straight line leaves 15 at least. w is the width of the gap that p lies in: of two that hide, in
    octants 3 to 5 apart, so over 90 degrees, the least sum of (d - 0.5) / E, or of d where S is 1.

    p goes when its own freedom and the mean of its companions' is below 24.75 in the mean: of a
    hidden surface nearly all pixels are hidden. The distance term spares slanted surfaces, the
    sectors true edges, the gap what is seen through windows, and the spacing fits the reach to the
    density of every surface.

    **Strays**, such as the mixed pixels that a scanner measures at edges, go too: pixels with 12
    others, none of them hidden, in nearer rings than their nearest companion, which may be hidden;
    but none that is of a line or has no 4 companions, as one alone.

    The numbers were chosen on simulated scans of analytic scenes, see `benchmarks/quality`. Images
    of a full turn go round; where their width is no multiple of 16 px, the last areas are narrower,
    and beside the seam pixels look less far.

    Attributes:
        keep_depth: Whether an erased pixel keeps its depth and index.
    """

    keep_depth: bool = False

    scratch_bytes = PYRAMID_BYTES + FREEDOM_BYTES

    def __post_init__(self) -> None:
        object.__setattr__(self, "keep_depth", check_truth("keep_depth", self.keep_depth))

    def build(self, maps: DeviceMaps) -> SurroundStep:
        """Allocate the pyramid and return the step; see `Filter.build`."""
        return SurroundStep(maps, self.keep_depth)


class SurroundStep:
    """The step of a `SurroundErase`.

    Args:
        maps: The maps that it works on.
        keep_depth: Whether an erased pixel keeps its depth and index.

    Attributes:
        pyramid: What it found of the maps, without what it erased.
        erased: Which pixels it erased, of the shape of `pyramid.words`, uint32.
    """

    def __init__(self, maps: DeviceMaps, keep_depth: bool) -> None:
        self.maps = maps
        self.pyramid = pyramid = Pyramid(maps)
        device = maps.depth.device
        _, rows, columns = maps.depth.shape
        runs = rows, -(-columns // RUN)
        freedom = arrays.empty(maps.depth.shape, wp.uint8, device)
        self._doubtful = arrays.empty(pyramid.words.shape, wp.uint32, device)
        self._hidden = arrays.empty(pyramid.words.shape, wp.uint32, device)
        self.erased = arrays.empty(pyramid.words.shape, wp.uint32, device)
        self._build = pyramid.reading(extents=True)
        self._find = row_launch(
            find_freedom,
            maps,
            [maps.depth, pyramid.cells, pyramid.spacing, device_sectors(device), maps.grids],
            [freedom, self._doubtful],
            runs,
        )
        self._mark = row_launch(
            mark_hidden,
            maps,
            [maps.depth, pyramid.words, pyramid.spacing, freedom, self._doubtful, maps.grids],
            [self._hidden],
            runs,
        )
        self._add_strays = row_launch(
            add_strays,
            maps,
            [maps.depth, pyramid.words, pyramid.spacing, self._hidden, maps.grids],
            [self.erased],
            pyramid.words.shape[1:],
        )
        self._erase = row_launch(
            erase_marked,
            maps,
            [self.erased, int(keep_depth)],
            [maps.depth, maps.index, maps.state, pyramid.words],
            pyramid.words.shape[1:],
        )

    def __call__(self) -> None:
        """Erase what is hidden in the maps, and strays."""
        self._build()
        self._doubtful.zero_()
        self._hidden.zero_()
        self._find()
        self._mark()
        self._add_strays()
        self._erase()
