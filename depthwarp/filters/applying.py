"""Running a chain of filters on finished depth maps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, overload

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp import arrays
from depthwarp.cameras import DepthKind
from depthwarp.depth_map import DepthMap
from depthwarp.depth_maps import DepthMaps
from depthwarp.devices import resolve_device
from depthwarp.filters.blind import device_blind_pixels
from depthwarp.filters.chain import build_steps, check_filters
from depthwarp.filters.map_checks import KERNEL_TYPES, check_maps
from depthwarp.filters.maps import DeviceMaps, Filter, device_grids
from depthwarp.filters.out_checks import check_out

__all__ = ["apply"]

TILE_BYTES = 1 << 26
"""Maps and working memory of the views that are filtered together [bytes]."""

MAP_BYTES = 4 + 4 + 1
"""A pixel of the maps: depth, index, state."""

Arrays = tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]]
"""Depth, index and state of a view."""


@overload
def apply(
    maps: DepthMap,
    filters: Sequence[Filter],
    *,
    device: str | None = None,
    out: DepthMap | None = None,
) -> DepthMap: ...


@overload
def apply(
    maps: DepthMaps,
    filters: Sequence[Filter],
    *,
    device: str | None = None,
    out: DepthMaps | None = None,
) -> DepthMaps: ...


def apply(
    maps: DepthMap | DepthMaps,
    filters: Sequence[Filter],
    *,
    device: str | None = None,
    out: DepthMap | DepthMaps | None = None,
) -> DepthMap | DepthMaps:
    """Depth maps with filters applied in order; the given ones are not changed, unless as `out`.

    Of a batch every view is, bit for bit, what it is when filtered alone.

    A chain applied twice is not the same as once: what a fill wrote counts as measured for the
    next removal and the next fill, and a dilation grows on.

    Args:
        maps: The map, or the batch of maps (`dw.render_batch`, `dw.Renderer`), to filter.
        filters: A chain such as `paper()`.
        device: Where to compute; None is Warp's default device.
        out: A map, or a batch of as many maps, of the same sizes, whose depth, index and state are
            written; it may be `maps` itself. New arrays when None.

    Returns:
        A map for a map, a batch with the same names for a batch. `DepthMap.filters` tells of the
        filters in what is returned, not in `out`: that lends its arrays only.

    Raises:
        InputError: Not a sequence of filters, no depth map, arrays of another size than the
            camera's image or no numbers of the right kind, a depth that is neither 0 nor from
            1e-30 to 1e30 m, a state that is none or contradicts the depth, or an `out` of another
            kind, size or type or whose arrays share memory. Nothing is written.
        DeviceError: The device is not on this machine.

    Example:
        >>> import numpy as np, depthwarp as dw
        >>> cloud = dw.PointCloud(np.array([[2.0, 0.0, 0.0]], np.float32))
        >>> camera = dw.PinholeCamera.from_fov((60, 45), (4, 3))
        >>> maps = dw.render_batch(cloud, {"left": camera, "right": camera}, device="cpu")
        >>> grown = dw.filters.apply(maps, [dw.filters.dilate(side=3)], device="cpu")
        >>> grown["right"].filters
        ("Dilation(method='paper', side=3)",)
    """
    chain = check_filters(filters)
    views = check_maps(maps)
    places = None if out is None else check_out(maps, out)
    target = resolve_device(device)
    filtered: dict[int, Arrays] = {}
    for numbers in _tiles(views, chain):
        together = _filter_views([views[number] for number in numbers], chain, target)
        filtered.update(zip(numbers, together, strict=True))
    # All views are done before any is written: `out` may hold those of `maps` in another order.
    for number, place in enumerate(places or ()):
        written: Arrays = place.depth, place.index, place.state
        for array, values in zip(written, filtered[number], strict=True):
            np.copyto(array, values)
        filtered[number] = written
    applied = tuple(map(repr, chain))
    done = []
    for number, view in enumerate(views):
        depth, index, state = filtered[number]
        told = (*view.filters, *applied)
        done.append(replace(view, depth=depth, index=index, state=state, filters=told))
    return done[0] if isinstance(maps, DepthMap) else DepthMaps(done, maps.names)


def _tiles(views: Sequence[DepthMap], chain: Sequence[Filter]) -> Iterator[list[int]]:
    """Numbers of views of one size and kind, as many as take little memory together, or one."""
    of_kind: dict[tuple[tuple[int, int], DepthKind], list[int]] = {}
    for number, view in enumerate(views):
        of_kind.setdefault((view.camera.size, view.kind), []).append(number)
    a_pixel = MAP_BYTES + sum(one.scratch_bytes for one in chain)
    for ((width, height), _), numbers in of_kind.items():
        count = max(int(TILE_BYTES // (a_pixel * width * height)), 1)
        for first in range(0, len(numbers), count):
            yield numbers[first : first + count]


def _filter_views(views: Sequence[DepthMap], chain: Sequence[Filter], device: Any) -> list[Arrays]:
    """Depth, index and state of each view, filtered, in arrays of its own; of one size and kind."""

    def upload(name: str, dtype: Any) -> Any:
        of_views = [getattr(view, name) for view in views]
        # Stacked they are new memory, in which the filters of a CPU may write.
        stacked = np.stack(of_views, dtype=KERNEL_TYPES[name], casting="unsafe")
        return arrays.share(stacked, dtype, device)

    cameras = [view.camera for view in views]
    maps = DeviceMaps(
        depth=upload("depth", wp.float32),
        index=upload("index", wp.int32),
        state=upload("state", wp.uint8),
        grids=device_grids(cameras, device),
        blind=device_blind_pixels(cameras, views[0].kind, device),
    )
    for step in build_steps(chain, maps):
        step()
    depth, index, state = (array.numpy() for array in (maps.depth, maps.index, maps.state))
    return [(depth[v].copy(), index[v].copy(), state[v].copy()) for v in range(len(views))]
