"""The splat for CPUs: blocks of points, first projected without branches, then scattered.

The first loop has a fixed length and no branches, so the compiler works on several points at once;
what is left for the second is one minimum for each point. Same bits and counts as `splat`.
"""

from functools import cache

import warp as wp

from depthwarp_kernels.nearest import keep_function
from depthwarp_kernels.options import EXACT
from depthwarp_kernels.packed_points import PACKED, PackedBlock, decode, unpack_long, unpack_short
from depthwarp_kernels.point_source import BLOCK
from depthwarp_kernels.splat import (
    BEHIND,
    DRAWN,
    NOT_FINITE,
    OUTSIDE,
    TOO_FAR,
    TOO_NEAR,
    SplatConfig,
    reason_function,
)
from depthwarp_kernels.view import View, pixel_of

# What is not drawn goes into spare cells behind the image: a branch there costs more than a store,
# and several cells more than one, since a store has to wait for the one before it.
SPARE_CELLS = wp.constant(64)


@wp.func
def first_of(entry: wp.int32):
    """First point of a block by its entry in the list: b, or -1 - b where every point is drawn."""
    return wp.where(entry < 0, -1 - entry, entry) * wp.static(BLOCK)


@cache
def block_kernel(config: SplatConfig):
    """Kernel that draws blocks of points into one key buffer; launch over the blocks.

    They are, from `first` on, those of the list `seen` for a prepared cloud, or those of a plain
    one, which comes as `points_world`; the cloud holds `count` points. One launch at a time may
    write to a buffer. Of a packed cloud x, y and z are the planes of words, and `boxes` says how to
    read them. Arrays are arguments, not parts of a struct, and none may be empty: only then
    does the compiler know that their numbers lie side by side.
    """
    depth_of = config.depth_of
    is_prepared = config.source.sphere_of is not None
    is_packed = config.source is PACKED
    is_apart = is_prepared and not is_packed
    Word = wp.uint32 if is_packed else wp.float32
    Lens = config.lens.struct
    place, project = config.lens.place, config.lens.project
    reason_of = reason_function(config)
    keep = keep_function(config)
    Key = config.key_type

    @wp.kernel(module="unique", module_options=EXACT, enable_backward=False)
    def splat_blocks(
        # In:
        views: wp.array[View],
        lenses: wp.array[Lens],
        tables: wp.array[wp.float32],
        v: wp.int32,
        x: wp.array[Word],
        y: wp.array[Word],
        z: wp.array[Word],
        boxes: wp.array[PackedBlock],
        original: wp.array[wp.int32],
        points_world: wp.array[wp.vec3f],
        seen: wp.array[wp.int32],
        first: wp.int32,
        count: wp.int32,
        # Out:
        keys_out: wp.array[Key],
        counts_out: wp.array[wp.int64],
    ):
        if wp.static(is_prepared):
            entry = seen[first + wp.tid()]
            begin = first_of(entry)
            next = first_of(seen[wp.min(first + wp.tid() + 1, seen.shape[0] - 1)])
        else:
            begin = (first + wp.tid()) * wp.static(BLOCK)
            next = begin
        next_second = int(0)
        if wp.static(is_packed):
            # Behind the list's end stands no block: fetched in vain, but never read out of bounds.
            next_box = boxes[wp.clamp(next / wp.static(BLOCK), 0, boxes.shape[0] - 1)]
            next_second = wp.where(next_box.planes > 1, next_box.second, 0) * wp.static(BLOCK)
        view = views[v]
        lens = lenses[v]
        nowhere = view.width * view.height
        cells = wp.zeros(shape=(wp.static(BLOCK),), dtype=wp.int32)
        depths = wp.zeros(shape=(wp.static(BLOCK),), dtype=wp.float32)
        if not wp.static(is_apart):
            # Taken apart first: the compiler does not do that beside the arithmetic. Nor does it
            # work on several points at once in a function of its own, or with a branch for each.
            a = wp.zeros(shape=(wp.static(BLOCK),), dtype=wp.float32)
            b = wp.zeros(shape=(wp.static(BLOCK),), dtype=wp.float32)
            c = wp.zeros(shape=(wp.static(BLOCK),), dtype=wp.float32)
        if wp.static(is_packed):
            box = boxes[begin / wp.static(BLOCK)]
            second, third = box.second * wp.static(BLOCK), box.third * wp.static(BLOCK)
            if box.planes == 1:
                for k in range(wp.static(BLOCK)):
                    together = decode(box.low, box.step, unpack_short(x[begin + k]))
                    a[k] = together[0]
                    b[k] = together[1]
                    c[k] = together[2]
            elif box.planes == 2:
                for k in range(wp.static(BLOCK)):
                    together = decode(box.low, box.step, unpack_long(x[begin + k], y[second + k]))
                    a[k] = together[0]
                    b[k] = together[1]
                    c[k] = together[2]
            else:
                for k in range(wp.static(BLOCK)):
                    a[k] = wp.cast(x[begin + k], wp.float32)
                    b[k] = wp.cast(y[second + k], wp.float32)
                    c[k] = wp.cast(z[third + k], wp.float32)
        elif not wp.static(is_prepared):
            for k in range(wp.static(BLOCK)):
                together = points_world[begin + k]
                a[k] = together[0]
                b[k] = together[1]
                c[k] = together[2]
        if wp.static(is_prepared):
            if entry < 0:
                for k in range(wp.static(BLOCK)):
                    if wp.static(is_apart):
                        point = wp.vec3f(x[begin + k], y[begin + k], z[begin + k])
                    else:
                        point = wp.vec3f(a[k], b[k], c[k])
                    p = place(view, lens, tables, point)
                    pixel = project(lens, tables, p)
                    column, line = wp.int32(pixel[0] + 0.5), wp.int32(pixel[1] + 0.5)
                    cells[k] = line * view.width + column
                    depths[k] = depth_of(lens, p)
                keep(cells, depths, x, y, z, original, begin, next, next_second, keys_out)
                return
        # What fills up the last block is not finite, and no point.
        not_finite = wp.min(0, count - begin - wp.static(BLOCK))
        behind = int(0)
        outside = int(0)
        too_far = int(0)
        too_near = int(0)
        drawn = int(0)
        for k in range(wp.static(BLOCK)):
            if wp.static(is_apart):
                point = wp.vec3f(x[begin + k], y[begin + k], z[begin + k])
            else:
                point = wp.vec3f(a[k], b[k], c[k])
            p = place(view, lens, tables, point)
            pixel = pixel_of(project(lens, tables, p))
            depth = depth_of(lens, p)
            why = reason_of(view, p, pixel, depth)
            not_finite += wp.where(why == NOT_FINITE, 1, 0)
            behind += wp.where(why == BEHIND, 1, 0)
            outside += wp.where(why == OUTSIDE, 1, 0)
            too_far += wp.where(why == TOO_FAR, 1, 0)
            too_near += wp.where(why == TOO_NEAR, 1, 0)
            cell = wp.int32(pixel[1]) * view.width + wp.int32(pixel[0])
            cells[k] = wp.where(why == DRAWN, cell, nowhere + (k & (SPARE_CELLS - 1)))
            depths[k] = depth
            drawn += wp.where(why == DRAWN, 1, 0)
        if drawn > 0:
            keep(cells, depths, x, y, z, original, begin, next, next_second, keys_out)
        counts_out[NOT_FINITE] = counts_out[NOT_FINITE] + wp.int64(not_finite)
        counts_out[BEHIND] = counts_out[BEHIND] + wp.int64(behind)
        counts_out[OUTSIDE] = counts_out[OUTSIDE] + wp.int64(outside)
        counts_out[TOO_FAR] = counts_out[TOO_FAR] + wp.int64(too_far)
        counts_out[TOO_NEAR] = counts_out[TOO_NEAR] + wp.int64(too_near)

    return splat_blocks
