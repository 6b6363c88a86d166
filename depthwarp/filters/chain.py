"""Chains of filters, and running them on a finished depth map."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp.depth_map import DepthMap, State
from depthwarp.devices import resolve_device
from depthwarp.errors import InputError
from depthwarp.filters.dilation import dilate
from depthwarp.filters.filling import fill
from depthwarp.filters.hidden import remove_hidden
from depthwarp.filters.maps import DeviceMaps, Filter, device_grids
from depthwarp.filters.plane_fill import PlaneFill
from depthwarp.filters.surround_erase import SurroundStep

__all__ = ["apply", "best", "build_steps", "check_filters", "paper"]

MAPS = ("depth", "index", "state")


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
            "filters must be a list of filters such as dw.filters.best(), dw.filters.paper() "
            f"or [dw.filters.fill()], got {filters!r}"
        )
    return tuple(filters)


def build_steps(filters: Sequence[Filter], maps: DeviceMaps) -> list[Callable[[], None]]:
    """The steps of a chain, in order; each allocates its working memory now, see `Filter.build`.

    A plane fill right after a surround erase goes on with what that found, to the same result.
    """
    steps: list[Callable[[], None]] = []
    for one in filters:
        before = steps[-1] if steps else None
        if isinstance(one, PlaneFill) and isinstance(before, SurroundStep):
            steps.append(one.build_after(before))
        else:
            steps.append(one.build(maps))
    return steps


def apply(
    depth_map: DepthMap,
    filters: Sequence[Filter],
    *,
    device: str | None = None,
    out: DepthMap | None = None,
) -> DepthMap:
    """A depth map with filters applied in order; the given one is not changed, unless it is `out`.

    Args:
        depth_map: The map to filter.
        filters: A chain such as `paper()`.
        device: Where to compute; None is Warp's default device.
        out: A map of the same size whose depth, index and state are written, and are those of the
            result; new arrays when None.

    Raises:
        InputError: Not a sequence of filters, maps of another size than the camera's image, a depth
            that is negative or not finite, a state that is none or contradicts the depth, or an
            `out` of another size or type.
        DeviceError: The device is not on this machine.
    """
    chain = check_filters(filters)
    _check_maps(depth_map)
    if out is not None:
        _check_out(depth_map, out)
    target = resolve_device(device)

    def upload(values: npt.NDArray[Any], dtype: Any) -> Any:
        return wp.array(values[None], dtype=dtype, device=target)  # a copy, also on the CPU

    maps = DeviceMaps(
        depth=upload(depth_map.depth, wp.float32),
        index=upload(depth_map.index, wp.int32),
        state=upload(depth_map.state, wp.uint8),
        grids=device_grids([depth_map.camera], target),
    )
    for step in build_steps(chain, maps):
        step()
    filtered = {name: getattr(maps, name).numpy()[0] for name in MAPS}
    if out is not None:
        for name in MAPS:
            np.copyto(getattr(out, name), filtered[name])
            filtered[name] = getattr(out, name)
    return replace(depth_map, **filtered, filters=(*depth_map.filters, *map(repr, chain)))


def _check_out(depth_map: DepthMap, out: DepthMap) -> None:
    for name in MAPS:
        ours, theirs = getattr(out, name), getattr(depth_map, name)
        if ours.shape != theirs.shape or ours.dtype != theirs.dtype or not ours.flags.writeable:
            raise InputError(
                f"out.{name} must be writable, {theirs.dtype} of shape {theirs.shape}, "
                f"got {'' if ours.flags.writeable else 'read-only '}{ours.dtype} of {ours.shape}"
            )


def _check_maps(depth_map: DepthMap) -> None:
    width, height = depth_map.camera.size
    for name in MAPS:
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
    _check_states(depth_map)


def _check_states(depth_map: DepthMap) -> None:
    state = depth_map.state
    for row, column in np.argwhere(~np.isin(state, list(State))).tolist():
        raise InputError(
            f"state must hold values of dw.State, got {state[row, column]} at [{row}, {column}]"
        )
    is_empty = depth_map.depth == 0
    has_none = (state == State.EMPTY) | ((state == State.ERASED) & is_empty)
    for row, column in np.argwhere(has_none != is_empty).tolist():
        raise InputError(
            f"state must be EMPTY or ERASED where depth is 0, and not EMPTY where it is not, got "
            f"{State(state[row, column]).name} with depth {depth_map.depth[row, column]:g} at "
            f"[{row}, {column}]"
        )
