"""Occlusion culling on a CPU: the nearest blocks first, then of the others those not hidden."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import warp as wp

from depthwarp import arrays
from depthwarp.rendering.views import DeviceViews
from depthwarp_kernels import occlusion
from depthwarp_kernels.point_source import BLOCK
from depthwarp_kernels.splat import SplatConfig

__all__ = ["Occlusion"]

DENSE = 32
"""Points a pixel from which it pays: below, too many tiles have a pixel without a near point."""

ROUNDS = (0.0, 0.25, 0.5, 1.0)
"""Shares of the blocks, by distance, after which it is asked again what is hidden."""


class Occlusion:
    """Finds which blocks of a prepared cloud cannot win a pixel any more.

    Args:
        views: The views.
        config: What the splat of these views is compiled for; its lens has `bounds`.
        device: Warp's CPU.
    """

    def __init__(self, views: DeviceViews, config: SplatConfig, device: Any) -> None:
        self._views, self._device = views, device
        width, height = views.size
        self._tiles = -(-height // occlusion.TILE), -(-width // occlusion.TILE)
        self._config = config
        self._kernels: list[Any] = []

    def may_pay(self, blocks: int) -> bool:
        """Whether a cloud of so many blocks is worth asking; the kernels are loaded then."""
        if not self._is_dense(blocks):
            return False
        self._load()
        return True

    def rounds(
        self, source: Any, view: int, keys: Any, seen: Any, count: int
    ) -> Iterator[tuple[Any, int]]:
        """Lists of blocks to draw and their lengths; each has to be drawn before the next is asked.

        Args:
            source: The cloud's struct.
            view: Number of the view.
            keys: Buffers that the blocks are drawn into, shape (buffers, cells).
            seen: Blocks in view, as `cull_blocks` lists them.
            count: Their number.
        """
        if not self._is_dense(count):
            yield seen, count
            return
        seen, near = self._by_rounds(source, view, seen, count)
        bounds = [round(count * share) for share in ROUNDS]
        for first, end in zip(bounds, bounds[1:], strict=False):
            if first == 0:
                yield seen, end
            else:
                yield self._without_hidden(source, view, keys, seen, near, first, end)

    def _is_dense(self, blocks: int) -> bool:
        """Whether so many blocks in view are enough points a pixel."""
        width, height = self._views.size
        return blocks * BLOCK >= DENSE * width * height

    def _load(self) -> None:
        """Look the kernels up, the first time that a cloud is large enough."""
        if self._kernels:
            return
        self._kernels = [
            make(self._config)
            for make in (occlusion.near_kernel, occlusion.tile_kernel, occlusion.hide_kernel)
        ]
        for kernel in self._kernels:
            wp.load_module(kernel.module, device=self._device)

    def _by_rounds(self, source: Any, view: int, seen: Any, count: int) -> tuple[Any, Any]:
        """The list, those of nearer rounds first, and lower bounds of the depths [m].

        Within a round the order stays: neighbours in memory are neighbours in the image.
        """
        near = arrays.empty(count, wp.float32, self._device)
        wp.launch(
            self._kernels[0],
            dim=count,
            inputs=[self._views.arrays[0], view, source, seen],
            outputs=[near],
            device=self._device,
        )
        depths = near.numpy()
        sample = np.sort(depths[::16])  # not NumPy's quantile, which takes no infinite depths
        limits = [sample[int(len(sample) * share)] for share in ROUNDS[1:-1]]
        order = np.argsort(np.searchsorted(limits, depths).astype(np.uint8), kind="stable")
        return (
            wp.array(seen.numpy()[:count][order], dtype=wp.int32, device=self._device),
            wp.array(near.numpy()[order], dtype=wp.float32, device=self._device),
        )

    def _without_hidden(
        self, source: Any, view: int, keys: Any, seen: Any, near: Any, first: int, end: int
    ) -> tuple[Any, int]:
        """Blocks of a part of the list that may still win a pixel, and their number."""
        width, height = self._views.size
        farthest = arrays.empty(self._tiles, wp.float32, self._device)
        wp.launch(
            self._kernels[1],
            dim=self._tiles,
            inputs=[keys, width, height],
            outputs=[farthest],
            device=self._device,
        )
        left = arrays.zeros(end - first, wp.int32, self._device)
        length = arrays.zeros(1, wp.int32, self._device)
        wp.launch(
            self._kernels[2],
            dim=1,
            inputs=[*self._views.arrays[:2], view, source, seen, near, first, end, farthest],
            outputs=[left, length],
            device=self._device,
        )
        return left, int(length.numpy()[0])
