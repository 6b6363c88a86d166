"""The splat of a plan on CUDA: one launch over all points and views."""

from __future__ import annotations

from typing import Any

import warp as wp

from depthwarp import arrays
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.points import Points
from depthwarp.rendering.views import DeviceViews
from depthwarp_kernels import resolve as resolving
from depthwarp_kernels import splat
from depthwarp_kernels.point_source import PointSource

__all__ = ["CudaSplatter"]


class CudaSplatter:
    """Draws points into key buffers of views.

    Args:
        views: The views, on the device.
        config: Depth kind and bounds.
        device: Warp device.
        with_index: Whether keys hold the winner's index, or its depth alone.

    Attributes:
        counts: What became of the points, shape (1, V, `COUNT_COLUMNS`), int64.
    """

    def __init__(
        self, views: DeviceViews, config: RenderConfig, device: Any, *, with_index: bool
    ) -> None:
        self._views, self._device, self._depth = views, device, config.depth
        self._with_index = with_index
        self._empty = splat.EMPTY_KEY if with_index else splat.EMPTY_DEPTH
        width, height = views.size
        key_type = wp.uint64 if with_index else wp.uint32
        self._keys = arrays.empty((views.count, width * height), key_type, device)
        self.counts = arrays.empty((1, views.count, splat.COUNT_COLUMNS), wp.int64, device)
        self._loaded: dict[PointSource, Any] = {}

    def draw(self, points: Points) -> None:
        """Clear the buffers and draw a cloud."""
        kernel = self._kernel(points.source)
        self.counts.zero_()
        self._keys.fill_(self._empty)
        if points.count:
            wp.launch(
                kernel,
                dim=(self._views.count, points.count),
                inputs=[*self._views.arrays, points.arrays, 0],
                outputs=[self._keys, self.counts[0]],
                device=self._device,
            )

    def resolve(self, *maps: Any) -> None:
        """Write what the keys hold: depth, index if they have it, and state, shape (V, pixels)."""
        wp.launch(
            resolving.resolve if self._with_index else resolving.resolve_depth,
            dim=self._keys.shape,
            inputs=[self._keys, 0],
            outputs=[*maps, self.counts[0]],
            device=self._device,
        )

    def _kernel(self, source: PointSource) -> Any:
        """The kernel for a kind of cloud, loaded once."""
        if source not in self._loaded:
            kernel = splat.splat_kernel(
                splat.SplatConfig(
                    source,
                    self._views.model,
                    self._depth,
                    self._views.has_range_views,
                    self._with_index,
                )
            )
            wp.load_module(kernel.module, device=self._device)
            self._loaded[source] = kernel
        return self._loaded[source]
