"""Device arrays: the few ways in which the host side makes them, typed loosely as Warp's are."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

__all__ = ["empty", "share", "share_points", "zeros"]


def empty(shape: int | tuple[int, ...], dtype: Any, device: Any) -> Any:
    """An array on a device whose content is not set."""
    return wp.empty(shape, dtype=dtype, device=device)


def zeros(shape: int | tuple[int, ...], dtype: Any, device: Any) -> Any:
    """An array on a device, filled with zeros."""
    return wp.zeros(shape, dtype=dtype, device=device)


def share(values: npt.NDArray[Any], dtype: Any, device: Any) -> Any:
    """A host array as a device array to read from: the same memory on a CPU, a copy on CUDA."""
    return wp.array(values, dtype=dtype, device=device, copy=False)


def share_points(points_world: npt.NDArray[np.float32], device: Any) -> Any:
    """Points, shape (N, 3) float32, as a device array of `wp.vec3f`, shape (N,), to read from."""
    return share(points_world, wp.vec3f, device)
