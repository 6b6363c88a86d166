"""A rendering plan: buffers for a set of views, and the launches that fill them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from depthwarp import arrays
from depthwarp.depth_map import DepthMap, RenderStats
from depthwarp.devices import check_memory
from depthwarp.errors import InputError
from depthwarp.filters import DeviceMaps
from depthwarp.filters.maps import device_grids, pixel_grids
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.points import Points, points_of
from depthwarp.rendering.splatting import buffer_count, splatter_of
from depthwarp.rendering.views import DeviceViews, ViewPlan
from depthwarp_kernels import poses as pose_kernels

__all__ = ["MAP_BYTES", "RenderPlan"]

MAP_BYTES = 8 + 4 + 4 + 1  # a pixel: key, depth, index, state
DEPTH_BYTES = 4 + 4 + 1  # the same without an index


class RenderPlan:
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
        self._views = DeviceViews(views, config, device)
        self._cameras = [view.camera for view in views]
        self._config = config
        self._device = device
        width, height = self._views.size
        shape = (len(views), height, width)
        with_index = with_index or bool(config.filters)
        key_bytes = 8 if with_index else 4
        buffers = buffer_count(len(views), device, threads)
        pixel_bytes = MAP_BYTES if with_index else DEPTH_BYTES
        pixel_bytes += key_bytes * (buffers - 1)
        pixel_bytes += sum(step.scratch_bytes for step in config.filters)
        check_memory(
            f"a depth map of {width} x {height} pixels",
            len(views) * height * width * pixel_bytes,
            device,
            "choose a smaller size, or a larger q_depth_map",
        )
        self._splatter = splatter_of(
            self._views, config, device, with_index=with_index, threads=threads
        )
        self._maps = DeviceMaps(
            depth=arrays.empty(shape, wp.float32, device),
            index=arrays.empty(shape, wp.int32, device) if with_index else None,
            state=arrays.empty(shape, wp.uint8, device),
            grids=device_grids(self._cameras, device) if config.filters else None,
            threads=threads,
        )
        self._flat = [
            array.reshape((len(views), width * height))
            for array in (self._maps.depth, self._maps.index, self._maps.state)
            if array is not None
        ]
        self._filters = [step.build(self._maps) for step in config.filters]
        self._points: Points | None = None

    def render(self, cloud: Any) -> None:
        """Draw a cloud into all views.

        On CUDA it allocates nothing and does not synchronize: graph-capture safe once its kernels
        are loaded. On a CPU all cores work, and it returns when they are done.

        Args:
            cloud: Points [m], `wp.array` of `wp.vec3f`, shape (N,), or a `PreparedCloud`; on the
                plan's device.
        """
        splatter = self._splatter
        points = points_of(cloud)
        splatter.draw(points)
        splatter.resolve(*self._flat)
        for step in self._filters:
            step()
        self._points = points

    def look_from(self, views: Sequence[ViewPlan]) -> None:
        """Look from elsewhere: as many views, of the same camera model and size.

        Raises:
            InputError: Another number of views, another model or size.
        """
        self._views.replace(views)
        self._cameras = [view.camera for view in views]
        if self._maps.grids is not None:
            self._maps.grids.assign(pixel_grids(self._cameras))

    def look_from_device(self, optical_from_world: Any) -> None:
        """Look from poses that are on the device, `wp.array` of `wp.mat44f`, shape (V,)."""
        views = self._views.arrays[0]
        wp.launch(
            pose_kernels.look_from,
            dim=views.shape,
            inputs=[optical_from_world],
            outputs=[views],
            device=self._device,
        )

    @property
    def maps(self) -> DeviceMaps:
        """The maps of the last `render`, on the device."""
        return self._maps

    def stats(self) -> list[RenderStats]:
        """What became of the points of the last `render`, of each view; waits for the device."""
        return [_stats(self._points, counts) for counts in self._splatter.total_counts()]

    def depth_maps(self) -> list[DepthMap]:
        """The maps of the last `render`, copied to the host; waits for the device.

        Raises:
            InputError: The plan draws no index.
        """
        if self._maps.index is None:
            raise InputError("a DepthMap has an index: ask for the outputs 'depth' and 'index'")
        depth, index, state = (
            array.numpy() for array in (self._maps.depth, self._maps.index, self._maps.state)
        )
        return [
            DepthMap(
                depth=depth[v].copy(),
                index=index[v].copy(),
                state=state[v].copy(),
                camera=camera,
                kind=self._config.depth,
                min_range=self._config.min_range,
                max_range=self._config.max_range,
                stats=stats,
                filters=tuple(map(repr, self._config.filters)),
            )
            for v, (camera, stats) in enumerate(zip(self._cameras, self.stats(), strict=True))
        ]


def _stats(points: Points | None, counts: np.ndarray[Any, np.dtype[np.int64]]) -> RenderStats:
    if points is None:  # nothing was rendered yet
        return RenderStats(*[0] * 8)
    not_finite, behind, outside, too_far, too_near, drawn = (int(count) for count in counts)
    not_finite += points.not_finite
    dropped = not_finite + behind + outside + too_far + too_near
    return RenderStats(
        total=points.total,
        not_finite=not_finite,
        behind=behind,
        outside=outside,
        too_far=too_far,
        too_near=too_near,
        hidden=points.total - dropped - drawn,
        drawn=drawn,
    )
