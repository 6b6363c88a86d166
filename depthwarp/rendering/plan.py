"""A rendering plan: buffers for a set of views, and the launches that fill them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import warp as wp

from depthwarp import arrays
from depthwarp.depth_map import DepthMap, RenderStats
from depthwarp.devices import check_memory
from depthwarp.errors import InputError
from depthwarp.filters import DeviceMaps
from depthwarp.filters.chain import build_steps
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.looking import NO_INDEX, LookingPlan, stats_of
from depthwarp.rendering.points import Points, points_of
from depthwarp.rendering.splatting import buffer_count, splatter_of
from depthwarp.rendering.views import ViewPlan

__all__ = ["MAP_BYTES", "RenderPlan"]

MAP_BYTES = 8 + 4 + 4 + 1  # a pixel: key, depth, index, state


class RenderPlan(LookingPlan):
    """Owns the buffers of V views of one lens model and size; `render` draws a cloud into them.

    Args:
        views: What to render, all of one camera model and image size, all with or all without
            segmentation.
        config: Depth kind, bounds and filters.
        device: Warp device.
        with_index: Whether the maps say which point won. Depth alone takes half of the Z-buffer and
            less time; filters need the index, so with them it is always there.
        threads: Threads on a CPU; None for all cores that this process may use.

    Raises:
        InputError: Views of different models or sizes, with and without segmentation, or none; or
            a model without the kind of depth that is asked for.
        CapacityError: The buffers do not fit the device.
    """

    def __init__(
        self,
        views: Sequence[ViewPlan],
        config: RenderConfig,
        device: Any,
        *,
        with_index: bool = True,
        threads: int | None = None,
    ) -> None:
        super().__init__(views, config, device, culls=True)
        width, height = self._views.size
        shape = (len(views), height, width)
        with_index = with_index or bool(config.filters)
        map_bytes = sum((4, 4, 1) if with_index else (4, 1))
        map_bytes += sum(step.scratch_bytes for step in config.filters)
        buffers = buffer_count(len(views), device, threads)
        check_memory(
            f"a depth map of {width} x {height} pixels",
            height * width * (len(views) * map_bytes + buffers * (8 if with_index else 4)),
            device,
            "choose a smaller size, or a larger q_depth_map",
        )
        self._splatter = splatter_of(
            self._views, config, device, with_index=with_index, threads=threads
        )
        self.maps = DeviceMaps(
            depth=arrays.empty(shape, wp.float32, device),
            index=arrays.empty(shape, wp.int32, device) if with_index else None,
            state=arrays.empty(shape, wp.uint8, device),
            threads=threads,
            **self._lens_arrays(),
        )
        self._flat = [
            array.reshape((len(views), width * height))
            for array in (self.maps.depth, self.maps.index, self.maps.state)
            if array is not None
        ]
        self._filters = build_steps(config.filters, self.maps)
        self._points: Points | None = None

    def render(self, cloud: Any) -> None:
        """Draw a cloud into all views.

        On CUDA it allocates nothing and does not synchronize: graph-capture safe once its kernels
        are loaded. On a CPU all cores work, and it returns when they are done.

        Args:
            cloud: Points [m], `wp.array` of `wp.vec3f`, shape (N,), or a `PreparedCloud`; on the
                plan's device.
        """
        points = points_of(cloud)
        self._splatter.render(points, *self._flat)
        for step in self._filters:
            step()
        self._points = points

    def stats(self) -> list[RenderStats]:
        """What became of the points of the last `render`, of each view; waits for the device."""
        points = self._points
        if points is None:  # nothing was rendered yet
            return [RenderStats(*[0] * 8)] * self._views.count
        return [
            stats_of(counts, points.total, points.not_finite)
            for counts in self._splatter.total_counts()
        ]

    def depth_maps(self) -> list[DepthMap]:
        """The maps of the last `render`, copied to the host; waits for the device.

        Raises:
            InputError: The plan draws no index.
        """
        if self.maps.index is None:
            raise InputError(NO_INDEX)
        depth, index, state = (
            array.numpy() for array in (self.maps.depth, self.maps.index, self.maps.state)
        )
        return self._depth_maps(depth, index, state, self.stats())
