"""What is rendered of a view: depth kind, range bounds, filters."""

from __future__ import annotations

import math
from dataclasses import dataclass

from depthwarp.cameras import DepthKind
from depthwarp.checks import check_choice, is_number
from depthwarp.errors import InputError
from depthwarp.filters import Filter

__all__ = ["RenderConfig"]


@dataclass(frozen=True)
class RenderConfig:
    """Settings that all views of a plan share.

    Attributes:
        depth: `"range"` (Euclidean) or `"z"` (along the optical axis).
        min_range: Nearer points are not drawn [m]; bounds the kind that is rendered.
        max_range: Farther points are not drawn [m]; infinity for no bound.
        filters: Applied in order after the splat.

    Raises:
        InputError: An unknown kind, or bounds that are not numbers 0 <= min_range < max_range.
    """

    depth: DepthKind = "range"
    min_range: float = 0.0
    max_range: float = 15.0
    filters: tuple[Filter, ...] = ()

    def __post_init__(self) -> None:
        check_choice("depth", self.depth, ("range", "z"))
        for name, bound in (("min_range", self.min_range), ("max_range", self.max_range)):
            if not is_number(bound):
                raise InputError(f"{name} must be a number [m], got {bound!r}")
        if math.isnan(self.max_range) or not 0 <= self.min_range < self.max_range:
            raise InputError(
                "min_range and max_range must be 0 <= min_range < max_range [m], "
                f"got {self.min_range} and {self.max_range}"
            )
