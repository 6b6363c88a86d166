"""The peers: different ways to the same depth image, behind one protocol."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import warp as wp

import depthwarp as dw
from depthwarp.arrays import share_points
from depthwarp.devices import resolve_device
from depthwarp.rendering import RenderConfig, RenderPlan, ViewPlan

__all__ = ["Peer", "count_differing_pixels", "installed_peers"]

Float32Array = npt.NDArray[np.float32]

SAME_DEPTH_M = 1e-5
"""Depths of one pixel that are closer are the same but for rounding."""


class Peer(Protocol):
    """One way from points and a camera to an image of z depth, nearest point first."""

    name: str
    version: str
    device: str

    def prepare(
        self, points_world: Float32Array, camera: dw.PinholeCamera, max_range: float
    ) -> None:
        """Everything that a user with many views of one cloud does once; not timed."""

    def run(self) -> None:
        """Draw one image and wait until it is done; timed."""

    def image(self) -> Float32Array:
        """The image of the last run [m], shape (height, width), 0 where no point fell."""


class Plan:
    """depthwarp with the points on the device and the buffers allocated: splat and resolve.

    Besides the depth it writes the index of the winning point, the state and the counts.
    """

    name = "depthwarp"
    version = dw.__version__

    def __init__(self, device: str) -> None:
        self.device = device

    def prepare(
        self, points_world: Float32Array, camera: dw.PinholeCamera, max_range: float
    ) -> None:
        device = resolve_device(self.device)
        self._points = share_points(points_world, device)
        config = RenderConfig(depth="z", max_range=max_range)
        self._plan = RenderPlan([ViewPlan(camera)], config, device)

    def run(self) -> None:
        self._plan.render(self._points)
        wp.synchronize_device(self.device)

    def image(self) -> Float32Array:
        return self._plan.depth_maps()[0].depth


class Prepared(Plan):
    """The same with a cloud in spatial order, `cloud.prepare()`, made before."""

    name = "prepared"

    def prepare(
        self, points_world: Float32Array, camera: dw.PinholeCamera, max_range: float
    ) -> None:
        super().prepare(points_world, camera, max_range)
        self._points = dw.PointCloud(points_world).prepare(device=self.device)


class OneCall:
    """`dw.render`, from a cloud on the host to a `DepthMap` on the host, nothing kept between."""

    name = "dw.render"
    version = dw.__version__

    def __init__(self, device: str) -> None:
        self.device = device

    def prepare(
        self, points_world: Float32Array, camera: dw.PinholeCamera, max_range: float
    ) -> None:
        self._cloud, self._camera, self._max_range = dw.PointCloud(points_world), camera, max_range

    def run(self) -> None:
        self._map = dw.render(
            self._cloud,
            self._camera,
            depth="z",
            max_range=self._max_range,
            device=self.device,
        )

    def image(self) -> Float32Array:
        return self._map.depth


class NumPy:
    """NumPy in blocks that stay in a core's own cache, without a loop over points.

    One matrix takes a point to (u z, v z, z), so that the image's borders are tested by
    multiplication, and only the points inside it are divided.
    """

    name = "NumPy"
    version = np.__version__
    device = "cpu"
    block = 65536

    def prepare(
        self, points_world: Float32Array, camera: dw.PinholeCamera, max_range: float
    ) -> None:
        to_corner = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])  # pixel corners at integers
        transform = to_corner @ camera.K @ camera.pose.optical_from_world[:3]
        self._rotation = transform[:, :3].astype(np.float32)
        self._translation = transform[:, 3:].astype(np.float32)
        self._points = points_world
        self._size, self._max_range = camera.size, max_range

    def run(self) -> None:
        width, height = self._size
        nearest = np.full(height * width, np.inf, dtype=np.float32)
        for first in range(0, len(self._points), self.block):
            points = self._points[first : first + self.block].T
            uz, vz, z = self._rotation @ points + self._translation
            inside = (uz >= 0) & (uz < width * z) & (vz >= 0) & (vz < height * z)
            drawn = np.flatnonzero(inside & (z <= self._max_range))
            z = z[drawn]
            column, row = (uz[drawn] / z).astype(np.intp), (vz[drawn] / z).astype(np.intp)
            np.minimum.at(nearest, row * width + column, z)
        nearest[np.isinf(nearest)] = 0
        self._depth = nearest.reshape(height, width)

    def image(self) -> Float32Array:
        return self._depth


class Open3D:
    """Open3D's tensor point cloud, `project_to_depth_image`, on the CPU."""

    name = "Open3D"
    device = "cpu"

    def __init__(self) -> None:
        import open3d

        self.version = open3d.__version__
        self._open3d: Any = open3d

    def prepare(
        self, points_world: Float32Array, camera: dw.PinholeCamera, max_range: float
    ) -> None:
        tensor = self._open3d.core.Tensor
        self._cloud = self._open3d.t.geometry.PointCloud(tensor.from_numpy(points_world))
        self._view = {
            "width": camera.width,
            "height": camera.height,
            "intrinsics": tensor(camera.K),
            "extrinsics": tensor(camera.pose.optical_from_world),
            "depth_scale": 1.0,
            "depth_max": max_range,
        }

    def run(self) -> None:
        self._image = self._cloud.project_to_depth_image(**self._view)

    def image(self) -> Float32Array:
        return self._image.as_tensor().numpy()[:, :, 0]


def installed_peers(device: str) -> tuple[list[Peer], list[str]]:
    """The peers that this machine has, depthwarp first, and a line on each that it has not."""
    peers: list[Peer] = [Plan(device), Prepared(device), OneCall(device), NumPy()]
    left_out = []
    for name, make in (("numba", _numba), ("open3d", Open3D)):
        try:
            peers.append(make())
        except ImportError as error:
            left_out.append(f"{name} is left out: {error} (pip install {name})")
    return peers, left_out


def _numba() -> Peer:
    from benchmarks.numba_peer import Numba

    return Numba()


def count_differing_pixels(image: Float32Array, reference: Float32Array) -> int:
    """Pixels whose depth is another point's: rounding moved a point over a pixel's border."""
    return int(np.count_nonzero(~(np.abs(image - reference) <= SAME_DEPTH_M)))
