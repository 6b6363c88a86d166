"""A plan for many clouds at once: views that each look at one of the clouds in one array."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from depthwarp import arrays
from depthwarp.depth_map import DepthMap, State
from depthwarp.devices import check_memory, usable_cores
from depthwarp.errors import InputError
from depthwarp.filters import DeviceMaps
from depthwarp.filters.chain import build_steps
from depthwarp.prepared import PreparedCloud
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.looking import NO_INDEX, LookingPlan, stats_of
from depthwarp.rendering.points import points_of
from depthwarp.rendering.ragged_splatting import CpuViews, CudaViews, needs_keys
from depthwarp.rendering.views import ViewPlan
from depthwarp_kernels import ragged, spans, splat
from depthwarp_kernels.point_source import PLAIN

__all__ = ["OUTPUTS", "RaggedPlan"]

OUTPUTS: dict[str, Any] = {"depth": wp.float32, "index": wp.int32, "state": wp.uint8}
"""What can be asked for, and its type on the device."""

OUTPUT_BYTES = {"depth": 4, "index": 4, "state": 1}


class RaggedPlan(LookingPlan):
    """Owns the buffers of V views of one lens model and size; each draws a cloud of its own.

    The clouds lie in one array of points, one behind the other. On a CPU a thread clears, draws and
    resolves one view after the other in a key buffer that stays in its cache; threads share the
    views. The result, bit for bit and count for count, is that of `RenderPlan` for each view and
    its cloud alone, for any number of threads.

    Args:
        views: What to render, all of one camera model and image size, all with or all without
            segmentation.
        config: Depth kind, bounds and filters.
        outputs: Which maps are written, names of `OUTPUTS`; no others are allocated, unless there
            are filters, which work on all of them.
        device: Warp device.
        threads: Threads on a CPU; None for all cores that this process may use.
        static: A prepared cloud that all views see besides their own; its indices come first. Of
            its points nothing is counted.

    Attributes:
        maps: The maps of the last `render`, shape (V, H, W); None for one that was not asked for.

    Raises:
        InputError: Views of different models or sizes, with and without segmentation, or none; or
            a model without the kind of depth that is asked for.
        CapacityError: The buffers do not fit the device.
    """

    def __init__(
        self,
        views: Sequence[ViewPlan],
        config: RenderConfig,
        outputs: Sequence[str],
        device: Any,
        threads: int | None = None,
        *,
        static: PreparedCloud | None = None,
    ) -> None:
        super().__init__(views, config, device, culls=static is not None)
        self._threads = 1 if device.is_cuda else threads or usable_cores()
        written = frozenset(OUTPUTS if config.filters else outputs)
        width, height = self._views.size
        self._pixels = width * height
        source = splat.SplatConfig(
            PLAIN, self._views.model, config.depth, self._views.has_range_views
        )
        under = None if static is None else points_of(static)
        ragged_config = ragged.RaggedConfig(
            source, written, None if under is None else under.source
        )
        self._check_memory(ragged_config)
        shape = (len(views), height, width)
        own = {
            name: arrays.zeros(shape, OUTPUTS[name], device) if name in written else None
            for name in OUTPUTS
        }
        self.maps = DeviceMaps(**own, threads=threads, **self._lens_arrays())
        flat = [
            arrays.zeros((1, 1), OUTPUTS[name], device)  # kernels take no empty array
            if array is None
            else array.reshape((len(views), self._pixels))
            for name, array in own.items()
        ]
        self._filters = build_steps(config.filters, self.maps)
        self._counts = arrays.zeros((len(views), ragged.RAGGED_COLUMNS), wp.int64, device)
        self._no_points = arrays.zeros(1, wp.vec3f, device)
        self._spans: Any = None
        drawn = (self._views, ragged_config, flat, self._counts, under)
        self._splatter: CpuViews | CudaViews = (
            CudaViews(*drawn) if device.is_cuda else CpuViews(*drawn, self._threads)
        )

    def render(self, points: Any, offsets: Any, cloud_of: Any, count: int | None = None) -> None:
        """Draw into each view the cloud that it looks at.

        It allocates nothing; on CUDA it does not synchronize and is graph-capture safe. On a CPU
        all cores work, and it returns when they are done. The numbers of `offsets` and `cloud_of`
        are not checked: a view of a cloud that there is not stays empty, and a cloud ends at
        the latest with the points.

        Args:
            points: All clouds' points [m], `wp.array` of `wp.vec3f`, shape (N,).
            offsets: First point of each cloud, and the end of the last, `wp.int32`, shape (C + 1,).
            cloud_of: The cloud that each view looks at, `wp.int32`, shape (V,).
            count: Draw only so many views, the first ones; the others' maps are left as they are.
        """
        clouds = offsets.shape[0] - 1
        if self._spans is None or self._spans.shape[0] != clouds:
            self._spans = arrays.empty(clouds, wp.vec2i, self._device)
        wp.launch(
            spans.spans_of_offsets,
            dim=clouds,
            inputs=[offsets, points.shape[0]],
            outputs=[self._spans],
            device=self._device,
        )
        self.draw(points, self._spans, cloud_of, count)

    def draw(self, points: Any, clouds: Any, cloud_of: Any, count: int | None = None) -> None:
        """As `render`, of clouds whose begin and end are known, `wp.vec2i`, shape (C,)."""
        own = points if points.shape[0] else self._no_points
        views = self._views.count if count is None else count
        self._splatter.draw(own, clouds, cloud_of, views)
        for step in self._filters:
            step()

    def depth_maps(self, count: int | None = None) -> list[DepthMap]:
        """The maps of the last `render`, of all views or so many of the first.

        Copied to the host; waits for the device. Each map owns its arrays.

        Raises:
            InputError: Depth and index were not both asked for.
        """
        maps = self.maps
        if maps.depth is None or maps.index is None:
            raise InputError(NO_INDEX)
        depth, index = maps.depth.numpy(), maps.index.numpy()
        # Without filters, which work on all maps, a pixel is measured where there is a winner.
        if maps.state is None:
            state = np.where(index >= 0, State.MEASURED, State.EMPTY).astype(np.uint8)
        else:
            state = maps.state.numpy()
        rows = self._counts.numpy()[:count]
        return self._depth_maps(
            depth, index, state, [stats_of(row[:-1], int(row[-1])) for row in rows]
        )

    def _check_memory(self, config: ragged.RaggedConfig) -> None:
        width, height = self._views.size
        views = self._views.count
        a_pixel = sum(OUTPUT_BYTES[name] for name in config.outputs)
        a_pixel += sum(step.scratch_bytes for step in self._config.filters)
        images = self._threads
        if self._device.is_cuda:
            images = views if needs_keys(config, self._pixels) else 0
        check_memory(
            f"{views} depth maps of {width} x {height} pixels",
            self._pixels * (views * a_pixel + 8 * images),
            self._device,
            "render fewer views at a time, or smaller ones",
        )
