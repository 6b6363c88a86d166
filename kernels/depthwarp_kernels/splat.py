"""Splat points into a Z-buffer of packed keys, and resolve it into depth, index and state.

A key is `depth bits << 32 | point index`. The bits of a positive float order like its value, so the
minimum over keys is the nearest point and, on equal depth, the lowest index, whatever the order
of the points, the threads or the device.
"""

from dataclasses import dataclass
from functools import cache

import warp as wp

from depthwarp_kernels.lens import LensModel, z_of
from depthwarp_kernels.options import EXACT
from depthwarp_kernels.view import (
    View,
    in_image,
    in_range_view,
    is_finite,
    pixel_of,
)

wp.set_module_options(EXACT)

EMPTY_KEY = 0xFFFFFFFFFFFFFFFF

# Why a point is not drawn: the columns of `counts`. A point counts under the first that applies.
NOT_FINITE = wp.constant(0)
BEHIND = wp.constant(1)
OUTSIDE = wp.constant(2)
TOO_FAR = wp.constant(3)
TOO_NEAR = wp.constant(4)
DRAWN = wp.constant(5)
COUNT_COLUMNS = 6

STATE_EMPTY = wp.constant(wp.uint8(0))
STATE_MEASURED = wp.constant(wp.uint8(1))


@dataclass(frozen=True)
class SplatConfig:
    """What is decided at compile time: the lens, the depth, whether (8)(9) select the points."""

    lens: LensModel
    depth: str
    range_view: bool

    @property
    def ahead_only(self):
        """Whether points with X <= 0 are behind the camera."""
        return self.lens.ahead_only or self.depth == "z"

    @property
    def depth_of(self):
        """The function (lens, p) that measures the depth of a camera-frame point."""
        return z_of if self.depth == "z" else self.lens.range_of


@wp.func
def count(counts: wp.array2d[wp.int64], view: wp.int32, reason: wp.int32):
    """Count one point of a view under a reason."""
    wp.atomic_add(counts, view, reason, wp.int64(1))


@wp.func
def pack_key(depth: wp.float32, index: wp.int32):
    """Z-buffer key of a point: the smaller one is nearer, or equally near and earlier."""
    return (wp.uint64(wp.cast(depth, wp.uint32)) << wp.uint64(32)) | wp.uint64(index)


@cache
def splat_kernel(config: SplatConfig):
    """Kernel that draws points into the keys of views; launch over (views, points)."""
    depth_of = config.depth_of
    Lens = config.lens.struct
    place = config.lens.place
    project = config.lens.project

    @wp.kernel(module="unique", module_options=EXACT, enable_backward=False)
    def splat(
        # In:
        views: wp.array[View],
        lenses: wp.array[Lens],
        tables: wp.array[wp.float32],
        points_world: wp.array[wp.vec3f],
        # Out:
        keys_out: wp.array3d[wp.uint64],
        counts_out: wp.array2d[wp.int64],
    ):
        v, i = wp.tid()
        view = views[v]
        lens = lenses[v]
        p = place(view, lens, tables, points_world[i])
        if not is_finite(p):
            count(counts_out, v, NOT_FINITE)
            return
        if wp.static(config.ahead_only):
            if p[0] <= 0.0:
                count(counts_out, v, BEHIND)
                return
        else:
            # A point at the centre has no direction, so no pixel either.
            if p[0] == 0.0 and p[1] == 0.0 and p[2] == 0.0:
                count(counts_out, v, TOO_NEAR)
                return
        if wp.static(config.range_view):
            if not in_range_view(p, view.steps, view.line_count):
                count(counts_out, v, OUTSIDE)
                return
        pixel = pixel_of(project(lens, tables, p))
        if not in_image(view, pixel):
            count(counts_out, v, OUTSIDE)
            return
        depth = depth_of(lens, p)
        if depth > view.max_range:
            count(counts_out, v, TOO_FAR)
            return
        if depth < view.min_range or depth == 0.0:
            count(counts_out, v, TOO_NEAR)
            return
        key = pack_key(depth, i)
        row = wp.int32(pixel[1])
        column = wp.int32(pixel[0])
        # A key only ever falls, so a stale read can cost an atomic but never a point.
        if key < keys_out[v, row, column]:
            wp.atomic_min(keys_out, v, row, column, key)

    return splat


# Launch over (views, rows, columns).
@wp.kernel
def resolve(
    # In:
    keys: wp.array3d[wp.uint64],
    # Out:
    depth_out: wp.array3d[wp.float32],
    index_out: wp.array3d[wp.int32],
    state_out: wp.array3d[wp.uint8],
    counts_out: wp.array2d[wp.int64],
):
    v, row, column = wp.tid()
    key = keys[v, row, column]
    if key == wp.uint64(EMPTY_KEY):
        depth_out[v, row, column] = 0.0
        index_out[v, row, column] = -1
        state_out[v, row, column] = STATE_EMPTY
        return
    depth_out[v, row, column] = wp.cast(wp.uint32(key >> wp.uint64(32)), wp.float32)
    index_out[v, row, column] = wp.int32(key & wp.uint64(0xFFFFFFFF))
    state_out[v, row, column] = STATE_MEASURED
    count(counts_out, v, DRAWN)
