"""depthwarp as a peer: a kept plan, a prepared cloud, and the one call."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
import numpy.typing as npt
import warp as wp

import depthwarp as dw
from depthwarp.arrays import share_points
from depthwarp.devices import resolve_device
from depthwarp.rendering import RenderConfig, RenderPlan, ViewPlan
from depthwarp_kernels.point_source import BLOCK

__all__ = ["OneCall", "Plan", "Prepared", "PreparedDepths"]

Float32Array = npt.NDArray[np.float32]

ROW_BYTES, SPHERE_BYTES = 4, 16


class _Own:
    """What depthwarp's peers share."""

    version = dw.__version__
    is_batch = True

    def __init__(self, device: str) -> None:
        self.device = device

    @property
    def bytes_a_point(self) -> float:
        return 12.0

    def depth_maps(self) -> Sequence[dw.DepthMap]:
        raise NotImplementedError

    def images(self) -> Sequence[Float32Array]:
        return [depth_map.depth for depth_map in self.depth_maps()]

    @property
    def atomics_a_point(self) -> float | None:
        """On a GPU: one minimum for each point in an image; those that a read spares count, too."""
        if self.device == "cpu":
            return None
        stats = [depth_map.stats for depth_map in self.depth_maps()]
        return sum(s.drawn + s.hidden for s in stats) / sum(s.total for s in stats)


class Plan(_Own):
    """depthwarp with the points on the device and the buffers allocated: splat and resolve.

    Besides the depth it writes the index of the winning point, the state and the counts.
    """

    name = "depthwarp"
    with_index = True

    def __init__(self, device: str, threads: int | None = None) -> None:
        super().__init__(device)
        self._threads = threads

    def prepare(
        self, points_world: Float32Array, cameras: Sequence[dw.PinholeCamera], max_range: float
    ) -> None:
        device = resolve_device(self.device)
        self._points = share_points(points_world, device)
        config = RenderConfig(depth="z", max_range=max_range)
        views = [ViewPlan(camera) for camera in cameras]
        self._plan = RenderPlan(
            views, config, device, with_index=self.with_index, threads=self._threads
        )

    def run(self) -> None:
        self._plan.render(self._points)
        wp.synchronize_device(self.device)

    def depth_maps(self) -> Sequence[dw.DepthMap]:
        return self._plan.depth_maps()


class Prepared(Plan):
    """The same with a cloud in spatial order, `cloud.prepare()`, made before."""

    name = "prepared"

    @property
    def bytes_a_point(self) -> float:
        """With the caller's row, and a block's sphere."""
        return float(self._points.bytes_per_point + ROW_BYTES + SPHERE_BYTES / BLOCK)

    def prepare(
        self, points_world: Float32Array, cameras: Sequence[dw.PinholeCamera], max_range: float
    ) -> None:
        super().prepare(points_world, cameras, max_range)
        self._points = dw.PointCloud(points_world).prepare(device=self.device)


class PreparedDepths(Prepared):
    """A prepared cloud, the depth alone: no index."""

    name = "prepared, depth"
    with_index = False

    def images(self) -> Sequence[Float32Array]:
        return list(self._plan.maps.depth.numpy())


class OneCall(_Own):
    """`dw.render`, or `dw.render_batch` of many views: from the host to the host, nothing kept."""

    name = "dw.render"

    def prepare(
        self, points_world: Float32Array, cameras: Sequence[dw.PinholeCamera], max_range: float
    ) -> None:
        self._cloud, self._cameras, self._max_range = (
            dw.PointCloud(points_world),
            cameras,
            max_range,
        )

    def run(self) -> None:
        if len(self._cameras) == 1:
            self._maps: Iterable[dw.DepthMap] = [
                dw.render(
                    self._cloud,
                    self._cameras[0],
                    depth="z",
                    max_range=self._max_range,
                    device=self.device,
                )
            ]
            return
        self._maps = dw.render_batch(
            self._cloud, self._cameras, depth="z", max_range=self._max_range, device=self.device
        )

    def depth_maps(self) -> Sequence[dw.DepthMap]:
        return list(self._maps)
