"""The splat for CPUs: blocks of points, first projected without branches, then scattered.

The first loop has a fixed length and no branches, so the compiler works on several points at once;
what is left for the second is one comparison for each point in the image. Same bits as `splat`.
"""

from functools import cache

import warp as wp

from depthwarp_kernels.options import EXACT
from depthwarp_kernels.splat import (
    BEHIND,
    DRAWN,
    NOT_FINITE,
    OUTSIDE,
    TOO_FAR,
    TOO_NEAR,
    SplatConfig,
    pack_key,
    reason_function,
)
from depthwarp_kernels.view import View, pixel_of

BLOCK = 512
"""Points of a block: their pixels and depths stay in the nearest cache."""


@cache
def block_kernel(config: SplatConfig):
    """Kernel that draws whole blocks of points into one key buffer; launch over the blocks.

    Blocks are counted from `first` on. One launch at a time may write to a buffer.
    """
    depth_of = config.depth_of
    Lens = config.lens.struct
    place = config.lens.place
    project = config.lens.project
    reason_of = reason_function(config)

    @wp.kernel(module="unique", module_options=EXACT, enable_backward=False)
    def splat_blocks(
        # In:
        views: wp.array[View],
        lenses: wp.array[Lens],
        tables: wp.array[wp.float32],
        v: wp.int32,
        points_world: wp.array[wp.vec3f],
        first: wp.int32,
        # Out:
        keys_out: wp.array[wp.uint64],
        counts_out: wp.array[wp.int64],
    ):
        begin = (first + wp.tid()) * wp.static(BLOCK)
        view = views[v]
        lens = lenses[v]
        x = wp.zeros(shape=(wp.static(BLOCK),), dtype=wp.float32)
        y = wp.zeros(shape=(wp.static(BLOCK),), dtype=wp.float32)
        z = wp.zeros(shape=(wp.static(BLOCK),), dtype=wp.float32)
        cells = wp.zeros(shape=(wp.static(BLOCK),), dtype=wp.int32)
        depths = wp.zeros(shape=(wp.static(BLOCK),), dtype=wp.float32)
        not_finite = int(0)
        behind = int(0)
        outside = int(0)
        too_far = int(0)
        too_near = int(0)
        for k in range(wp.static(BLOCK)):
            point = points_world[begin + k]
            x[k] = point[0]
            y[k] = point[1]
            z[k] = point[2]
        for k in range(wp.static(BLOCK)):
            p = place(view, lens, tables, wp.vec3f(x[k], y[k], z[k]))
            pixel = pixel_of(project(lens, tables, p))
            depth = depth_of(lens, p)
            reason = reason_of(view, p, pixel, depth)
            not_finite += wp.where(reason == NOT_FINITE, 1, 0)
            behind += wp.where(reason == BEHIND, 1, 0)
            outside += wp.where(reason == OUTSIDE, 1, 0)
            too_far += wp.where(reason == TOO_FAR, 1, 0)
            too_near += wp.where(reason == TOO_NEAR, 1, 0)
            cell = wp.int32(pixel[1]) * view.width + wp.int32(pixel[0])
            cells[k] = wp.where(reason == DRAWN, cell, -1)
            depths[k] = depth
        for k in range(wp.static(BLOCK)):
            cell_k = wp.int32(cells[k])
            if cell_k >= 0:
                key = pack_key(depths[k], begin + k)
                if key < keys_out[cell_k]:
                    keys_out[cell_k] = key
        counts_out[NOT_FINITE] = counts_out[NOT_FINITE] + wp.int64(not_finite)
        counts_out[BEHIND] = counts_out[BEHIND] + wp.int64(behind)
        counts_out[OUTSIDE] = counts_out[OUTSIDE] + wp.int64(outside)
        counts_out[TOO_FAR] = counts_out[TOO_FAR] + wp.int64(too_far)
        counts_out[TOO_NEAR] = counts_out[TOO_NEAR] + wp.int64(too_near)

    return splat_blocks
