"""The splat of a plan on a CPU: blocks of points on all cores, each with a buffer of its own."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp import arrays
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.occlusion import Occlusion
from depthwarp.rendering.points import Points
from depthwarp.rendering.views import DeviceViews
from depthwarp.threads import thread_pool
from depthwarp_kernels import cull_blocks, splat, splat_blocks
from depthwarp_kernels import resolve as resolving
from depthwarp_kernels.point_source import BLOCK, GROUP, PointSource

__all__ = ["CpuSplatter"]

LEAST_BLOCKS = 256
"""Blocks of points from which a second thread pays for its buffer."""

PARTS_A_THREAD = 4
"""Parts that a thread takes one after the other, so that none waits long for the last."""


class CpuSplatter:
    """Draws points into key buffers of views.

    A key only ever falls and the smallest of all buffers counts, so the result does not depend on
    the threads or on who takes which part.

    Args:
        views: The views, on the CPU.
        config: Depth kind and bounds.
        device: Warp's CPU.
        with_index: Whether keys hold the winner's index, or its depth alone.
        threads: Threads that share the work.
        buffers: One for each thread, or one: then each thread draws whole views.
    """

    def __init__(
        self,
        views: DeviceViews,
        config: RenderConfig,
        device: Any,
        *,
        with_index: bool,
        threads: int,
        buffers: int,
    ) -> None:
        self._views, self._device, self._depth = views, device, config.depth
        self._with_index = with_index
        self._threads = threads
        width, height = views.size
        self._pixels = width * height
        # Whole blocks of cells, so that they can be merged in blocks.
        cells = -(-(self._pixels + splat_blocks.SPARE_CELLS) // resolving.BLOCK) * resolving.BLOCK
        self._empty = splat.EMPTY_KEY if with_index else splat.EMPTY_DEPTH
        key_type = wp.uint64 if with_index else wp.uint32
        self._keys = arrays.empty((buffers, views.count, cells), key_type, device)
        self._counts = arrays.empty((buffers, views.count, splat.COUNT_COLUMNS), wp.int64, device)
        self._buffers = [
            [(self._keys[b, v], self._counts[b, v]) for v in range(views.count)]
            for b in range(buffers)
        ]
        self._used = 1  # buffers that hold something
        wp.load_module(resolving.resolve.module, device=device)
        self._nothing = arrays.zeros(1, wp.int32, device)
        self._loaded: dict[PointSource, _Kernels] = {}

    def draw(self, points: Points) -> None:
        """Clear the buffers and draw a cloud."""
        kernels = self._kernels(points.source)
        self._counts.zero_()
        views = range(self._views.count)
        if self._threads == 1 or points.whole_blocks * len(views) < LEAST_BLOCKS:
            self._used = 1
            self._keys[0].fill_(self._empty)
            for view in views:
                self._draw_view(kernels, points, view)
        elif len(self._buffers) == 1:
            self._draw_apart(kernels, points)
        else:
            self._used = len(self._buffers)
            self._share(lambda thread: self._keys[thread].fill_(self._empty))
            for view in views:
                self._draw_together(kernels, points, view)
        self._draw_rest(kernels, points)

    def resolve(self, *maps: Any) -> None:
        """Write what the keys hold: depth, index if they have it, and state, shape (V, pixels)."""
        views = range(self._views.count)
        pieces = _pieces(self._keys.shape[2] // resolving.BLOCK, len(self._buffers))
        parts = _Shared((view, *piece) for view in views for piece in pieces)
        self._share(lambda thread: self._resolve_parts(parts, thread, maps))
        whole = self._pixels // resolving.BLOCK * resolving.BLOCK
        if self._pixels > whole:
            wp.launch(
                resolving.resolve if self._with_index else resolving.resolve_depth,
                dim=(len(views), self._pixels - whole),
                inputs=[self._keys[0], whole],
                outputs=[*maps, self._counts[0]],
                device=self._device,
            )

    def total_counts(self) -> npt.NDArray[np.int64]:
        """What became of the points, shape (V, `COUNT_COLUMNS`)."""
        counts: npt.NDArray[np.int64] = self._counts.numpy().sum(axis=0)
        return counts

    def _draw_apart(self, kernels: _Kernels, points: Points) -> None:
        """Draw views, each with one thread."""
        views = _Shared(range(self._views.count))

        def draw(thread: int) -> None:
            for view in views:
                self._buffers[0][view][0].fill_(self._empty)
                self._draw_view(kernels, points, view)

        self._share(draw)

    def _draw_view(self, kernels: _Kernels, points: Points, view: int) -> None:
        """Draw one view with one thread."""
        groups = -(-points.whole_blocks // GROUP)
        in_view = self._cull(kernels, points, view, 0, (0, groups))
        for seen, count in self._rounds(kernels, points, view, in_view):
            self._draw_blocks(kernels, points, view, 0, seen, (0, count))

    def _draw_together(self, kernels: _Kernels, points: Points, view: int) -> None:
        """Draw one view with all threads, each into a buffer of its own."""
        in_view = self._cull_together(kernels, points, view)
        for seen, count in self._rounds(kernels, points, view, in_view):
            parts = _Shared(_pieces(count, self._threads * PARTS_A_THREAD))
            self._share(partial(self._draw_parts, kernels, points, view, seen, parts))

    def _draw_parts(
        self,
        kernels: _Kernels,
        points: Points,
        view: int,
        seen: Any,
        parts: Iterable[tuple[int, int]],
        thread: int,
    ) -> None:
        """Work of a thread: parts of a list, into its own buffer."""
        for part in parts:
            self._draw_blocks(kernels, points, view, thread, seen, part)

    def _rounds(
        self, kernels: _Kernels, points: Points, view: int, in_view: tuple[Any, int]
    ) -> Iterable[tuple[Any, int]]:
        """Lists of blocks to draw one after the other, and their lengths."""
        if kernels.occlusion is None:
            return [in_view]
        return kernels.occlusion.rounds(points.arrays, view, *in_view)

    def _cull_together(self, kernels: _Kernels, points: Points, view: int) -> tuple[Any, int]:
        """The same as `_cull` of all groups, with all threads."""
        pieces = _pieces(-(-points.whole_blocks // GROUP), self._threads)
        if kernels.cull is None or not pieces:
            return self._nothing, points.whole_blocks

        def cull(thread: int) -> list[Any]:
            parts = pieces[thread : thread + 1]
            lists = [self._cull(kernels, points, view, thread, part) for part in parts]
            return [seen.numpy()[:count] for seen, count in lists]

        seen = np.concatenate([part for parts in self._share(cull) for part in parts] + [[0]])
        return wp.array(seen, dtype=wp.int32, device=self._device), len(seen) - 1

    def _cull(
        self, kernels: _Kernels, points: Points, view: int, buffer: int, groups: tuple[int, int]
    ) -> tuple[Any, int]:
        """Which blocks of some groups a view may see; counts the points of the others."""
        if kernels.cull is None or not points.whole_blocks:
            return self._nothing, points.whole_blocks
        first, end = groups
        seen = arrays.zeros((end - first) * GROUP, wp.int32, self._device)
        length = arrays.zeros(1, wp.int32, self._device)
        wp.launch(
            kernels.cull,
            dim=1,
            inputs=[
                self._views.arrays[0],
                view,
                points.arrays,
                *points.block_arrays[:3],
                first,
                end - first,
                points.count,
            ],
            outputs=[seen, length, self._buffers[buffer][view][1]],
            device=self._device,
        )
        return seen, int(length.numpy()[0])

    def _draw_blocks(
        self,
        kernels: _Kernels,
        points: Points,
        view: int,
        buffer: int,
        seen: Any,
        part: tuple[int, int],
    ) -> None:
        """Draw blocks, or entries of the list `seen`, from the first to before the second."""
        first, end = part
        if end > first:
            wp.launch(
                kernels.blocks,
                dim=end - first,
                inputs=[
                    *self._views.arrays,
                    view,
                    *points.block_arrays,
                    seen,
                    first,
                    points.count,
                ],
                outputs=[*self._buffers[buffer][view]],
                device=self._device,
            )

    def _draw_rest(self, kernels: _Kernels, points: Points) -> None:
        """Draw the points behind the whole blocks, one by one, into all views."""
        first = points.whole_blocks * BLOCK
        if points.count > first:
            wp.launch(
                kernels.points,
                dim=(self._views.count, points.count - first),
                inputs=[*self._views.arrays, points.arrays, first],
                outputs=[self._keys[0], self._counts[0]],
                device=self._device,
            )

    def _resolve_parts(
        self, parts: Iterable[tuple[int, int, int]], thread: int, maps: tuple[Any, ...]
    ) -> None:
        """Bring the smallest keys of all threads together and resolve them, part by part."""
        merge, resolve = (
            (resolving.merge_blocks, resolving.resolve_blocks)
            if self._with_index
            else (resolving.merge_depth_blocks, resolving.resolve_depth_blocks)
        )
        nearest = self._buffers[0]
        whole = self._pixels // resolving.BLOCK
        counted = self._buffers[thread if len(self._buffers) > 1 else 0]
        for view, first, end in parts:
            for other in self._buffers[1 : self._used]:
                wp.launch(
                    merge,
                    dim=end - first,
                    inputs=[other[view][0], first],
                    outputs=[nearest[view][0]],
                    device=self._device,
                )
            if min(end, whole) > first:
                wp.launch(
                    resolve,
                    dim=min(end, whole) - first,
                    inputs=[nearest[view][0], first],
                    outputs=[*(array[view] for array in maps), counted[view][1]],
                    device=self._device,
                )

    def _kernels(self, source: PointSource) -> _Kernels:
        """The kernels for a kind of cloud, loaded once."""
        if source not in self._loaded:
            config = splat.SplatConfig(
                source,
                self._views.model,
                self._depth,
                self._views.has_range_views,
                self._with_index,
            )
            is_prepared = source.sphere_of is not None
            kernels = _Kernels(
                splat.splat_kernel(config),
                splat_blocks.block_kernel(config),
                cull_blocks.cull_kernel(config) if is_prepared else None,
                Occlusion(self._views, config, self._keys, self._device)
                if is_prepared and config.lens.bounds is not None
                else None,
            )
            for kernel in filter(None, (kernels.points, kernels.blocks, kernels.cull)):
                wp.load_module(kernel.module, device=self._device)
            self._loaded[source] = kernels
        return self._loaded[source]

    def _share(self, work: Callable[[int], Any]) -> list[Any]:
        """Let every thread do its work, and wait for all of them."""
        pool = thread_pool(self._threads)
        return [done.result() for done in [pool.submit(work, t) for t in range(self._threads)]]


@dataclass(frozen=True)
class _Kernels:
    """For single points, for blocks, and which blocks are in view and not hidden, if prepared."""

    points: Any
    blocks: Any
    cull: Any
    occlusion: Occlusion | None


def _pieces(count: int, pieces: int) -> list[tuple[int, int]]:
    """From 0 to `count` in pieces of nearly one size: first, and end."""
    bounds = [count * piece // pieces for piece in range(pieces + 1)]
    return [(first, end) for first, end in zip(bounds, bounds[1:], strict=False) if end > first]


class _Shared:
    """An iterator from which several threads take."""

    def __init__(self, items: Iterable[Any]) -> None:
        self._items, self._lock = iter(items), threading.Lock()

    def __iter__(self) -> Iterator[Any]:
        return self

    def __next__(self) -> Any:
        with self._lock:
            return next(self._items)
