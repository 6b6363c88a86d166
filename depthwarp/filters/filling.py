"""Filling empty pixels: the methods by name."""

from __future__ import annotations

from typing import Literal

from depthwarp.checks import check_choice
from depthwarp.filters.maps import Filter
from depthwarp.filters.nearest_fill import NearestFill
from depthwarp.filters.options import check_options
from depthwarp.filters.plane_fill import PlaneFill
from depthwarp.filters.push_pull_fill import PushPullFill

__all__ = ["fill"]


def fill(
    method: Literal["plane", "nearest", "push_pull"] = "plane", *, radius: int | None = None
) -> Filter:
    """A filter that fills empty and erased pixels; what was measured stays as it is.

    The default is `"plane"`, which `best()` uses, too.

    Args:
        method: `"plane"`: planes through the nearest layer that surrounds the pixel, see
            `PlaneFill`. `"nearest"`: the nearest pixel of the image, see `NearestFill`.
            `"push_pull"`: averages of ever larger areas, see `PushPullFill`.
        radius: Of `"nearest"`: how far that pixel may be [px], at most 1024; 10 when None.

    Raises:
        InputError: An unknown method, an option of another method, or a value out of its range.
    """
    check_choice("method", method, ("plane", "nearest", "push_pull"))
    options = check_options(method, {"radius": radius}, ("radius",) if method == "nearest" else ())
    if method == "nearest":
        return NearestFill(**options)
    return PlaneFill() if method == "plane" else PushPullFill()
