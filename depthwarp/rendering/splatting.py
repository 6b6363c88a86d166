"""How a plan splats on its device, and how much memory that takes."""

from __future__ import annotations

from typing import Any

import warp as wp

from depthwarp import arrays
from depthwarp.devices import usable_cores
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.cpu_splatting import CpuSplatter
from depthwarp.rendering.cuda_splatting import CudaSplatter, groups_of
from depthwarp.rendering.views import DeviceViews
from depthwarp_kernels.splat import COUNT_COLUMNS

__all__ = ["buffer_count", "splatter_of"]


def buffer_count(views: int, device: Any, threads: int | None = None) -> int:
    """Key buffers: one a view on CUDA, one a thread on a CPU, None for all usable cores."""
    if device.is_cuda:
        return views
    return usable_cores() if threads is None else threads


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
        width, height = views.size
        key_type = wp.uint64 if with_index else wp.uint32
        keys = arrays.empty((views.count, width * height), key_type, device)
        counts = arrays.empty((views.count, COUNT_COLUMNS), wp.int64, device)
        return CudaSplatter(views, config.depth, keys, counts, groups_of(device))
    return CpuSplatter(
        views,
        config,
        device,
        with_index=with_index,
        threads=buffer_count(views.count, device, threads),
    )
