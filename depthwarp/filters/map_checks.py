"""Checks of finished depth maps that are to be filtered."""

from __future__ import annotations

from typing import Any, get_args

import numpy as np

from depthwarp.cameras import Camera, DepthKind
from depthwarp.checks import check_choice
from depthwarp.depth_map import DepthMap, State
from depthwarp.depth_maps import DepthMaps
from depthwarp.errors import InputError

__all__ = ["KERNEL_TYPES", "check_maps", "kind_of"]

KERNEL_TYPES = {"depth": np.float32, "index": np.int32, "state": np.uint8}
"""What a filter reads and writes of a depth map, in which type."""

KINDS = {"depth": ("f", "floats [m]"), "index": ("iu", "integers"), "state": ("iu", "integers")}
"""Which types of NumPy it may come in, and in words."""

LEAST_DEPTH, LARGEST_DEPTH = 1e-30, 1e30
"""Depths [m] whose inverse is a float32 too."""


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
            f"maps must be a dw.DepthMap or a dw.DepthMaps, got {kind_of(maps)}: pass what "
            "dw.render or dw.render_batch gave, or make a dw.DepthMap of arrays and their camera, "
            "a dw.DepthMaps of a list of maps"
        )
    for number, depth_map in enumerate(maps):
        view = number if maps.names is None else maps.names[number]
        _check_map(depth_map, f"view {view!r}: ")
    return list(maps)


def _check_map(depth_map: DepthMap, label: str) -> None:
    if not isinstance(depth_map, DepthMap):
        raise InputError(f"{label}must be a dw.DepthMap, got {kind_of(depth_map)}")
    if not isinstance(depth_map.camera, Camera):
        raise InputError(f"{label}camera must be a camera, got {kind_of(depth_map.camera)}")
    check_choice(f"{label}kind", depth_map.kind, get_args(DepthKind))
    width, height = depth_map.camera.size
    for name, (kinds, words) in KINDS.items():
        values = getattr(depth_map, name)
        is_array = isinstance(values, np.ndarray)
        if not is_array or values.shape != (height, width):
            raise InputError(
                f"{label}{name} must be an array of the camera's shape (height, width) = "
                f"{height, width}, got {values.shape if is_array else kind_of(values)}"
            )
        if values.dtype.kind not in kinds:
            raise InputError(f"{label}{name} must be an array of {words}, got {values.dtype}")
    depth, index = depth_map.depth, depth_map.index
    fits = (depth == 0) | ((depth >= LEAST_DEPTH) & (depth <= LARGEST_DEPTH))
    for row, column in np.argwhere(~fits).tolist():
        raise InputError(
            f"{label}depth must be 0 or from {LEAST_DEPTH:g} to {LARGEST_DEPTH:g} m, got "
            f"{depth[row, column]:g} at [{row}, {column}]: an empty pixel has depth 0, index -1 "
            "and State.EMPTY"
        )
    most = np.iinfo(np.int32).max
    for row, column in np.argwhere((index < -1) | (index > most)).tolist():
        raise InputError(
            f"{label}index must be from -1, of an empty pixel, to {most}, got "
            f"{index[row, column]} at [{row}, {column}]"
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


def kind_of(value: Any) -> str:
    """The name of a value's type, for messages."""
    return "None" if value is None else type(value).__name__
