"""What a filter works on: the maps on the device, and the shape of a filter."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

__all__ = ["DeviceMaps", "Filter"]


@dataclass(frozen=True)
class DeviceMaps:
    """Depth maps on a device, shape (views, rows, columns); filters change them in place.

    Attributes:
        depth: Depth [m], `wp.float32`, 0 = empty.
        index: Winning point, `wp.int32`, -1 = empty; None where nobody asked for it.
        state: Values of `State`, `wp.uint8`.
    """

    depth: Any
    index: Any
    state: Any


class Filter(Protocol):
    """A step after the splat: maps (depth, index, state) to the same, on the device."""

    @property
    def scratch_bytes(self) -> int:
        """Bytes of working memory a pixel."""
        ...

    def build(self, maps: DeviceMaps) -> Callable[[], None]:
        """Allocate the working memory for these maps and return the step that runs on them.

        The step allocates nothing and does not synchronize; it is graph-capture safe once its
        kernels are loaded.
        """
        ...
