"""The splat of a plan on a CPU: blocks of points on all cores, each with a buffer of its own."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp import arrays
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.occlusion import Occlusion
from depthwarp.rendering.points import Points
from depthwarp.rendering.views import DeviceViews
from depthwarp.threads import Shared, pieces_of, share
from depthwarp_kernels import cull_blocks, splat, splat_blocks
from depthwarp_kernels import resolve_blocks as resolving
from depthwarp_kernels.point_source import BLOCK, GROUP, PointSource

__all__ = ["CpuSplatter"]

LEAST_BLOCKS = 256
"""Blocks of points, or of pixels, from which a second thread pays."""

PART_BLOCKS = 256
"""Blocks of points that a thread takes at a time, so that none waits long for the last."""

RESOLVED_PARTS_A_THREAD = 2
"""Parts of an image that a thread takes one after the other."""


class CpuSplatter:
    """Draws points into views: each thread into a buffer of keys of its own, one view at a time.

    A key only ever falls and the smallest of all buffers counts, so the result does not depend on
    the threads or on who takes which part. Between two views all buffers are empty.

    Args:
        views: The views, on the CPU.
        config: Depth kind and bounds.
        device: Warp's CPU.
        with_index: Whether keys hold the winner's index, or its depth alone.
        threads: Threads that share the work.
    """

    def __init__(
        self,
        views: DeviceViews,
        config: RenderConfig,
        device: Any,
        *,
        with_index: bool,
        threads: int,
    ) -> None:
        self._views, self._device, self._depth = views, device, config.depth
        self._with_index = with_index
        self._threads = threads
        width, height = views.size
        self._pixels = width * height
        self._pixel_blocks = -(-self._pixels // resolving.BLOCK)
        # Whole blocks of cells, so that they can be resolved in blocks.
        cells = -(-(self._pixels + splat_blocks.SPARE_CELLS) // resolving.BLOCK) * resolving.BLOCK
        key_type = wp.uint64 if with_index else wp.uint32
        self._keys = arrays.empty((threads, cells), key_type, device)
        self._are_empty = False
        self._counts = arrays.empty((threads, views.count, splat.COUNT_COLUMNS), wp.int64, device)
        self._buffers = [_Buffer(self._keys[t], self._counts[t]) for t in range(threads)]
        wp.load_module(resolving.resolve_blocks.module, device=device)
        self._nothing = arrays.zeros(1, wp.int32, device)
        self._loaded: dict[PointSource, _Kernels] = {}

    def render(self, points: Points, *maps: Any) -> None:
        """Draw a cloud and write depth, index if there is one, and state, shape (V, pixels)."""
        kernels, views = self._kernels(points.source), range(self._views.count)
        cloud = _Cloud(kernels, points, kernels.hides(points))
        self._counts.zero_()
        if not self._are_empty:
            self._keys.fill_(splat.EMPTY_KEY if self._with_index else splat.EMPTY_DEPTH)
        self._are_empty = False  # until all that is drawn was resolved
        if self._threads == 1 or (cloud.blocks + self._pixel_blocks) * len(views) < LEAST_BLOCKS:
            for view in views:
                self._draw_alone(cloud, view, 0, maps)
        elif len(views) >= self._threads:
            self._draw_apart(cloud, maps)
        else:
            for view in views:
                self._draw_together(cloud, view, maps)
        self._are_empty = True

    def total_counts(self) -> npt.NDArray[np.int64]:
        """What became of the points, shape (V, `COUNT_COLUMNS`)."""
        counts: npt.NDArray[np.int64] = self._counts.numpy().sum(axis=0)
        return counts

    def _draw_apart(self, cloud: _Cloud, maps: tuple[Any, ...]) -> None:
        """Draw views, each with one thread, in whose caches its keys stay."""
        views = Shared(range(self._views.count))

        def draw(thread: int) -> None:
            for view in views:
                self._draw_alone(cloud, view, thread, maps)

        share(draw, self._threads)

    def _draw_alone(self, cloud: _Cloud, view: int, thread: int, maps: tuple[Any, ...]) -> None:
        """Draw and resolve one view with one thread."""
        keys = self._keys[thread : thread + 1]
        in_view = self._cull(cloud, view, thread, (0, cloud.groups))
        for seen, count in self._rounds(cloud, view, keys, in_view):
            self._draw_blocks(cloud, view, thread, seen, (0, count))
        self._draw_rest(cloud, view, thread)
        self._resolve(view, thread, keys, (0, self._pixel_blocks), maps)

    def _draw_together(self, cloud: _Cloud, view: int, maps: tuple[Any, ...]) -> None:
        """Draw and resolve one view with all threads, each in a buffer if there are many points."""
        threads = self._threads if cloud.blocks >= LEAST_BLOCKS else 1
        keys = self._keys[:threads]
        if cloud.hides:
            self._draw_rounds(cloud, view, keys)
        else:
            self._draw_at_once(cloud, view, threads)
        self._draw_rest(cloud, view, 0)
        parts = Shared(pieces_of(self._pixel_blocks, self._threads * RESOLVED_PARTS_A_THREAD))

        def resolve(thread: int) -> None:
            for part in parts:
                self._resolve(view, thread, keys, part, maps)

        share(resolve, self._threads)

    def _draw_at_once(self, cloud: _Cloud, view: int, threads: int) -> None:
        """Draw with threads that wake once: all of them look what is in view, then draw."""
        pieces = pieces_of(cloud.groups, threads if cloud.kernels.cull else 1)
        groups, looked = Shared(pieces), Shared(range(1, len(pieces) + 1))
        parts: SimpleQueue[tuple[Any, tuple[int, int]] | None] = SimpleQueue()

        def draw(thread: int) -> None:
            for piece in groups:
                try:
                    seen, count = self._cull(cloud, view, thread, piece)
                    for part in pieces_of(count, count // PART_BLOCKS + 1):
                        parts.put((seen, part))
                finally:
                    if next(looked) == len(pieces):  # nothing more will come
                        for _ in range(threads):
                            parts.put(None)
            for seen, part in iter(parts.get, None):
                self._draw_blocks(cloud, view, thread, seen, part)

        if pieces:
            share(draw, threads)

    def _draw_rounds(self, cloud: _Cloud, view: int, keys: Any) -> None:
        """Draw with a thread for each of some buffers, list after list."""
        in_view = self._cull(cloud, view, 0, (0, cloud.groups))
        for seen, count in self._rounds(cloud, view, keys, in_view):
            parts = Shared(pieces_of(count, count // PART_BLOCKS + 1))

            def draw(thread: int, seen: Any = seen, parts: Iterable[Any] = parts) -> None:
                for part in parts:
                    self._draw_blocks(cloud, view, thread, seen, part)

            share(draw, keys.shape[0])

    def _rounds(
        self, cloud: _Cloud, view: int, keys: Any, in_view: tuple[Any, int]
    ) -> Iterable[tuple[Any, int]]:
        """Lists of blocks to draw one after the other into buffers, and their lengths."""
        if not cloud.hides:
            return [in_view]
        occlusion: Occlusion = cloud.kernels.occlusion
        return occlusion.rounds(cloud.points.arrays, view, keys, *in_view)

    def _cull(
        self, cloud: _Cloud, view: int, thread: int, groups: tuple[int, int]
    ) -> tuple[Any, int]:
        """Which blocks of some groups a view may see; counts the points of the others."""
        if cloud.kernels.cull is None or not cloud.blocks:
            return self._nothing, cloud.blocks
        first, end = groups
        seen = arrays.zeros((end - first) * GROUP + 1, wp.int32, self._device)
        wp.launch(
            cloud.kernels.cull,
            dim=1,
            inputs=[
                self._views.arrays[0],
                view,
                cloud.points.arrays,
                *cloud.arrays[:3],
                first,
                end - first,
                cloud.points.count,
            ],
            outputs=[seen, self._buffers[thread].counts[view]],
            device=self._device,
        )
        return seen, int(seen.numpy()[-1])

    def _draw_blocks(
        self, cloud: _Cloud, view: int, thread: int, seen: Any, part: tuple[int, int]
    ) -> None:
        """Draw blocks, or entries of the list `seen`, from the first to before the second."""
        first, end = part
        if end > first:
            buffer = self._buffers[thread]
            wp.launch(
                cloud.kernels.blocks,
                dim=end - first,
                inputs=[
                    *self._views.arrays,
                    view,
                    *cloud.arrays,
                    seen,
                    first,
                    cloud.points.count,
                ],
                outputs=[buffer.keys, buffer.counts[view]],
                device=self._device,
            )

    def _draw_rest(self, cloud: _Cloud, view: int, thread: int) -> None:
        """Draw the points behind the whole blocks, one by one."""
        first = cloud.blocks * BLOCK
        if cloud.points.count > first:
            views, lenses, tables = self._views.arrays
            only = slice(view, view + 1)
            wp.launch(
                cloud.kernels.points,
                dim=(1, cloud.points.count - first),
                inputs=[views[only], lenses[only], tables, cloud.points.arrays, first],
                outputs=[self._keys[thread : thread + 1], self._counts[thread, only]],
                device=self._device,
            )

    def _resolve(
        self, view: int, thread: int, keys: Any, part: tuple[int, int], maps: tuple[Any, ...]
    ) -> None:
        """Write the smallest keys of some blocks of pixels, and empty the buffers there."""
        first, end = part
        wp.launch(
            resolving.resolve_blocks if self._with_index else resolving.resolve_depth_blocks,
            dim=end - first,
            inputs=[first, self._pixels],
            outputs=[keys, *(array[view] for array in maps), self._buffers[thread].counts[view]],
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
                Occlusion(self._views, config, self._device)
                if is_prepared and config.lens.bounds is not None
                else None,
            )
            for kernel in filter(None, (kernels.points, kernels.blocks, kernels.cull)):
                wp.load_module(kernel.module, device=self._device)
            self._loaded[source] = kernels
        return self._loaded[source]


class _Buffer:
    """Keys of one view, shape (cells,), and counts of each view that a thread draws."""

    def __init__(self, keys: Any, counts: Any) -> None:
        self.keys, self.counts = keys, [counts[view] for view in range(counts.shape[0])]


@dataclass(frozen=True)
class _Kernels:
    """For single points, for blocks, and which blocks are in view and not hidden, if prepared."""

    points: Any
    blocks: Any
    cull: Any
    occlusion: Any

    def hides(self, points: Points) -> bool:
        """Whether it may pay to ask which blocks are hidden."""
        return self.occlusion is not None and self.occlusion.may_pay(points.whole_blocks)


class _Cloud:
    """Points, the kernels for them, and whether it may pay to ask which blocks are hidden."""

    def __init__(self, kernels: _Kernels, points: Points, hides: bool) -> None:
        self.kernels, self.points, self.hides = kernels, points, hides
        self.arrays = points.block_arrays
        self.blocks = points.whole_blocks
        self.groups = -(-self.blocks // GROUP)
