"""The peers: different ways to the same depth images, behind one protocol."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

import depthwarp as dw
from benchmarks.own_peers import OneCall, Plan, Prepared

__all__ = [
    "PEERS",
    "LeftOutError",
    "OneByOne",
    "Peer",
    "corner_matrix",
    "count_differing_pixels",
    "installed_peers",
]

Float32Array = npt.NDArray[np.float32]

SAME_DEPTH = 2e-6
"""Of the farthest depth in an image: depths that are closer are the same but for rounding."""


class Peer(Protocol):
    """One way from points and cameras to images of z depth, nearest point first.

    Attributes:
        is_batch: Whether many views are one call; else a call a view, and few views are timed.
        bytes_a_point: What it has to read of a point that it does not skip.
        atomics_a_point: On a GPU, at most, where it is known.
    """

    name: str
    version: str
    device: str
    is_batch: bool

    @property
    def bytes_a_point(self) -> float: ...

    @property
    def atomics_a_point(self) -> float | None: ...

    def prepare(
        self, points_world: Float32Array, cameras: Sequence[dw.PinholeCamera], max_range: float
    ) -> None:
        """Everything that a user with many views of one cloud does once; not timed."""

    def run(self) -> None:
        """Draw the images of all cameras and wait until they are done; timed."""

    def images(self) -> Sequence[Float32Array]:
        """Those of the last run [m], each shape (height, width), 0 where no point fell."""


class LeftOutError(Exception):
    """A peer cannot do the work here; the message says why."""


class OneByOne:
    """A peer that draws one view in a call: a loop over the views."""

    is_batch = False
    bytes_a_point = 12.0
    atomics_a_point = None

    def prepare(
        self, points_world: Float32Array, cameras: Sequence[dw.PinholeCamera], max_range: float
    ) -> None:
        self.load(points_world, max_range)
        self._views = [self.view(camera) for camera in cameras]

    def run(self) -> None:
        self._images = [self.draw(view) for view in self._views]

    def images(self) -> Sequence[Float32Array]:
        return self._images

    def load(self, points_world: Float32Array, max_range: float) -> None:
        """Keep the points as the peer wants them."""
        self._points, self._max_range = points_world, max_range

    def view(self, camera: dw.PinholeCamera) -> Any:
        """A camera as the peer wants it: a matrix (3, 4) float32 to (u z, v z, z), and the size."""
        return corner_matrix(camera).astype(np.float32), camera.size

    def draw(self, view: Any) -> Any:
        """The image of a view."""
        raise NotImplementedError


class NumPy(OneByOne):
    """NumPy in blocks that stay in a core's own cache, without a loop over points.

    One matrix takes a point to (u z, v z, z), so that the image's borders are tested by
    multiplication, and only the points inside it are divided.
    """

    name = "NumPy"
    version = np.__version__
    device = "cpu"
    block = 65536

    def draw(self, view: Any) -> Float32Array:
        matrix, (width, height) = view
        nearest = np.full(height * width, np.inf, dtype=np.float32)
        for first in range(0, len(self._points), self.block):
            points = self._points[first : first + self.block].T
            uz, vz, z = matrix[:, :3] @ points + matrix[:, 3:]
            inside = (uz >= 0) & (uz < width * z) & (vz >= 0) & (vz < height * z)
            drawn = np.flatnonzero(inside & (z <= self._max_range))
            z = z[drawn]
            # A quotient may be rounded up to the image's border.
            column = np.minimum((uz[drawn] / z).astype(np.intp), width - 1)
            row = np.minimum((vz[drawn] / z).astype(np.intp), height - 1)
            np.minimum.at(nearest, row * width + column, z)
        nearest[np.isinf(nearest)] = 0
        return nearest.reshape(height, width)


class Open3D(OneByOne):
    """Open3D's tensor point cloud, `project_to_depth_image`, on the CPU."""

    name = "Open3D"
    device = "cpu"

    def __init__(self) -> None:
        import open3d

        self.version = open3d.__version__
        self._open3d: Any = open3d

    def load(self, points_world: Float32Array, max_range: float) -> None:
        tensor = self._open3d.core.Tensor.from_numpy(points_world)
        self._cloud = self._open3d.t.geometry.PointCloud(tensor)
        self._max_range = max_range

    def view(self, camera: dw.PinholeCamera) -> Any:
        tensor = self._open3d.core.Tensor
        return {
            "width": camera.width,
            "height": camera.height,
            "intrinsics": tensor(camera.K),
            "extrinsics": tensor(camera.pose.optical_from_world),
            "depth_scale": 1.0,
            "depth_max": self._max_range,
        }

    def draw(self, view: Any) -> Float32Array:
        image: Float32Array = self._cloud.project_to_depth_image(**view).as_tensor().numpy()
        return image[:, :, 0]


def _numba(device: str) -> Peer:
    from benchmarks.numba_peer import Numba

    return Numba()


def _torch(device: str) -> Peer:
    from benchmarks.torch_peers import Torch

    return Torch(device)


def _pytorch3d(device: str) -> Peer:
    from benchmarks.torch_peers import PyTorch3D

    if device == "cpu":
        raise LeftOutError("on a CPU it tests every point against every pixel, which takes hours")
    return PyTorch3D(device)


PEERS: dict[str, Callable[[str], Peer]] = {
    "depthwarp": Plan,
    "prepared": Prepared,
    "dw.render": OneCall,
    "NumPy": lambda device: NumPy(),
    "numba": _numba,
    "torch": _torch,
    "PyTorch3D": _pytorch3d,
    "Open3D": lambda device: Open3D(),
}
"""What makes each peer, of the device that depthwarp renders on; depthwarp first."""


def installed_peers(device: str) -> tuple[list[Peer], list[str]]:
    """The peers that this machine has, and a line on each that is left out."""
    peers, left_out = [], []
    for name, make in PEERS.items():
        try:
            peers.append(make(device))
        except (ImportError, LeftOutError) as error:
            left_out.append(f"{name} is left out: {error}")
    return peers, left_out


def corner_matrix(camera: dw.PinholeCamera) -> npt.NDArray[np.float64]:
    """Takes a world point to (u z, v z, z), shape (3, 4); pixel corners are whole numbers."""
    to_corner = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    matrix: npt.NDArray[np.float64] = to_corner @ camera.K @ camera.pose.optical_from_world[:3]
    return matrix


def count_differing_pixels(image: Float32Array, reference: Float32Array) -> int:
    """Pixels whose depth is another point's: rounding moved a point over a pixel's border."""
    same = SAME_DEPTH * float(reference.max(initial=0))
    return int(np.count_nonzero(~(np.abs(image - reference) <= same)))
