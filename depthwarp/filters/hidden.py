"""Erasing points that are seen through the gaps of a nearer surface: the methods by name."""

from __future__ import annotations

from typing import Literal

from depthwarp.checks import check_choice
from depthwarp.filters.cone_erase import ConeErase
from depthwarp.filters.maps import Filter
from depthwarp.filters.options import check_options, check_truth
from depthwarp.filters.paper_erase import PaperErase
from depthwarp.filters.surround_erase import SurroundErase

__all__ = ["remove_hidden"]


def remove_hidden(
    method: Literal["paper", "surround", "cone"] = "paper",
    *,
    side: int | None = None,
    threshold: float | None = None,
    radius: int | None = None,
    angle: float | None = None,
    keep_depth: bool = False,
) -> Filter:
    """A filter that erases points seen through the gaps of a nearer surface.

    The default is the paper's method, so that `remove_hidden()` and `dilate()` are `paper()`;
    `best()` uses `"surround"`.

    Args:
        method: `"surround"`: a pixel goes if it lies in the gaps of nearer surfaces, which stand
            round it on all sides, or is a stray; needs no setting; see `SurroundErase`.
            `"cone"`: a pixel goes if it sees too little of what lies towards the camera; see
            `ConeErase`. `"paper"`: section 3.4, with "a neighbourhood area of 10 px" read as a
            window of side 10; `side=21` is the other reading (a radius of 10); see `PaperErase`.
        side: Of `"paper"`: side of the square window [px]; 10 when None.
        threshold: Of `"paper"`: depth difference above which the farther pixel is erased [m]; 0.5
            when None.
        radius: Of `"cone"`: how far a pixel looks round [px], at most 31; 10 when None.
        angle: Of `"cone"`: half the opening of the cone that has to be free [degrees]; 30 when
            None.
        keep_depth: Whether an erased pixel keeps its depth and index. Its state is ERASED either
            way, and for later filters it is empty; but `DepthMap.depth` then holds its depth, which
            files and plots show: mask with `state` where that is not wanted.

    Raises:
        InputError: An unknown method, an option of another method, or a value out of its range.
    """
    check_choice("method", method, ("paper", "surround", "cone"))
    given = {
        "side": side,
        "threshold": threshold,
        "radius": radius,
        "angle": angle,
        "keep_depth": check_truth("keep_depth", keep_depth),
    }
    if method == "paper":
        return PaperErase(**check_options(method, given, ("side", "threshold", "keep_depth")))
    if method == "cone":
        return ConeErase(**check_options(method, given, ("radius", "angle", "keep_depth")))
    return SurroundErase(**check_options(method, given, ("keep_depth",)))
