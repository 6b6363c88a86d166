"""The paper's erase of hidden points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import warp as wp

from depthwarp import arrays
from depthwarp.checks import check_positive, check_window
from depthwarp.filters.maps import DeviceMaps
from depthwarp.filters.options import check_truth
from depthwarp.filters.rows import row_launch
from depthwarp_kernels.filters import erase_by_column, erase_row_minimum

__all__ = ["PaperErase"]


@dataclass(frozen=True)
class PaperErase:
    """The paper's erase, section 3.4: a pixel goes if some pixel of its window is much nearer.

    Attributes:
        side: Side of the square window [px]; an even one leans as OpenCV's default anchor does,
            columns u - side / 2 to u + side / 2 - 1, rows likewise.
        threshold: A pixel is erased when it is farther than another one by more than this [m].
        keep_depth: Whether an erased pixel keeps its depth and index.
    """

    side: int = 10
    threshold: float = 0.5
    keep_depth: bool = False

    scratch_bytes = 4

    def __post_init__(self) -> None:
        object.__setattr__(self, "side", check_window("side", self.side))
        check_positive("threshold", self.threshold, "m")
        object.__setattr__(self, "keep_depth", check_truth("keep_depth", self.keep_depth))

    def build(self, maps: DeviceMaps) -> Callable[[], None]:
        """Allocate the row minima and return the step; see `Filter.build`."""
        depth = maps.depth
        row_nearest = arrays.empty(depth.shape, wp.float32, depth.device)
        find = row_launch(erase_row_minimum, maps, [depth, maps.state, self.side], [row_nearest])
        erase = row_launch(
            erase_by_column,
            maps,
            [row_nearest, self.side, self.threshold, int(self.keep_depth)],
            [depth, maps.index, maps.state],
        )

        def step() -> None:
            find()
            erase()

        return step
