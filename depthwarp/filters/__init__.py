"""Filters after the splat: hidden-point removal and filling, one after another."""

from depthwarp.filters.applying import apply
from depthwarp.filters.chain import best, check_filters, paper
from depthwarp.filters.cone_erase import ConeErase
from depthwarp.filters.dilation import Dilation, dilate
from depthwarp.filters.filling import fill
from depthwarp.filters.hidden import remove_hidden
from depthwarp.filters.maps import DeviceMaps, Filter
from depthwarp.filters.nearest_fill import NearestFill
from depthwarp.filters.paper_erase import PaperErase
from depthwarp.filters.plane_fill import PlaneFill
from depthwarp.filters.push_pull_fill import PushPullFill
from depthwarp.filters.surround_erase import SurroundErase

__all__ = [
    "ConeErase",
    "DeviceMaps",
    "Dilation",
    "Filter",
    "NearestFill",
    "PaperErase",
    "PlaneFill",
    "PushPullFill",
    "SurroundErase",
    "apply",
    "best",
    "check_filters",
    "dilate",
    "fill",
    "paper",
    "remove_hidden",
]
