"""Drawing views that each look at a cloud of their own: on all cores of a CPU, and on CUDA."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from queue import SimpleQueue
from typing import Any

import warp as wp

from depthwarp import arrays
from depthwarp.rendering.cuda_splatting import CudaSplatter, groups_of
from depthwarp.rendering.points import Points
from depthwarp.rendering.views import DeviceViews
from depthwarp.threads import thread_pool
from depthwarp_kernels import ragged, ragged_fused, ragged_shared, splat
from depthwarp_kernels.point_source import PlainPoints
from depthwarp_kernels.ragged import LANES

__all__ = ["CpuViews", "CudaViews", "needs_keys"]

PARTS_A_THREAD = 8
"""Groups of views that a thread takes one after the other, so that none waits long for the last."""

LEAST_WORK = 200_000
"""Points and pixels of a group: to hand it to a thread costs about a fifth of drawing it."""


class CpuViews:
    """Clears, draws and resolves one view after the other in a key buffer that stays in the cache.

    Threads share the views. While a graph is captured one thread draws them all.

    Args:
        views: The views, on the CPU.
        config: Lens, depth, the maps that are written, and the static cloud.
        maps: Depth, index and state, shape (V, pixels), or (1, 1) where not written.
        counts: What became of the views' own points, shape (V, `RAGGED_COLUMNS`), int64.
        static: A prepared cloud that all views see; its indices come first.
        threads: Threads that share the views.
    """

    def __init__(
        self,
        views: DeviceViews,
        config: ragged.RaggedConfig,
        maps: Sequence[Any],
        counts: Any,
        static: Points | None,
        threads: int,
    ) -> None:
        self._views, self._outputs = views, [*maps, counts]
        self._device, self._threads = counts.device, threads
        width, height = views.size
        self._pixels = width * height
        splat_config = replace(config.splat, with_index="index" in config.outputs)
        cells = (-(-self._pixels // ragged_fused.CELLS) + 1) * ragged_fused.CELLS
        self._keys: SimpleQueue[Any] = SimpleQueue()
        for _ in range(threads):
            self._keys.put(arrays.empty(cells, splat_config.key_type, self._device))
        self._static = PlainPoints() if static is None else static.arrays
        self._rank = 0 if static is None else static.total
        self._kernel = ragged_fused.fused_kernel(replace(config, splat=splat_config))
        wp.load_module(self._kernel.module, device=self._device)

    def draw(self, points: Any, spans: Any, cloud_of: Any, count: int) -> None:
        """Draw the first views.

        Args:
            points: All clouds' points, `wp.vec3f`, shape (N,), not empty.
            spans: Begin and end of each cloud, `wp.vec2i`, shape (C,).
            cloud_of: The cloud of each view, `wp.int32`, shape (V,).
            count: How many views.
        """
        clouds = [points, spans, cloud_of, self._static, self._rank]

        def draw(first: int, end: int) -> None:
            keys = self._keys.get()
            try:
                wp.launch(
                    self._kernel,
                    dim=end - first,
                    inputs=[*self._views.arrays, *clouds, first],
                    outputs=[keys, *self._outputs],
                    device=self._device,
                )
            finally:
                self._keys.put(keys)

        most = (points.shape[0] + count * self._pixels) // LEAST_WORK
        threads = min(self._threads, count, most)
        if threads <= 1 or self._device.is_capturing:
            draw(0, count)
            return
        # As many parts for each thread, so that all end together.
        parts = min(count, threads * min(most // threads, PARTS_A_THREAD))
        bounds = [count * part // parts for part in range(parts + 1)]
        list(thread_pool(self._threads).map(draw, bounds[:-1], bounds[1:]))


def needs_keys(config: ragged.RaggedConfig, pixels: int) -> bool:
    """Whether CUDA keeps keys of all views: of large images, and of those with a static cloud."""
    is_small = ragged_shared.shared_config(config.splat, config.outputs, pixels) is not None
    return config.static is not None or not is_small


class CudaViews:
    """Draws so many threads a view into the keys of all views, and resolves them.

    Small images are drawn in the shared memory of a block of threads each, without keys of all
    views; only a static cloud needs them then, as what the images begin with.

    Args:
        views: The views, on the device.
        config: Lens, depth, the maps that are written, and the static cloud.
        maps: Depth, index and state, shape (V, pixels), or (1, 1) where not written.
        counts: What became of the views' own points, shape (V, `RAGGED_COLUMNS`), int64.
        static: A prepared cloud that all views see; its indices come first.
    """

    def __init__(
        self,
        views: DeviceViews,
        config: ragged.RaggedConfig,
        maps: Sequence[Any],
        counts: Any,
        static: Points | None,
    ) -> None:
        self._views, self._maps, self._counts = views, maps, counts
        self._device = counts.device
        width, height = views.size
        self._static, self._rank = static, 0 if static is None else static.total
        self._shared = ragged_shared.shared_config(
            config.splat, config.outputs, width * height, begins_with_keys=static is not None
        )
        has_keys = needs_keys(config, width * height)
        shape = (views.count, width * height) if has_keys else (1, 1)
        self._keys = arrays.empty(shape, wp.uint64, self._device)
        if static is not None:
            unread = arrays.zeros((views.count, splat.COUNT_COLUMNS), wp.int64, self._device)
            groups = groups_of(self._device)
            self._splatter = CudaSplatter(views, config.splat.depth, self._keys, unread, groups)
        if self._shared is None:
            self._kernels = [
                ragged.ragged_kernel(config.splat),
                ragged.resolve_kernel(config.outputs),
            ]
        else:
            self._kernels = [ragged_shared.shared_kernel(self._shared)]
        for kernel in self._kernels:
            wp.load_module(kernel.module, device=self._device, block_dim=LANES)

    def draw(self, points: Any, spans: Any, cloud_of: Any, count: int) -> None:
        """Draw the first views; see `CpuViews.draw`. Neither waits nor allocates."""
        if self._static is not None:
            self._splatter.draw(self._static)
        elif self._shared is None:
            self._keys.fill_(splat.EMPTY_KEY)
        clouds = [*self._views.arrays, points, spans, cloud_of, self._rank]
        if self._shared is None:
            self._draw_flat(clouds, count)
        else:
            self._launch(self._kernels[0], count, [*clouds, self._keys], self._maps)

    def _draw_flat(self, clouds: list[Any], count: int) -> None:
        """Into the keys of all views, and from there into the maps."""
        draw, resolve = self._kernels
        self._counts.zero_()
        self._launch(draw, count, clouds, [self._keys])
        wp.launch(
            resolve,
            dim=(count, self._keys.shape[1]),
            inputs=[self._keys],
            outputs=[*self._maps, self._counts],
            device=self._device,
        )

    def _launch(self, kernel: Any, count: int, inputs: list[Any], outputs: Sequence[Any]) -> None:
        """A launch over threads of views."""
        wp.launch(
            kernel,
            dim=(count, LANES),
            inputs=inputs,
            outputs=[*outputs, self._counts],
            device=self._device,
            block_dim=LANES,
        )
