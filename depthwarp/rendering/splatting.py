"""How a plan splats on its device, and how much memory that takes."""

from __future__ import annotations

from typing import Any

from depthwarp.devices import usable_cores
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.cpu_splatting import CpuSplatter
from depthwarp.rendering.cuda_splatting import CudaSplatter
from depthwarp.rendering.views import DeviceViews

__all__ = ["buffer_count", "splatter_of"]


def buffer_count(views: int, device: Any, threads: int | None = None) -> int:
    """Key buffers of a view: one a thread, unless there are views enough for one a thread."""
    if device.is_cuda:
        return 1
    count = usable_cores() if threads is None else threads
    return 1 if views >= count else count


def splatter_of(
    views: DeviceViews,
    config: RenderConfig,
    device: Any,
    *,
    with_index: bool,
    threads: int | None = None,
) -> CpuSplatter | CudaSplatter:
    """The splatter of a device; `threads` on a CPU, None for all usable cores."""
    if device.is_cuda:
        return CudaSplatter(views, config, device, with_index=with_index)
    return CpuSplatter(
        views,
        config,
        device,
        with_index=with_index,
        threads=usable_cores() if threads is None else threads,
        buffers=buffer_count(views.count, device, threads),
    )
