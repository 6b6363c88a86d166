"""Erasing points that are seen through the gaps of a nearer surface: the methods by name."""

from __future__ import annotations

from typing import Any, Literal

from depthwarp.checks import check_choice
from depthwarp.errors import InputError
from depthwarp.filters.cone_erase import ConeErase
from depthwarp.filters.maps import Filter
from depthwarp.filters.paper_erase import PaperErase
from depthwarp.filters.surround_erase import SurroundErase

__all__ = ["check_options", "remove_hidden"]


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

    Args:
        method: `"surround"`: a pixel goes if it lies in the gaps of nearer surfaces, which stand
            round it on all sides; needs no setting; see `SurroundErase`. `"cone"`: a pixel
            goes if it sees too little of what lies towards the camera; see `ConeErase`. `"paper"`:
            section 3.4, with "a neighbourhood area of 10 px" read as a window of side 10; `side=21`
            is the other reading (a radius of 10); see `PaperErase`.
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
    if keep_depth not in (True, False):
        raise InputError(f"keep_depth must be one of True, False, got {keep_depth!r}")
    given = {"side": side, "threshold": threshold, "radius": radius, "angle": angle}
    if method == "paper":
        options = check_options(method, given, ("side", "threshold"))
        return PaperErase(**options, keep_depth=keep_depth)
    if method == "cone":
        return ConeErase(**check_options(method, given, ("radius", "angle")), keep_depth=keep_depth)
    check_options(method, given, ())
    return SurroundErase(keep_depth)


def check_options(method: str, given: dict[str, Any], known: tuple[str, ...]) -> dict[str, Any]:
    """The options that were given, all of them known to the method.

    Raises:
        InputError: An option of another method.
    """
    options = {name: value for name, value in given.items() if value is not None}
    for name in options:
        if name not in known:
            raise InputError(
                f"method '{method}' has no {name}: "
                + (f"its options are {', '.join(known)}" if known else "it has no such option")
            )
    return options
