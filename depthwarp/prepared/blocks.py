"""Blocks of a sorted cloud on the device: coordinates as they are, or packed; a sphere round each.

`axes` are the coordinates x, y, z apart, `rows` the caller's, in whole blocks of 512 places; what
fills up the last block is NaN.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp import arrays
from depthwarp.prepared.launching import launch_parts
from depthwarp_kernels import packed_points, packing, point_source, prepare

__all__ = ["exact_blocks", "packed_blocks"]


def exact_blocks(axes: list[Any], rows: Any, finite: int, device: Any) -> Any:
    """The struct of a cloud whose coordinates are kept: `PreparedPoints`."""
    source: Any = point_source.PreparedPoints()
    source.x, source.y, source.z = axes
    source.original = rows
    source.spheres, source.groups = _spheres(axes, finite, device)
    return source


def packed_blocks(
    axes: list[Any], rows: Any, finite: int, device: Any, max_error: float
) -> tuple[Any, float]:
    """The struct of a cloud in as few planes a block as a bound allows, and its bytes a place.

    Args:
        axes: Coordinates [m]; they become those that will be drawn.
        rows: The caller's rows.
        finite: Points of the cloud; the places behind them are NaN.
        device: Warp device.
        max_error: What each coordinate may move by [m].

    Returns:
        `PackedPoints`; and the bytes of its words, without the rows, over its places.
    """
    count = _block_count(axes)
    boxes = arrays.empty(count, packed_points.PackedBlock, device)
    launch_parts(packing.choose_planes, count, axes, [boxes], device, _not_above(max_error))
    chosen = boxes.numpy()
    chosen["second"], seconds = _places(chosen["planes"], 2)
    chosen["third"], thirds = _places(chosen["planes"], 3)
    source: Any = packed_points.PackedPoints()
    source.boxes = wp.array(chosen, dtype=packed_points.PackedBlock, device=device)
    # None empty: kernels for a CPU are only fast if they know that no array is.
    words = [
        arrays.empty(max(blocks, 1) * point_source.BLOCK, wp.uint32, device)
        for blocks in (count, seconds, thirds)
    ]
    launch_parts(packing.pack_blocks, count, [source.boxes], [*axes, *words], device)
    source.first, source.second, source.third = words
    source.original = rows
    source.spheres, source.groups = _spheres(axes, finite, device)
    return source, 4 * (count + seconds + thirds) / max(count, 1)


def _block_count(axes: list[Any]) -> int:
    return int(axes[0].shape[0]) // point_source.BLOCK


def _spheres(axes: list[Any], finite: int, device: Any) -> tuple[Any, Any]:
    """Spheres round blocks, and round groups of them."""
    blocks = _block_count(axes)
    spheres = arrays.empty(blocks, wp.vec4f, device)
    launch_parts(prepare.block_spheres, blocks, axes, [spheres], device, finite)
    count = -(-blocks // point_source.GROUP)
    groups = arrays.empty(count, wp.vec4f, device)
    launch_parts(prepare.group_spheres, count, [spheres], [groups], device, blocks)
    return spheres, groups


def _places(planes: npt.NDArray[np.int32], plane: int) -> tuple[npt.NDArray[np.int64], int]:
    """Where each block stands in a plane that not all blocks need, and how many are in it."""
    has = planes >= plane
    return np.cumsum(has) - has, int(np.count_nonzero(has))


def _not_above(bound: float) -> np.float32:
    """The largest float32 that is not above a bound."""
    nearest = np.float32(min(bound, float(np.finfo(np.float32).max)))
    return nearest if nearest <= bound else np.nextafter(nearest, np.float32(0))
