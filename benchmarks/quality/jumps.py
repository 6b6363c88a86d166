"""Where depth jumps from one surface to another, and not merely slants."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["JUMP_M", "jumps"]

Float64Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

JUMP_M = 0.1


def jumps(depth: Float64Array, normal: Float64Array, rays: Float64Array, axis: int) -> BoolArray:
    """Whether each surface, continued as a plane, misses its next neighbour by `JUMP_M`.

    A plain difference of depths would take a floor at a grazing angle for an edge.

    Args:
        depth: In units of each ray's length [m], 0 = nothing there, shape (H, W).
        normal: Of the surfaces, shape (H, W, 3).
        rays: Directions, in the normals' frame, shape (H, W, 3).
        axis: 0: the next row; 1: the next column.

    Returns:
        Shape (H, W), false in the last row or column; true beside nothing, too.
    """
    following = [np.roll(values, -1, axis) for values in (depth, normal, rays)]
    ahead = _miss((depth, normal, rays), following[0], following[2])
    behind = _miss((following[0], following[1], following[2]), depth, rays)
    found = np.minimum(ahead, behind) > JUMP_M
    found |= (depth > 0) != (following[0] > 0)
    last = [slice(None), slice(None)]
    last[axis] = slice(-1, None)
    found[tuple(last)] = False
    return found


def _miss(
    surface: tuple[Float64Array, Float64Array, Float64Array],
    depth: Float64Array,
    rays: Float64Array,
) -> Float64Array:
    """How far depths lie from the planes through other surfaces (depth, normal, rays) [m]."""
    own_depth, normal, own_rays = surface
    here = np.einsum("...i,...i->...", normal, own_rays)
    there = np.einsum("...i,...i->...", normal, rays)
    with np.errstate(divide="ignore", invalid="ignore"):
        expected = np.where(there < 0, own_depth * here / there, np.inf)
    return np.where((own_depth > 0) & (depth > 0), np.abs(depth - expected), 0.0)
