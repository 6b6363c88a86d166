"""The splat of a plan on its device: one launch on CUDA, blocks of points on all cores of a CPU."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from typing import Any

import warp as wp

from depthwarp import arrays
from depthwarp.rendering.views import DeviceViews
from depthwarp_kernels import splat, splat_blocks

__all__ = ["Splatter", "usable_cores"]

LEAST_BLOCKS = 128
"""Blocks of points from which a second thread pays for its buffer."""

PARTS_A_THREAD = 8
"""Parts that a thread takes one after the other, so that none waits long for the last."""


def usable_cores() -> int:
    """Processor cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="depthwarp")


class Splatter:
    """Draws points into key buffers of views.

    On a CPU each thread has key buffers of its own; a key only ever falls and the smallest of all
    buffers counts, so the result does not depend on the threads or on who takes which part.

    Args:
        config: What is decided at compile time.
        views: The views, on the device.
        count: Number of views V.
        device: Warp device.
        threads: Threads on a CPU; None for all usable cores.

    Attributes:
        keys: Key buffers, shape (buffers, V, pixels), uint64.
        counts: What became of the points, shape (buffers, V, `COUNT_COLUMNS`), int64.
    """

    def __init__(
        self,
        config: splat.SplatConfig,
        views: DeviceViews,
        count: int,
        device: Any,
        threads: int | None = None,
    ) -> None:
        self._views, self._count, self._device = views, count, device
        wanted = usable_cores() if threads is None else threads
        self._threads = 1 if device.is_cuda else wanted
        # Views enough for all threads are drawn one a thread, straight into the views' own keys.
        self._by_view = count >= self._threads
        buffers = 1 if self._by_view else self._threads
        width, height = views.size
        self.keys = arrays.empty((buffers, count, width * height), wp.uint64, device)
        self.counts = arrays.empty((buffers, count, splat.COUNT_COLUMNS), wp.int64, device)
        self._points_kernel = splat.splat_kernel(config)
        wp.load_module(self._points_kernel.module, device=device)
        if not device.is_cuda:
            self._blocks_kernel = splat_blocks.block_kernel(config)
            wp.load_module(self._blocks_kernel.module, device=device)
            self._slots = [
                [(self.keys[b, v], self.counts[b, v]) for v in range(count)] for b in range(buffers)
            ]

    def draw(self, points_world: Any) -> None:
        """Clear the buffers and draw a cloud, `wp.array` of `wp.vec3f`, shape (N,)."""
        self.counts.zero_()
        if self._device.is_cuda:
            self.keys.fill_(splat.EMPTY_KEY)
            self._draw_points(points_world, 0)
            return
        blocks = points_world.shape[0] // splat_blocks.BLOCK
        if self._threads == 1 or blocks * self._count < LEAST_BLOCKS:
            self.keys.fill_(splat.EMPTY_KEY)
            for view in range(self._count):
                self._draw_blocks(points_world, view, 0, 0, blocks)
        elif self._by_view:
            self._share(self._draw_views(points_world, blocks))
        else:
            self._share(self._draw_parts(points_world, blocks))
        self._draw_points(points_world, blocks * splat_blocks.BLOCK)

    def _draw_points(self, points_world: Any, first: int) -> None:
        """Draw the points from `first` on, one by one, into all views."""
        if points_world.shape[0] > first:
            wp.launch(
                self._points_kernel,
                dim=(self._count, points_world.shape[0] - first),
                inputs=[*self._views.arrays, points_world, first],
                outputs=[self.keys[0], self.counts[0]],
                device=self._device,
            )

    def _draw_blocks(self, points: Any, view: int, buffer: int, first: int, count: int) -> None:
        keys, counts = self._slots[buffer][view]
        if count:
            wp.launch(
                self._blocks_kernel,
                dim=count,
                inputs=[*self._views.arrays, view, points, first],
                outputs=[keys, counts],
                device=self._device,
            )

    def _draw_views(self, points: Any, blocks: int) -> Callable[[int], None]:
        """Work of a thread: views of its own, one after the other."""
        views = _Shared(iter(range(self._count)))

        def work(thread: int) -> None:
            for view in views:
                self.keys[0, view].fill_(splat.EMPTY_KEY)
                self._draw_blocks(points, view, 0, 0, blocks)

        return work

    def _draw_parts(self, points: Any, blocks: int) -> Callable[[int], None]:
        """Work of a thread: parts of the cloud, into its own buffers of all views."""
        size = -(-blocks // (self._threads * PARTS_A_THREAD))
        parts = _Shared(
            (view, first) for view in range(self._count) for first in range(0, blocks, size)
        )

        def work(thread: int) -> None:
            self.keys[thread].fill_(splat.EMPTY_KEY)
            for view, first in parts:
                self._draw_blocks(points, view, thread, first, min(size, blocks - first))

        return work

    def _share(self, work: Callable[[int], None]) -> None:
        """Let every thread do its work, and wait for all of them."""
        for done in [_pool(self._threads).submit(work, thread) for thread in range(self._threads)]:
            done.result()


class _Shared:
    """An iterator from which several threads take."""

    def __init__(self, items: Iterator[Any]) -> None:
        self._items, self._lock = items, threading.Lock()

    def __iter__(self) -> _Shared:
        return self

    def __next__(self) -> Any:
        with self._lock:
            return next(self._items)
