"""Growing pixels over the gaps between them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import warp as wp

from depthwarp import arrays
from depthwarp.checks import check_choice, check_window
from depthwarp.filters.maps import DeviceMaps, Filter
from depthwarp.filters.rows import row_launch
from depthwarp_kernels.filters import dilate_kernels

__all__ = ["Dilation", "dilate"]


@dataclass(frozen=True)
class Dilation:
    """Grey dilation by a square of ones, section 3.5.

    A pixel takes depth and index of its window's winner; if that is not the pixel itself, its
    state becomes FILLED. On equal depth the lowest index wins.

    Attributes:
        method: `"paper"`: the largest depth wins, the farther surface grows, as `cv2.dilate` does
            it on the 16-bit image. `"nearest"`: the smallest depth wins, the nearer surface grows.
        side: Side of the square window [px], anchored as in `cv2.dilate`.
    """

    method: Literal["paper", "nearest"] = "paper"
    side: int = 10

    scratch_bytes = 8

    def __post_init__(self) -> None:
        check_choice("method", self.method, ("paper", "nearest"))
        object.__setattr__(self, "side", check_window("side", self.side))

    def build(self, maps: DeviceMaps) -> Callable[[], None]:
        """Allocate the row winners and return the step; see `Filter.build`."""
        depth = maps.depth
        row_rank = arrays.empty(depth.shape, wp.uint64, depth.device)
        dilate_row, dilate_column = dilate_kernels(self.method == "nearest")

        rows = row_launch(dilate_row, maps, [depth, maps.index, maps.state, self.side], [row_rank])
        columns = row_launch(
            dilate_column, maps, [row_rank, self.side], [depth, maps.index, maps.state]
        )

        def grow() -> None:
            rows()
            columns()

        return grow


def dilate(method: Literal["paper", "nearest"] = "paper", *, side: int = 10) -> Filter:
    """A filter that grows pixels by a square window, section 3.5; see `Dilation`.

    Args:
        method: `"paper"` (the farther surface grows) or `"nearest"` (the nearer one grows).
        side: Side of the square window [px].

    Raises:
        InputError: An unknown method or a side that is no whole number from 1.
    """
    return Dilation(method, side)
