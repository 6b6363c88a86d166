"""Chains of filters, and running them on a finished depth map."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp.depth_map import DepthMap
from depthwarp.devices import resolve_device
from depthwarp.errors import InputError
from depthwarp.filters.dilation import dilate
from depthwarp.filters.filling import fill
from depthwarp.filters.hidden import remove_hidden
from depthwarp.filters.maps import DeviceMaps, Filter, device_grids

__all__ = ["apply", "best", "check_filters", "paper"]


def paper() -> tuple[Filter, ...]:
    """The paper's chain: erase in a window of 10 px at 0.5 m, then dilation by 10 px."""
    return remove_hidden("paper", side=10, threshold=0.5), dilate("paper", side=10)


def best() -> tuple[Filter, ...]:
    """The most accurate chain: erase what is surrounded, then fill with planes, layer by layer."""
    return remove_hidden("surround"), fill("plane")


def check_filters(filters: Sequence[Filter] | None) -> tuple[Filter, ...]:
    """A chain as a tuple; None is the empty one.

    Raises:
        InputError: Not a sequence of filters.
    """
    if filters is None:
        return ()
    if not isinstance(filters, list | tuple) or not all(hasattr(f, "build") for f in filters):
        raise InputError(
            "filters must be a list of filters such as dw.filters.best() or [dw.filters.fill()], "
            f"got {filters!r}"
        )
    return tuple(filters)


def apply(depth_map: DepthMap, filters: Sequence[Filter], *, device: str | None = None) -> DepthMap:
    """A new depth map with filters applied in order; the given one is not changed.

    Args:
        depth_map: The map to filter.
        filters: A chain such as `paper()`.
        device: Where to compute; None is Warp's default device.

    Raises:
        InputError: Not a sequence of filters, maps of another size than the camera's image, or a
            depth that is negative or not finite.
        DeviceError: The device is not on this machine.
    """
    chain = check_filters(filters)
    _check_maps(depth_map)
    target = resolve_device(device)

    def upload(values: npt.NDArray[Any], dtype: Any) -> Any:
        return wp.array(values[None], dtype=dtype, device=target)  # a copy, also on the CPU

    maps = DeviceMaps(
        depth=upload(depth_map.depth, wp.float32),
        index=upload(depth_map.index, wp.int32),
        state=upload(depth_map.state, wp.uint8),
        grids=device_grids([depth_map.camera], target),
    )
    for step in chain:
        step.build(maps)()
    return replace(
        depth_map,
        depth=maps.depth.numpy()[0],
        index=maps.index.numpy()[0],
        state=maps.state.numpy()[0],
        filters=(*depth_map.filters, *map(repr, chain)),
    )


def _check_maps(depth_map: DepthMap) -> None:
    width, height = depth_map.camera.size
    for name in ("depth", "index", "state"):
        shape = getattr(depth_map, name).shape
        if shape != (height, width):
            raise InputError(
                f"{name} must have the camera's shape (height, width) = {height, width}, "
                f"got {shape}"
            )
    for row, column in np.argwhere(~((depth_map.depth >= 0) & (depth_map.depth < np.inf))).tolist():
        raise InputError(
            f"depth must be finite and not negative, got {depth_map.depth[row, column]} at "
            f"[{row}, {column}]: an empty pixel has depth 0, index -1 and State.EMPTY"
        )
