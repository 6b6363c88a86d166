"""A cloud in spatial order, in blocks that a view can skip: for many views of one cloud."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import warp as wp

from depthwarp import arrays
from depthwarp.devices import check_memory, resolve_device, usable_cores
from depthwarp.threads import thread_pool
from depthwarp_kernels import point_source, prepare

if TYPE_CHECKING:
    from depthwarp.cloud import PointCloud

__all__ = ["PreparedCloud"]

POINT_BYTES = 12 + 4 + 16
"""Bytes a point while a cloud is prepared: coordinates, index, and the sort's two pairs."""


class PreparedCloud:
    """A point cloud sorted along a Hilbert curve, in blocks of 512 points with a sphere round each.

    A view skips the blocks that its image cannot show; what is left lies close together in memory
    and in the image. Maps are, bit for bit and count for count, those of the cloud itself, and
    `index` is the caller's row. Source of the order: Skilling, Programming the Hilbert curve, 2004.

    Args:
        cloud: The cloud; it is copied, and may be let go.
        device: Where it will be rendered; None is Warp's default device.

    Raises:
        DeviceError: The device is not on this machine.
        CapacityError: It does not fit the device's memory.

    Example:
        >>> import numpy as np, depthwarp as dw
        >>> cloud = dw.PointCloud(np.random.default_rng(0).random((10_000, 3), np.float32))
        >>> chunks = cloud.prepare(device="cpu")
        >>> chunks
        PreparedCloud(10000 points in 20 blocks on cpu)
        >>> camera = dw.EquirectangularCamera.looking((90, 45), position=(0.5, 0.5, 0.5))
        >>> dw.render(chunks, camera).stats == dw.render(cloud, camera, device="cpu").stats
        True
    """

    def __init__(self, cloud: PointCloud, device: str | None = None) -> None:
        self.device = resolve_device(device)
        self._count = len(cloud)
        check_memory(
            f"preparing {self._count} points",
            POINT_BYTES * self._count,
            self.device,
            "prepare the cloud in parts",
        )
        points = arrays.share_points(cloud.points_world, self.device)
        low, high, finite = _extent(cloud.points_world)
        self.not_finite = self._count - finite
        order = _spatial_order(points, low, high, self.device)
        self.blocks = -(-finite // point_source.BLOCK)
        self.source = _blocks_of(points, order, finite, self.blocks, self.device)
        self.finite = finite

    def __len__(self) -> int:
        """Number of points of the cloud, those that are not finite included."""
        return self._count

    def __repr__(self) -> str:
        """Numbers of points and blocks."""
        return f"PreparedCloud({len(self)} points in {self.blocks} blocks on {self.device.alias})"


def _extent(points_world: np.ndarray[Any, np.dtype[np.float32]]) -> tuple[Any, Any, int]:
    """Lowest and highest coordinates of the finite points, and their number."""
    columns = [points_world[:, axis] for axis in range(3)]  # NumPy is slow along an axis of three
    finite = np.isfinite(columns[0])
    for column in columns[1:]:
        finite &= np.isfinite(column)
    count = int(np.count_nonzero(finite))
    if count == 0:
        return np.zeros(3), np.zeros(3), 0
    low = np.array([column.min(where=finite, initial=np.inf) for column in columns])
    high = np.array([column.max(where=finite, initial=-np.inf) for column in columns])
    return low, high, count


def _spatial_order(points: Any, low: Any, high: Any, device: Any) -> Any:
    """Rows of the cloud along the curve, those that are not finite last, `wp.int32`."""
    count = points.shape[0]
    codes = arrays.empty(2 * count, wp.int32, device)  # radix sort needs room for a second copy
    order = arrays.empty(2 * count, wp.int32, device)
    side = float(np.max(high.astype(np.float64) - low))
    scale = ((1 << prepare.AXIS_BITS) - 1) / side if side > 0 else 0.0
    _launch(prepare.curve_codes, count, [points, wp.vec3f(*low), scale], [codes, order], device)
    if count:
        wp.utils.radix_sort_pairs(codes, order, count)
    return order


def _blocks_of(points: Any, order: Any, finite: int, blocks: int, device: Any) -> Any:
    """The struct that kernels take: coordinates apart, what fills up the last block is NaN."""
    padded = blocks * point_source.BLOCK
    source: Any = point_source.PreparedPoints()
    source.x, source.y, source.z = (arrays.empty(padded, wp.float32, device) for _ in range(3))
    source.original = arrays.empty(padded, wp.int32, device)
    source.spheres = arrays.empty(blocks, wp.vec4f, device)
    groups = -(-blocks // point_source.GROUP)
    source.groups = arrays.empty(groups, wp.vec4f, device)
    if finite < padded:
        for axis in (source.x, source.y, source.z):
            axis[finite:].fill_(wp.nan)
    parts = [source.x, source.y, source.z, source.original]
    _launch(prepare.take_apart, finite, [points, order], parts, device, finite)
    _launch(prepare.block_spheres, blocks, parts[:3], [source.spheres], device, finite)
    _launch(prepare.group_spheres, groups, [source.spheres], [source.groups], device, blocks)
    return source


def _launch(
    kernel: Any, count: int, inputs: list[Any], outputs: list[Any], device: Any, *more: Any
) -> None:
    """Launch over `count` threads; on a CPU in as many parts as there are cores."""
    parts = 1 if device.is_cuda else usable_cores()
    bounds = [count * part // parts for part in range(parts + 1)]
    wp.load_module(kernel.module, device=device)

    def launch(part: int) -> None:
        first, size = bounds[part], bounds[part + 1] - bounds[part]
        if size:
            wp.launch(kernel, size, [*inputs, first, *more], outputs, device=device)

    list(thread_pool(parts).map(launch, range(parts)))
