"""A cloud in spatial order, in blocks that a view can skip: for many views of one cloud."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp import arrays
from depthwarp.checks import check_positive
from depthwarp.devices import check_memory, resolve_device
from depthwarp.prepared.blocks import exact_blocks, packed_blocks
from depthwarp.prepared.launching import launch_parts
from depthwarp.prepared.order import in_spatial_order
from depthwarp_kernels import prepare
from depthwarp_kernels.packed_points import PACKED
from depthwarp_kernels.point_source import BLOCK, PREPARED

if TYPE_CHECKING:
    from depthwarp.cloud import PointCloud

__all__ = ["PreparedCloud"]

EXACT_BYTES = 12
"""Bytes of a point's three coordinates as they are."""

PEAK_BYTES = 8 + 12 + 4 + 12
"""Bytes a point while a cloud is prepared: order, coordinates, rows, and a copy of the points."""


class PreparedCloud:
    """A point cloud sorted along a Hilbert curve, in blocks of 512 points with a sphere round each.

    A view skips the blocks that its image cannot show; what is left lies close together in memory
    and in the image. Source of the order: Skilling, Programming the Hilbert curve, 2004.

    Without `max_error` maps are, bit for bit and count for count, those of the cloud itself, and
    `index` is the caller's row. With it they are those of `points_world()`: points stand on a
    grid inside the box of their block, in 4 bytes (10 bits an axis), 8 (21 bits) or the 12 of
    the coordinates themselves, each block in as few as keep the bound. The bound is certain: before
    a block is stored shorter, each of its coordinates is decoded with the operations that draw it
    (low + steps * step, two float32 roundings, the same on all devices) and compared with the
    cloud's; the difference has to be below `max_error` in float32, whose rounding never takes a
    number across another, so the true one is below it too. A last block that is not full keeps
    its coordinates. Source of the planes of 4, 8 and 12 bytes: Schuetz, Kerbl, Wimmer 2022.

    Args:
        cloud: The cloud; it is copied, and may be let go.
        device: Where it will be rendered; None is Warp's default device.
        max_error: What each coordinate of a point may move by [m]; None keeps all bits.

    Attributes:
        device: Where it is.
        max_error: The bound [m], or None.
        bytes_per_point: Bytes that hold a point's coordinates, the mean of all blocks: 12, or less
            where they are quantized. The caller's row takes 4 more, boxes and spheres 0.1.
        blocks: Number of blocks.
        finite: Points with finite coordinates.
        not_finite: The others; they are counted, and drawn nowhere.
        kind: How kernels read it.
        source: The struct of arrays on the device that they read.

    Raises:
        InputError: `max_error` is not a finite number above 0.
        DeviceError: The device is not on this machine.
        CapacityError: It does not fit the device's memory.

    Example:
        >>> import numpy as np, depthwarp as dw
        >>> cloud = dw.PointCloud(np.random.default_rng(0).random((10_000, 3), np.float32))
        >>> chunks = cloud.prepare(device="cpu")
        >>> chunks
        PreparedCloud(10000 points in 20 blocks, 12.0 bytes a point, on cpu)
        >>> camera = dw.EquirectangularCamera.looking((90, 45), position=(0.5, 0.5, 0.5))
        >>> dw.render(chunks, camera).stats == dw.render(cloud, camera, device="cpu").stats
        True
        >>> cloud.prepare(device="cpu", max_error=0.001)
        PreparedCloud(10000 points in 20 blocks, 4.4 bytes a point, on cpu)
    """

    def __init__(
        self, cloud: PointCloud, device: str | None = None, max_error: float | None = None
    ) -> None:
        self.max_error = None if max_error is None else check_positive("max_error", max_error, "m")
        self.device = resolve_device(device)
        self._count = len(cloud)
        check_memory(
            f"preparing {self._count} points",
            PEAK_BYTES * self._count,
            self.device,
            "prepare the cloud in parts",
        )
        axes, rows, self.finite = in_spatial_order(cloud.points_world, self.device)
        self.not_finite = self._count - self.finite
        self.blocks = -(-self.finite // BLOCK)
        if self.max_error is None:
            self.kind, self.bytes_per_point = PREPARED, float(EXACT_BYTES)
            self.source = exact_blocks(axes, rows, self.finite, self.device)
        else:
            self.kind = PACKED
            self.source, self.bytes_per_point = packed_blocks(
                axes, rows, self.finite, self.device, self.max_error
            )

    def points_world(self) -> npt.NDArray[np.float32]:
        """The coordinates that are drawn [m], shape (N, 3), float32, in the caller's order.

        They are the cloud's own without `max_error`, and as near with it. Points with a coordinate
        that is not finite are NaN.
        """
        points = arrays.empty(self._count, wp.vec3f, self.device)
        points.fill_(wp.vec3f(wp.nan))
        kernel = prepare.restore_kernel(self.kind)
        launch_parts(kernel, self.finite, [self.source], [points], self.device)
        restored: npt.NDArray[np.float32] = points.numpy()
        return restored.reshape(-1, 3)

    def __len__(self) -> int:
        """Number of points of the cloud, those that are not finite included."""
        return self._count

    def __repr__(self) -> str:
        """Numbers of points, blocks and bytes, and where they are."""
        return (
            f"PreparedCloud({len(self)} points in {self.blocks} blocks, "
            f"{self.bytes_per_point:.1f} bytes a point, on {self.device.alias})"
        )
