"""The nearer of two renderers: ours of points, and another one's."""

from __future__ import annotations

from typing import Any

import warp as wp

from depthwarp import arrays
from depthwarp.filters.maps import DeviceMaps
from depthwarp.filters.rows import row_launch
from depthwarp.rendering.config import RenderConfig
from depthwarp_kernels.sim_compose import compose_kernel

__all__ = ["Composition"]


class Composition:
    """Keeps the nearer depth of maps and of images of another renderer.

    Args:
        maps: The maps that are changed.
        config: Bounds, which the other images' depths have to be within as well.
    """

    def __init__(self, maps: DeviceMaps, config: RenderConfig) -> None:
        self._maps, self._config = maps, config
        names = {"index": wp.int32, "state": wp.uint8}
        written = frozenset(name for name in names if getattr(maps, name) is not None)
        self._kernel = compose_kernel(written)
        self._arrays = [
            maps.depth,
            *(
                getattr(maps, name)
                if name in written
                else arrays.zeros((1, 1, 1), dtype, maps.depth.device)
                for name, dtype in names.items()
            ),
        ]
        wp.load_module(self._kernel.module, device=maps.depth.device)

    def keep_nearer(self, other: Any) -> None:
        """Take other depths where they are nearer, float32, as many as the maps have."""
        row_launch(
            self._kernel,
            self._maps,
            [other.reshape(self._maps.depth.shape), self._config.min_range, self._config.max_range],
            self._arrays,
        )()
