"""What all plans share: cameras that can look from elsewhere, and maps that come to the host."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp.depth_map import DepthMap, RenderStats
from depthwarp.filters import DeviceMaps
from depthwarp.filters.blind import blind_pixels, device_blind_pixels
from depthwarp.filters.chain import build_steps
from depthwarp.filters.maps import device_grids, pixel_grids
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.views import DeviceViews, ViewPlan
from depthwarp_kernels import poses as pose_kernels

__all__ = ["NO_INDEX", "LookingPlan", "stats_of"]

NO_INDEX = "a DepthMap has an index: ask for the outputs 'depth' and 'index'"


class LookingPlan:
    """Views of one lens model and size, and their maps on the device.

    Args:
        views: Where they look from and through which lens.
        config: Depth kind, bounds and filters.
        device: Warp device.
        culls: As in `DeviceViews`.

    Attributes:
        maps: The maps of the last drawing, shape (V, H, W); set by the plan.
    """

    maps: DeviceMaps
    _filters: list[Callable[[], None]]

    def __init__(
        self, views: Sequence[ViewPlan], config: RenderConfig, device: Any, *, culls: bool
    ) -> None:
        self._views = DeviceViews(views, config, device, culls=culls)
        self._cameras = [view.camera for view in views]
        self._config, self._device = config, device

    @property
    def device_views(self) -> DeviceViews:
        """The views as kernels read them."""
        return self._views

    def look_from(self, views: Sequence[ViewPlan]) -> None:
        """Look from elsewhere: as many views, of the same camera model and size.

        Raises:
            InputError: Another number of views, another model or size.
        """
        self._views.replace(views)
        self._cameras = [view.camera for view in views]
        if self.maps.grids is not None:
            self.maps.grids.assign(pixel_grids(self._cameras))
            self._spare_blind(blind_pixels(self._cameras, self._config.depth))

    def _lens_arrays(self) -> dict[str, Any]:
        """What filters know of the lenses, as of `DeviceMaps`; nothing without filters."""
        if not self._config.filters:
            return {}
        return {
            "grids": device_grids(self._cameras, self._device),
            "blind": device_blind_pixels(self._cameras, self._config.depth, self._device),
        }

    def _spare_blind(self, blind: npt.NDArray[np.uint32] | None) -> None:
        """Let the filters spare the pixels for which other lenses have no ray."""
        if self.maps.blind is not None and blind is None:
            self.maps.blind.zero_()
        elif self.maps.blind is not None:
            self.maps.blind.assign(blind)
        elif blind is not None:  # so far all pixels had one
            on_device: Any = wp.array(blind, dtype=wp.uint32, device=self._device)
            self.maps = replace(self.maps, blind=on_device)
            self._filters = build_steps(self._config.filters, self.maps)

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

    def _depth_maps(
        self,
        depth: npt.NDArray[Any],
        index: npt.NDArray[Any],
        state: npt.NDArray[Any],
        stats: Iterable[RenderStats],
    ) -> list[DepthMap]:
        """Maps of the host, as many as there are stats; each owns its arrays."""
        return [
            DepthMap(
                depth=depth[v].copy(),
                index=index[v].copy(),
                state=state[v].copy(),
                camera=self._cameras[v],
                kind=self._config.depth,
                min_range=self._config.min_range,
                max_range=self._config.max_range,
                stats=of_view,
                filters=tuple(map(repr, self._config.filters)),
            )
            for v, of_view in enumerate(stats)
        ]


def stats_of(counts: npt.NDArray[Any], total: int, left_out: int = 0) -> RenderStats:
    """What became of the points of one view, from its row of counts.

    Args:
        counts: In the order of the splat's columns.
        total: All points of the cloud.
        left_out: Those of them that are not finite and were never drawn.
    """
    not_finite, behind, outside, too_far, too_near, drawn = counts.tolist()
    not_finite += left_out
    return RenderStats(
        total=total,
        not_finite=not_finite,
        behind=behind,
        outside=outside,
        too_far=too_far,
        too_near=too_near,
        hidden=total - (not_finite + behind + outside + too_far + too_near + drawn),
        drawn=drawn,
    )
