"""Views that each look at a cloud of their own, out of many clouds in one array.

Bits and counts are those of `splat` for every view and its cloud alone. These are the kernels for
CUDA and what both devices share; `ragged_fused` is the one for CPUs.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from depthwarp_kernels.options import EXACT
from depthwarp_kernels.point_source import PointSource
from depthwarp_kernels.resolve import (
    depth_alone,
    depth_of_key,
    index_of_key,
    is_empty,
    state_alone,
    state_of_key,
)
from depthwarp_kernels.spans import span_of
from depthwarp_kernels.splat import (
    COUNT_COLUMNS,
    DRAWN,
    EMPTY_KEY,
    SplatConfig,
    count,
    pack_key,
    reason_function,
)
from depthwarp_kernels.view import View, pixel_of

LANES = 256
"""Threads of a view, whole warps: each takes every so manyth point of its cloud."""

TOTAL = wp.constant(COUNT_COLUMNS)  # the column behind those of `splat`: points of the view's cloud
RAGGED_COLUMNS = COUNT_COLUMNS + 1


@dataclass(frozen=True)
class RaggedConfig:
    """What is decided at compile time.

    Attributes:
        splat: Lens and depth.
        outputs: Which of the maps are written.
        static: Kind of the cloud that all views see before their own; None without one.
    """

    splat: SplatConfig
    outputs: frozenset[str]
    static: PointSource | None = None


@cache
def ragged_kernel(config: SplatConfig):
    """Kernel that draws the cloud of each view into its keys; launch over (views, `LANES`).

    The first point of a cloud has the index `rank`.
    """
    depth_of = config.depth_of
    Lens = config.lens.struct
    place, project = config.lens.place, config.lens.project
    reason_of = reason_function(config)

    @wp.kernel(module="unique", module_options=EXACT, enable_backward=False)
    def splat_ragged(
        # In:
        views: wp.array[View],
        lenses: wp.array[Lens],
        tables: wp.array[wp.float32],
        points_world: wp.array[wp.vec3f],
        spans: wp.array[wp.vec2i],
        cloud_of: wp.array[wp.int32],
        rank: wp.int32,
        # Out:
        keys_out: wp.array2d[wp.uint64],
        counts_out: wp.array2d[wp.int64],
    ):
        v, lane = wp.tid()
        view = views[v]
        lens = lenses[v]
        span = span_of(spans, cloud_of[v])
        begin = span[0]
        end = span[1]
        if lane == 0:
            counts_out[v, TOTAL] = wp.int64(end - begin)
        for i in range(lane, end - begin, wp.static(LANES)):
            p = place(view, lens, tables, points_world[begin + i])
            pixel = pixel_of(project(lens, tables, p))
            depth = depth_of(lens, p)
            reason = reason_of(view, p, pixel, depth)
            if reason == DRAWN:
                key = pack_key(depth, rank + i)
                cell = wp.int32(pixel[1]) * view.width + wp.int32(pixel[0])
                # A key only ever falls, so a stale read can cost an atomic but never a point.
                if key < keys_out[v, cell]:
                    wp.atomic_min(keys_out, v, cell, key)
            else:
                count(counts_out, v, reason)

    return splat_ragged


# Which maps are written is decided at compile time; arrays of the others are not touched.
@cache
def cell_function(outputs: frozenset[str]):
    """The function that writes one key into the maps of `outputs`; 1 if the pixel is not empty."""

    @wp.func
    def resolve_cell(
        key: wp.uint64,
        v: wp.int32,
        cell: wp.int32,
        depth_out: wp.array2d[wp.float32],
        index_out: wp.array2d[wp.int32],
        state_out: wp.array2d[wp.uint8],
    ):
        if wp.static("depth" in outputs):
            depth_out[v, cell] = depth_of_key(key)
        if wp.static("index" in outputs):
            index_out[v, cell] = index_of_key(key)
        if wp.static("state" in outputs):
            state_out[v, cell] = state_of_key(key)
        return wp.where(key == wp.uint64(EMPTY_KEY), 0, 1)

    return resolve_cell


@cache
def depth_cell_function(outputs: frozenset[str]):
    """`cell_function` for keys that are depths alone."""

    @wp.func
    def resolve_cell(
        key: wp.uint32,
        v: wp.int32,
        cell: wp.int32,
        depth_out: wp.array2d[wp.float32],
        index_out: wp.array2d[wp.int32],
        state_out: wp.array2d[wp.uint8],
    ):
        if wp.static("depth" in outputs):
            depth_out[v, cell] = depth_alone(key)
        if wp.static("state" in outputs):
            state_out[v, cell] = state_alone(key)
        return wp.where(is_empty(key), 0, 1)

    return resolve_cell


@cache
def resolve_kernel(outputs: frozenset[str]):
    """Kernel that writes the keys into the maps of `outputs`; launch over (views, pixels)."""
    resolve_cell = cell_function(outputs)

    @wp.kernel(module="unique", module_options=EXACT, enable_backward=False)
    def resolve_ragged(
        # In:
        keys: wp.array2d[wp.uint64],
        # Out:
        depth_out: wp.array2d[wp.float32],
        index_out: wp.array2d[wp.int32],
        state_out: wp.array2d[wp.uint8],
        counts_out: wp.array2d[wp.int64],
    ):
        v, cell = wp.tid()
        if resolve_cell(keys[v, cell], v, cell, depth_out, index_out, state_out) == 1:
            count(counts_out, v, DRAWN)

    return resolve_ragged
