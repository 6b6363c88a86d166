"""Erasing points that are seen through the gaps of a nearer surface."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import warp as wp

from depthwarp import arrays
from depthwarp.checks import check_choice, check_positive, check_window
from depthwarp.filters.maps import DeviceMaps, Filter
from depthwarp_kernels.filters import erase_by_column, erase_row_minimum

__all__ = ["PaperErase", "remove_hidden"]


@dataclass(frozen=True)
class PaperErase:
    """The paper's erase, section 3.4: a pixel goes if some pixel of its window is much nearer.

    Attributes:
        side: Side of the square window [px]; an even one leans as OpenCV's default anchor does,
            columns u - side / 2 to u + side / 2 - 1, rows likewise.
        threshold: A pixel is erased when it is farther than another one by more than this [m].
    """

    side: int = 10
    threshold: float = 0.5

    scratch_bytes = 4

    def __post_init__(self) -> None:
        check_window("side", self.side)
        check_positive("threshold", self.threshold, "m")

    def build(self, maps: DeviceMaps) -> Callable[[], None]:
        """Allocate the row minima and return the step; see `Filter.build`."""
        depth = maps.depth
        row_nearest = arrays.empty(depth.shape, wp.float32, depth.device)

        def erase() -> None:
            wp.launch(
                erase_row_minimum,
                dim=depth.shape,
                inputs=[depth, self.side],
                outputs=[row_nearest],
                device=depth.device,
            )
            wp.launch(
                erase_by_column,
                dim=depth.shape,
                inputs=[row_nearest, self.side, self.threshold],
                outputs=[depth, maps.index, maps.state],
                device=depth.device,
            )

        return erase


def remove_hidden(
    method: Literal["paper"] = "paper", *, side: int = 10, threshold: float = 0.5
) -> Filter:
    """A filter that erases points seen through the gaps of a nearer surface.

    Args:
        method: `"paper"`: section 3.4, with "a neighbourhood area of 10 px" read as a window of
            side 10; `side=21` is the other reading (a radius of 10).
        side: Side of the square window [px].
        threshold: Depth difference above which the farther pixel is erased [m].

    Raises:
        InputError: An unknown method, a side below 1, or a threshold that is not above 0.
    """
    check_choice("method", method, ("paper",))
    return PaperErase(side, threshold)
