"""The splat of a plan on CUDA: few launches, nothing allocated, nothing read back."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp import arrays
from depthwarp.rendering.points import Points
from depthwarp.rendering.views import DeviceViews
from depthwarp_kernels import splat, splat_cuda
from depthwarp_kernels.point_source import BLOCK, PointSource

__all__ = ["CudaSplatter", "groups_of"]

LIST_PLACES = 1 << 20
"""Places for chunks that views may see: 4 MiB. What does not fit is drawn in several passes."""

GROUPS_A_MULTIPROCESSOR = 32
"""Groups of threads that share a launch: several times what runs at once, so that none waits."""


def groups_of(device: Any) -> int:
    """Groups of threads that keep a CUDA device busy."""
    return GROUPS_A_MULTIPROCESSOR * int(device.sm_count)


class CudaSplatter:
    """Draws points into the keys of views and resolves them: graph-capture safe once it was used.

    Args:
        views: The views, on the device.
        depth: Depth kind.
        keys: Key buffer, shape (V, pixels), uint64; or uint32, for depths alone.
        counts: What became of the points, shape (V, `COUNT_COLUMNS`), int64.
        groups: Groups of threads of a launch, over all views; no more than one a chunk.
        places: Places of the list of chunks that views may see.
    """

    def __init__(
        self,
        views: DeviceViews,
        depth: str,
        keys: Any,
        counts: Any,
        groups: int,
        places: int = LIST_PLACES,
    ) -> None:
        self._views, self._depth, self._device = views, depth, keys.device
        self._keys, self._counts = keys, counts
        self._with_index = keys.dtype is wp.uint64
        self._groups, self._places = groups, places
        self._listed = arrays.empty(places, wp.int32, self._device)
        self._lengths = arrays.empty(views.count, wp.int32, self._device)
        self._loaded: dict[PointSource, tuple[Any, Any, int]] = {}

    def render(self, points: Points, *maps: Any) -> None:
        """Draw a cloud and write depth, index if there is one, and state, shape (V, pixels)."""
        self.draw(points)
        self.resolve(*maps)

    def draw(self, points: Points) -> None:
        """Clear keys and counts, and draw a cloud."""
        self._keys.fill_(splat.EMPTY_KEY if self._with_index else splat.EMPTY_DEPTH)
        self._counts.zero_()
        chunks = -(-points.count // BLOCK)
        if not chunks:
            return
        if points.source.sphere_of is None:
            self._splat(points, 0, self._views.count, chunks)
            return
        # As many chunks as the list has places for, of as many views.
        columns = min(chunks, self._places)
        rows = min(self._views.count, self._places // columns)
        for view in range(0, self._views.count, rows):
            for first in range(0, chunks, columns):
                part = min(rows, self._views.count - view), min(columns, chunks - first)
                self._list(points, view, first, *part)
                self._splat(points, view, *part)

    def resolve(self, *maps: Any) -> None:
        """Write what the keys hold: depth, index if they have it, and state, shape (V, pixels)."""
        pixels = maps[0].shape[1]
        wp.launch(
            splat_cuda.resolve_lanes if self._with_index else splat_cuda.resolve_depth_lanes,
            dim=(self._views.count, _whole_warps(-(-pixels // splat_cuda.PIXELS))),
            inputs=[self._keys, pixels],
            outputs=[*maps, self._counts],
            device=self._device,
        )

    def total_counts(self) -> npt.NDArray[np.int64]:
        """What became of the points, shape (V, `COUNT_COLUMNS`); waits for the device."""
        counts: npt.NDArray[np.int64] = self._counts.numpy()
        return counts

    def _list(self, points: Points, view: int, first: int, views: int, chunks: int) -> None:
        """List the chunks from `first` on that views from `view` on may see; count the others."""
        self._lengths.zero_()
        wp.launch(
            self._kernels(points.source)[0],
            dim=(views, _whole_warps(chunks)),
            inputs=[self._views.arrays[0], points.arrays, view, first, chunks, points.count],
            outputs=[self._listed, self._lengths, self._counts],
            device=self._device,
        )

    def _splat(self, points: Points, view: int, views: int, chunks: int) -> None:
        """Draw chunks, those in the list of a prepared cloud, into views from `view` on."""
        _, kernel, lanes = self._kernels(points.source)
        groups = min(chunks, -(-self._groups // views))
        wp.launch(
            kernel,
            dim=(views, groups * lanes),
            inputs=[
                *self._views.arrays,
                points.arrays,
                self._listed,
                self._lengths,
                view,
                chunks,
                points.count,
                groups,
            ],
            outputs=[self._keys, self._counts],
            device=self._device,
        )

    def _kernels(self, source: PointSource) -> tuple[Any, Any, int]:
        """The kernels that list and draw chunks, loaded once, and the lanes of a chunk."""
        if source not in self._loaded:
            config = splat.SplatConfig(
                source,
                self._views.model,
                self._depth,
                self._views.has_range_views,
                self._with_index,
            )
            lister = None if source.sphere_of is None else splat_cuda.list_kernel(config)
            drawer = splat_cuda.chunk_kernel(config)
            for kernel in (lister, drawer):
                if kernel is not None:
                    wp.load_module(kernel.module, device=self._device)
            lanes = BLOCK // splat_cuda.points_of_lane(config)
            self._loaded[source] = lister, drawer, lanes
        return self._loaded[source]


def _whole_warps(threads: int) -> int:
    """Threads rounded up to whole warps."""
    return -(-threads // splat_cuda.WARP) * splat_cuda.WARP
