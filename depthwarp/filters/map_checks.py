"""Checks of finished depth maps that are to be filtered."""

from __future__ import annotations

from typing import Any

import numpy as np

from depthwarp.depth_map import DepthMap, State
from depthwarp.depth_maps import DepthMaps
from depthwarp.errors import InputError

__all__ = ["check_maps", "check_out"]

MAPS = ("depth", "index", "state")
"""What a filter reads and writes of a depth map."""


def check_maps(maps: DepthMap | DepthMaps) -> list[DepthMap]:
    """The views of one map or of a batch, after a check of each.

    Raises:
        InputError: No such maps, or arrays that are none, of another size than the camera's image,
            or of values that contradict each other.
    """
    if isinstance(maps, DepthMap):
        _check_map(maps, "")
        return [maps]
    if not isinstance(maps, DepthMaps):
        raise InputError(
            f"maps must be a dw.DepthMap or a dw.DepthMaps, got {_kind_of(maps)}: pass what "
            "dw.render or dw.render_batch gave, or make a dw.DepthMap of arrays and their camera, "
            "a dw.DepthMaps of a list of maps"
        )
    for number, depth_map in enumerate(maps):
        view = number if maps.names is None else maps.names[number]
        _check_map(depth_map, f"view {view!r}: ")
    return list(maps)


def check_out(maps: DepthMap | DepthMaps, out: DepthMap | DepthMaps) -> list[DepthMap]:
    """The views of `out`, into which the results of `maps` can be written.

    Raises:
        InputError: Another kind or number of views, an array of another size or type or that is
            read-only, or one array for several views.
    """
    if isinstance(maps, DepthMap):
        if not isinstance(out, DepthMap):
            raise InputError(f"out must be a dw.DepthMap as maps is, got {_kind_of(out)}")
        _check_place(maps, out, "out")
        return [out]
    if not isinstance(out, DepthMaps) or len(out) != len(maps):
        got = f"{len(out)} views" if isinstance(out, DepthMaps) else _kind_of(out)
        raise InputError(f"out must be a dw.DepthMaps of {len(maps)} views as maps is, got {got}")
    for number, (depth_map, place) in enumerate(zip(maps, out, strict=True)):
        _check_place(depth_map, place, f"out[{number}]")
    for name in MAPS:
        if len({id(getattr(place, name)) for place in out}) < len(out):
            raise InputError(f"out must have arrays for every view, got one {name} for several")
    return list(out)


def _check_place(depth_map: DepthMap, place: DepthMap, label: str) -> None:
    for name in MAPS:
        ours, theirs = getattr(place, name), getattr(depth_map, name)
        expected = f"{label}.{name} must be writable, {theirs.dtype} of shape {theirs.shape}"
        if not isinstance(ours, np.ndarray):
            raise InputError(f"{expected}, got {_kind_of(ours)}")
        if ours.shape != theirs.shape or ours.dtype != theirs.dtype or not ours.flags.writeable:
            how = "" if ours.flags.writeable else "read-only "
            raise InputError(f"{expected}, got {how}{ours.dtype} of {ours.shape}")


def _check_map(depth_map: DepthMap, label: str) -> None:
    width, height = depth_map.camera.size
    for name in MAPS:
        values = getattr(depth_map, name)
        is_array = isinstance(values, np.ndarray)
        if not is_array or values.shape != (height, width):
            raise InputError(
                f"{label}{name} must be an array of the camera's shape (height, width) = "
                f"{height, width}, got {values.shape if is_array else _kind_of(values)}"
            )
    depth = depth_map.depth
    for row, column in np.argwhere(~((depth >= 0) & (depth < np.inf))).tolist():
        raise InputError(
            f"{label}depth must be finite and not negative, got {depth[row, column]} at "
            f"[{row}, {column}]: an empty pixel has depth 0, index -1 and State.EMPTY"
        )
    _check_states(depth_map, label)


def _check_states(depth_map: DepthMap, label: str) -> None:
    depth, state = depth_map.depth, depth_map.state
    for row, column in np.argwhere(~np.isin(state, list(State))).tolist():
        raise InputError(
            f"{label}state must hold values of dw.State, got {state[row, column]} at "
            f"[{row}, {column}]"
        )
    is_empty = depth == 0
    has_none = (state == State.EMPTY) | ((state == State.ERASED) & is_empty)
    for row, column in np.argwhere(has_none != is_empty).tolist():
        raise InputError(
            f"{label}state must be EMPTY or ERASED where depth is 0, and not EMPTY where it is "
            f"not, got {State(state[row, column]).name} with depth {depth[row, column]:g} at "
            f"[{row}, {column}]"
        )


def _kind_of(value: Any) -> str:
    return "None" if value is None else type(value).__name__
