"""The spatial order of a cloud: its points along a Hilbert curve, coordinates taken apart."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp import arrays
from depthwarp.prepared.launching import launch_parts
from depthwarp_kernels import prepare
from depthwarp_kernels.point_source import BLOCK

__all__ = ["in_spatial_order"]


def in_spatial_order(
    points_world: npt.NDArray[np.float32], device: Any
) -> tuple[list[Any], Any, int]:
    """The finite points of a cloud along the curve, on a device.

    Returns:
        Coordinates x, y, z apart [m], float32, in whole blocks, what fills up the last one NaN; the
        caller's row of each, int32; and the number of finite points.
    """
    low, high, finite = _extent(points_world)
    points = arrays.share_points(points_world, device)
    order = _order(points, low, high, device)
    padded = -(-finite // BLOCK) * BLOCK
    axes = [arrays.empty(padded, wp.float32, device) for _ in range(3)]
    rows = arrays.empty(padded, wp.int32, device)
    if finite < padded:
        for axis in axes:
            axis[finite:].fill_(wp.nan)
    launch_parts(prepare.take_apart, finite, [points, order], [*axes, rows], device, finite)
    return axes, rows, finite


def _extent(points_world: npt.NDArray[np.float32]) -> tuple[Any, Any, int]:
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


def _order(points: Any, low: Any, high: Any, device: Any) -> Any:
    """Rows of the cloud along the curve, those that are not finite last, `wp.int32`."""
    count = points.shape[0]
    codes = arrays.empty(2 * count, wp.int32, device)  # radix sort needs room for a second copy
    order = arrays.empty(2 * count, wp.int32, device)
    side = float(np.max(high.astype(np.float64) - low))
    scale = ((1 << prepare.AXIS_BITS) - 1) / side if side > 0 else 0.0
    inputs = [points, wp.vec3f(*low), scale]
    launch_parts(prepare.curve_codes, count, inputs, [codes, order], device)
    if count:
        wp.utils.radix_sort_pairs(codes, order, count)
    return order
