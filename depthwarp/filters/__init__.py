"""Filters after the splat: hidden-point removal and filling, one after another."""

from depthwarp.filters.chain import apply, check_filters, paper
from depthwarp.filters.dilation import Dilation, dilate
from depthwarp.filters.hidden import PaperErase, remove_hidden
from depthwarp.filters.maps import DeviceMaps, Filter

__all__ = [
    "DeviceMaps",
    "Dilation",
    "Filter",
    "PaperErase",
    "apply",
    "check_filters",
    "dilate",
    "paper",
    "remove_hidden",
]
