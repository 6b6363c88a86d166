"""Launches shared among the cores of a CPU."""

from __future__ import annotations

from typing import Any

import warp as wp

from depthwarp.devices import usable_cores
from depthwarp.threads import share

__all__ = ["launch_parts"]


def launch_parts(
    kernel: Any, count: int, inputs: list[Any], outputs: list[Any], device: Any, *more: Any
) -> None:
    """Launch over `count` threads; on a CPU in as many parts as there are cores.

    The kernel takes `inputs`, the first thread of a part, `more` and `outputs`.
    """
    parts = 1 if device.is_cuda else usable_cores()
    bounds = [count * part // parts for part in range(parts + 1)]
    wp.load_module(kernel.module, device=device)

    def launch(part: int) -> None:
        first, size = bounds[part], bounds[part + 1] - bounds[part]
        if size:
            wp.launch(kernel, size, [*inputs, first, *more], outputs, device=device)

    share(launch, parts)
