"""The splat of a plan on its device: one launch on CUDA, blocks of points on all cores of a CPU."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import warp as wp

from depthwarp import arrays
from depthwarp.devices import usable_cores
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.points import Points
from depthwarp.rendering.views import DeviceViews
from depthwarp.threads import thread_pool
from depthwarp_kernels import resolve as resolving
from depthwarp_kernels import splat, splat_blocks
from depthwarp_kernels.point_source import BLOCK, PointSource

__all__ = ["Splatter", "buffer_count"]

LEAST_BLOCKS = 128
"""Blocks of points from which a second thread pays for its buffer."""

PARTS_A_THREAD = 8
"""Parts that a thread takes one after the other, so that none waits long for the last."""


def _thread_count(device: Any, threads: int | None) -> int:
    if device.is_cuda:
        return 1
    return usable_cores() if threads is None else threads


def buffer_count(views: int, device: Any, threads: int | None = None) -> int:
    """Key buffers of a view: one a thread, unless there are views enough for one a thread."""
    count = _thread_count(device, threads)
    return 1 if views >= count else count


class Splatter:
    """Draws points into key buffers of views.

    On a CPU each thread has key buffers of its own; a key only ever falls and the smallest of all
    buffers counts, so the result does not depend on the threads or on who takes which part.

    Args:
        views: The views, on the device.
        config: Depth kind and bounds.
        device: Warp device.
        threads: Threads on a CPU; None for all usable cores.

    Attributes:
        keys: Key buffers, shape (buffers, V, pixels and spare cells), uint64; after `draw` the
            first holds the result.
        counts: What became of the points, shape (buffers, V, `COUNT_COLUMNS`), int64.
    """

    def __init__(
        self, views: DeviceViews, config: RenderConfig, device: Any, threads: int | None = None
    ) -> None:
        self._views, self._device, self._depth = views, device, config.depth
        self._threads = _thread_count(device, threads)
        buffers = buffer_count(views.count, device, threads)
        self._by_view = buffers == 1
        width, height = views.size
        self._pixels = width * height
        # Whole blocks of cells, so that they can be merged in blocks.
        cells = -(-(self._pixels + splat_blocks.SPARE_CELLS) // resolving.BLOCK) * resolving.BLOCK
        self.keys = arrays.empty((buffers, views.count, cells), wp.uint64, device)
        self.counts = arrays.empty((buffers, views.count, splat.COUNT_COLUMNS), wp.int64, device)
        self._nothing = arrays.zeros(1, wp.int32, device)
        self._loaded: dict[PointSource, list[Any]] = {}
        self._slots = [
            [(self.keys[b, v], self.counts[b, v]) for v in range(views.count)]
            for b in range(buffers)
        ]

    def draw(self, points: Points) -> None:
        """Clear the buffers and draw a cloud."""
        kernels = self._kernels(points.source)
        self.counts.zero_()
        whole = 0 if self._device.is_cuda else points.whole_blocks
        work = _Work(points, whole, *kernels)
        if self._threads == 1 or whole * self._views.count < LEAST_BLOCKS:
            self.keys[0].fill_(splat.EMPTY_KEY)
            for view in range(self._views.count):
                self._draw_blocks(work, view, 0, 0, whole)
        elif self._by_view:
            self._share(self._draw_views(work))
        else:
            self._share(self._draw_parts(work))
            self._merge()
        self._draw_points(work)

    def resolve(self, depth: Any, index: Any, state: Any) -> None:
        """Write what the keys hold: depth, index and state, each shape (V, pixels)."""
        whole = 0 if self._device.is_cuda else self._pixels // resolving.BLOCK
        maps = depth, index, state
        if self._pixels > whole * resolving.BLOCK:
            first = whole * resolving.BLOCK
            wp.launch(
                resolving.resolve,
                dim=(self._views.count, self._pixels - first),
                inputs=[self.keys[0], first],
                outputs=[*maps, self.counts[0]],
                device=self._device,
            )
        for view in range(self._views.count if whole else 0):
            wp.launch(
                resolving.resolve_blocks,
                dim=whole,
                inputs=[self.keys[0, view]],
                outputs=[*(array[view] for array in maps), self.counts[0, view]],
                device=self._device,
            )

    def _merge(self) -> None:
        """Bring the smallest keys of all threads into the first buffer."""
        for buffer in range(1, self.keys.shape[0]):
            for view in range(self._views.count):
                wp.launch(
                    resolving.merge_blocks,
                    dim=self.keys.shape[2] // resolving.BLOCK,
                    inputs=[self.keys[buffer, view]],
                    outputs=[self.keys[0, view]],
                    device=self._device,
                )

    def _kernels(self, source: PointSource) -> list[Any]:
        """The kernels, loaded once: for single points, blocks, and which blocks are in view."""
        if source in self._loaded:
            return self._loaded[source]
        config = splat.SplatConfig(
            source, self._views.model, self._depth, self._views.has_range_views
        )
        kernels: list[Any] = [splat.splat_kernel(config)]
        if not self._device.is_cuda:
            kernels.append(splat_blocks.block_kernel(config))
            if source.sphere_of is not None:
                kernels.append(splat_blocks.cull_kernel(config))
        for kernel in kernels:
            wp.load_module(kernel.module, device=self._device)
        self._loaded[source] = kernels
        return kernels

    def _draw_points(self, work: _Work) -> None:
        """Draw the points behind the whole blocks, one by one, into all views."""
        first = work.whole_blocks * BLOCK
        if work.points.count > first:
            wp.launch(
                work.points_kernel,
                dim=(self._views.count, work.points.count - first),
                inputs=[*self._views.arrays, work.points.arrays, first],
                outputs=[self.keys[0], self.counts[0]],
                device=self._device,
            )

    def _draw_blocks(self, work: _Work, view: int, buffer: int, first: int, blocks: int) -> None:
        """Draw blocks from `first` on into a buffer, leaving out what the view cannot see."""
        keys, counts = self._slots[buffer][view]
        views, points, device = self._views.arrays, work.points, self._device
        seen = self._nothing
        if points.source.sphere_of is not None and blocks:
            seen, length = arrays.empty(blocks, wp.int32, device), arrays.empty(1, wp.int32, device)
            wp.launch(
                work.cull_kernel,
                dim=1,
                inputs=[views[0], view, points.arrays, first, blocks, points.count],
                outputs=[seen, length, counts],
                device=device,
            )
            blocks = int(length.numpy()[0])
        if blocks:
            wp.launch(
                work.blocks_kernel,
                dim=blocks,
                inputs=[*views, view, *points.block_arrays, seen, first, points.count],
                outputs=[keys, counts],
                device=device,
            )

    def _draw_views(self, work: _Work) -> Callable[[int], None]:
        """Work of a thread: views of its own, one after the other."""
        views = _Shared(iter(range(self._views.count)))

        def draw(thread: int) -> None:
            for view in views:
                self._slots[0][view][0].fill_(splat.EMPTY_KEY)
                self._draw_blocks(work, view, 0, 0, work.whole_blocks)

        return draw

    def _draw_parts(self, work: _Work) -> Callable[[int], None]:
        """Work of a thread: parts of the cloud, into its own buffers of all views."""
        size = -(-work.whole_blocks // (self._threads * PARTS_A_THREAD))
        parts = _Shared(
            (view, first)
            for view in range(self._views.count)
            for first in range(0, work.whole_blocks, size)
        )

        def draw(thread: int) -> None:
            self.keys[thread].fill_(splat.EMPTY_KEY)
            for view, first in parts:
                count = min(size, work.whole_blocks - first)
                self._draw_blocks(work, view, thread, first, count)

        return draw

    def _share(self, draw: Callable[[int], None]) -> None:
        """Let every thread do its work, and wait for all of them."""
        pool = thread_pool(self._threads)
        for done in [pool.submit(draw, thread) for thread in range(self._threads)]:
            done.result()


@dataclass(frozen=True)
class _Work:
    """What all threads of one draw share."""

    points: Points
    whole_blocks: int
    points_kernel: Any
    blocks_kernel: Any = None
    cull_kernel: Any = None


class _Shared:
    """An iterator from which several threads take."""

    def __init__(self, items: Iterator[Any]) -> None:
        self._items, self._lock = items, threading.Lock()

    def __iter__(self) -> _Shared:
        return self

    def __next__(self) -> Any:
        with self._lock:
            return next(self._items)
