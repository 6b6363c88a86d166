"""Checks of the depth maps into which filtered ones are to be written."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.depth_map import DepthMap
from depthwarp.depth_maps import DepthMaps
from depthwarp.errors import InputError
from depthwarp.filters.map_checks import KERNEL_TYPES, kind_of

__all__ = ["check_out"]


def check_out(maps: DepthMap | DepthMaps, out: DepthMap | DepthMaps) -> list[DepthMap]:
    """The views of `out`, into which the results of `maps` can be written.

    Raises:
        InputError: Another kind or number of views, an array of another size or type or that is
            read-only or of too small a type, or arrays that share memory.
    """
    if isinstance(maps, DepthMap):
        if not isinstance(out, DepthMap):
            raise InputError(f"out must be a dw.DepthMap as maps is, got {kind_of(out)}")
        _check_place(maps, out, "out")
        _check_memory([out], ["out"])
        return [out]
    if not isinstance(out, DepthMaps) or len(out) != len(maps):
        got = f"{len(out)} views" if isinstance(out, DepthMaps) else kind_of(out)
        raise InputError(f"out must be a dw.DepthMaps of {len(maps)} views as maps is, got {got}")
    labels = [f"out[{number}]" for number in range(len(out))]
    for depth_map, place, label in zip(maps, out, labels, strict=True):
        _check_place(depth_map, place, label)
    _check_memory(list(out), labels)
    return list(out)


def _check_place(depth_map: DepthMap, place: DepthMap, label: str) -> None:
    for name, dtype in KERNEL_TYPES.items():
        ours, theirs = getattr(place, name), getattr(depth_map, name)
        expected = f"{label}.{name} must be writable, {theirs.dtype} of shape {theirs.shape}"
        if not isinstance(ours, np.ndarray):
            raise InputError(f"{expected}, got {kind_of(ours)}")
        if ours.shape != theirs.shape or ours.dtype != theirs.dtype or not ours.flags.writeable:
            how = "" if ours.flags.writeable else "read-only "
            raise InputError(f"{expected}, got {how}{ours.dtype} of {ours.shape}")
        if not np.can_cast(dtype, ours.dtype, "safe"):
            raise InputError(
                f"{label}.{name} must hold all that {np.dtype(dtype)} does, got {ours.dtype}"
            )


def _check_memory(places: Sequence[DepthMap], labels: Sequence[str]) -> None:
    """Refuse arrays that share memory: what is written into one would change the other."""
    named = [
        (*_bounds(getattr(place, name)), f"{label}.{name}", getattr(place, name))
        for place, label in zip(places, labels, strict=True)
        for name in KERNEL_TYPES
    ]
    named.sort(key=lambda one: one[:2])
    before: list[tuple[int, int, str, npt.NDArray[Any]]] = []
    for one in named:
        before = [other for other in before if other[1] > one[0]]
        for other in before:
            if np.shares_memory(one[3], other[3]):
                raise InputError(
                    f"{other[2]} and {one[2]} share memory: out must have arrays of its own for "
                    "every view"
                )
        before.append(one)


def _bounds(array: npt.NDArray[Any]) -> tuple[int, int]:
    first, end = np.lib.array_utils.byte_bounds(array)
    return int(first), int(end)
