"""Views of many small clouds on CPUs: clear, project, scatter, resolve, while an image is in cache.

One thread draws one view after the other into the same small key buffer. Same bits and counts as
`splat`. The loops of fixed length have no branches, so that a CPU works on several points at once.
"""

from dataclasses import replace
from functools import cache

import warp as wp

from depthwarp_kernels.options import EXACT
from depthwarp_kernels.point_source import ALL_DRAWN, GROUP, PLAIN, SEEN, PlainPoints
from depthwarp_kernels.point_source import BLOCK as STATIC_BLOCK
from depthwarp_kernels.ragged import TOTAL, RaggedConfig, cell_function, depth_cell_function
from depthwarp_kernels.spans import span_of
from depthwarp_kernels.splat import (
    BEHIND,
    DRAWN,
    EMPTY_DEPTH,
    EMPTY_KEY,
    NOT_FINITE,
    OUTSIDE,
    TOO_FAR,
    TOO_NEAR,
    SplatConfig,
    reason_function,
    verdict_function,
)
from depthwarp_kernels.view import View, pixel_of

BLOCK = 128
"""Points that are projected together: less is wasted on the end of a cloud than with many."""

CELLS = 64
"""Pixels that are cleared and resolved together; and spare cells behind the image, see
`splat_blocks`."""

# How many points are not drawn, by reason: the columns of `counts` up to DRAWN.
Dropped = wp.types.vector(length=5, dtype=wp.int32)


# The one minimum a point in which it all ends. Written in C: of an indexed array, generated code
# asks each time whether the index is negative.
def loop_over_block(number: str, key: str):
    """Loop that puts the key of each point of a block into its cell if it is the smaller one."""
    return f"""
        for (int k = 0; k < {BLOCK}; ++k) {{
            const uint32_t depth = reinterpret_cast<const uint32_t*>(depths.data)[k];
            const {number} key = {key};
            {number}& nearest = keys_out.data[cells.data[k]];
            const {number} before = nearest;
            nearest = key < before ? key : before;
        }}
    """


@wp.func_native(loop_over_block("uint64_t", "uint64_t(depth) << 32 | uint32_t(rank + k)"))
def keep_nearest(
    cells: wp.array[wp.int32],
    depths: wp.array[wp.float32],
    rank: wp.int32,
    keys_out: wp.array[wp.uint64],
):
    """Points with indices from `rank` on."""


@wp.func_native(loop_over_block("uint64_t", "uint64_t(depth) << 32 | uint32_t(rows.data[k])"))
def keep_nearest_rows(
    cells: wp.array[wp.int32],
    depths: wp.array[wp.float32],
    rows: wp.array[wp.int32],
    keys_out: wp.array[wp.uint64],
):
    """Points with the indices `rows`."""


@wp.func_native(loop_over_block("uint32_t", "depth"))
def keep_nearest_depth(
    cells: wp.array[wp.int32], depths: wp.array[wp.float32], keys_out: wp.array[wp.uint32]
):
    """Depths alone."""


# In C for the same reason.
@wp.func_native(f"""
    const float* p = &points.data[first][0];
    if (held == {BLOCK}) {{
        for (int k = 0; k < {BLOCK}; ++k) {{
            x_out.data[k] = p[3 * k];
            y_out.data[k] = p[3 * k + 1];
            z_out.data[k] = p[3 * k + 2];
        }}
    }} else {{
        for (int k = 0; k < {BLOCK}; ++k) {{
            const int i = k < held ? k : 0;
            x_out.data[k] = k < held ? p[3 * i] : NAN;
            y_out.data[k] = p[3 * i + 1];
            z_out.data[k] = p[3 * i + 2];
        }}
    }}
""")
def take_apart(
    points: wp.array[wp.vec3f],
    first: wp.int32,
    held: wp.int32,
    x_out: wp.array[wp.float32],
    y_out: wp.array[wp.float32],
    z_out: wp.array[wp.float32],
):
    """Coordinates of a block that holds so many points; what is behind them is not finite."""


@cache
def clear_function(Key: type):
    """The function that empties the keys of an image."""
    empty = f"{EMPTY_KEY}ull" if Key is wp.uint64 else f"{EMPTY_DEPTH}u"

    @wp.func_native(f"for (int k = 0; k < cells; ++k) keys_out.data[k] = {empty};")
    def clear_image(cells: wp.int32, keys_out: wp.array[Key]):
        """Empty so many keys."""

    return clear_image


# Loading, projecting and counting stand in one function: of arrays that are handed to another one
# the compiler does not know that they are apart, and then works on one point at a time.
@cache
def draw_function(config: SplatConfig):
    """The function that draws the points from `begin` to `end` into the keys of one image.

    It returns how many were not drawn, and why. Points of a plain cloud, an array, have indices
    from `rank` on; those of a prepared one, its struct, their own.
    """
    is_plain = config.source is PLAIN
    Points = wp.array[wp.vec3f] if is_plain else config.source.struct
    depth_of = config.depth_of
    Lens = config.lens.struct
    place, project = config.lens.place, config.lens.project
    point_at, index_at = config.source.point_at, config.source.index_at
    reason_of = reason_function(config)
    Key, with_index = config.key_type, config.with_index

    @wp.func
    def draw_points(
        view: View,
        lens: Lens,
        tables: wp.array[wp.float32],
        points: Points,
        begin: wp.int32,
        end: wp.int32,
        rank: wp.int32,
        keys_out: wp.array[Key],
    ):
        x = wp.zeros(shape=(wp.static(BLOCK),), dtype=wp.float32)
        y = wp.zeros(shape=(wp.static(BLOCK),), dtype=wp.float32)
        z = wp.zeros(shape=(wp.static(BLOCK),), dtype=wp.float32)
        cells = wp.zeros(shape=(wp.static(BLOCK),), dtype=wp.int32)
        depths = wp.zeros(shape=(wp.static(BLOCK),), dtype=wp.float32)
        if not wp.static(is_plain):
            rows = wp.zeros(shape=(wp.static(BLOCK),), dtype=wp.int32)
        nowhere = view.width * view.height
        not_finite = int(0)
        behind = int(0)
        outside = int(0)
        too_far = int(0)
        too_near = int(0)
        for block in range((end - begin + wp.static(BLOCK - 1)) / wp.static(BLOCK)):
            first = begin + block * wp.static(BLOCK)
            held = wp.min(end - first, wp.static(BLOCK))
            # What fills up the last block is not finite, and no point.
            not_finite += held - wp.static(BLOCK)
            if wp.static(is_plain):
                take_apart(points, first, held, x, y, z)
            else:
                for k in range(wp.static(BLOCK)):
                    point = point_at(points, first + k)
                    rows[k] = index_at(points, first + k)
                    x[k] = point[0]
                    y[k] = point[1]
                    z[k] = point[2]
            for k in range(wp.static(BLOCK)):
                p = place(view, lens, tables, wp.vec3f(x[k], y[k], z[k]))
                pixel = pixel_of(project(lens, tables, p))
                depth = depth_of(lens, p)
                why = reason_of(view, p, pixel, depth)
                not_finite += wp.where(why == NOT_FINITE, 1, 0)
                behind += wp.where(why == BEHIND, 1, 0)
                outside += wp.where(why == OUTSIDE, 1, 0)
                too_far += wp.where(why == TOO_FAR, 1, 0)
                too_near += wp.where(why == TOO_NEAR, 1, 0)
                cell = wp.int32(pixel[1]) * view.width + wp.int32(pixel[0])
                cells[k] = wp.where(why == DRAWN, cell, nowhere + (k & wp.static(CELLS - 1)))
                depths[k] = depth
            if wp.static(not with_index):
                keep_nearest_depth(cells, depths, keys_out)
            elif wp.static(is_plain):
                keep_nearest(cells, depths, rank + (first - begin), keys_out)
            else:
                keep_nearest_rows(cells, depths, rows, keys_out)
        return Dropped(not_finite, behind, outside, too_far, too_near)

    return draw_points


@cache
def static_function(config: SplatConfig):
    """The function that draws a prepared cloud into the keys of one image.

    Groups and blocks of points that the view cannot see are skipped, and not counted.
    """
    Lens, Source = config.lens.struct, config.source.struct
    sphere_of, group_of = config.source.sphere_of, config.source.group_of
    draw_points = draw_function(config)
    verdict_of = verdict_function(config)
    Key = config.key_type

    @wp.func
    def may_see(view: View, sphere: wp.vec4f):
        verdict = verdict_of(view, sphere)
        return verdict == SEEN or verdict == ALL_DRAWN

    @wp.func
    def draw_static(
        view: View,
        lens: Lens,
        tables: wp.array[wp.float32],
        source: Source,
        keys_out: wp.array[Key],
    ):
        blocks = source.spheres.shape[0]
        for group in range((blocks + wp.static(GROUP - 1)) / wp.static(GROUP)):
            begin = group * wp.static(GROUP)
            end = wp.min(begin + wp.static(GROUP), blocks)
            if not may_see(view, group_of(source, group)):
                end = begin
            for block in range(begin, end):
                if may_see(view, sphere_of(source, block)):
                    first = block * wp.static(STATIC_BLOCK)
                    last = first + wp.static(STATIC_BLOCK)
                    draw_points(view, lens, tables, source, first, last, 0, keys_out)

    return draw_static


@cache
def fused_kernel(config: RaggedConfig):
    """Kernel that draws views from `first` on, one after the other; launch over the views.

    A view sees the static cloud, if there is one, and its own, whose first point has the index
    `rank`. Keys are as in `splat`, with an index or without. Arrays of maps that are not among the
    outputs are not written. None of the arrays may be empty.
    """
    Lens = config.splat.lens.struct
    draw_points = draw_function(config.splat)
    Key, with_index = config.splat.key_type, config.splat.with_index
    clear_image = clear_function(Key)
    resolve_cell = (cell_function if with_index else depth_cell_function)(config.outputs)
    has_static = config.static is not None
    Fixed = config.static.struct if has_static else PlainPoints
    if has_static:
        draw_static = static_function(replace(config.splat, source=config.static))

    @wp.kernel(module="unique", module_options=EXACT, enable_backward=False)
    def draw_views(
        # In:
        views: wp.array[View],
        lenses: wp.array[Lens],
        tables: wp.array[wp.float32],
        points_world: wp.array[wp.vec3f],
        spans: wp.array[wp.vec2i],
        cloud_of: wp.array[wp.int32],
        fixed: Fixed,
        rank: wp.int32,
        first: wp.int32,
        # Out:
        keys_out: wp.array[Key],
        depth_out: wp.array2d[wp.float32],
        index_out: wp.array2d[wp.int32],
        state_out: wp.array2d[wp.uint8],
        counts_out: wp.array2d[wp.int64],
    ):
        v = first + wp.tid()
        view = views[v]
        pixels = view.width * view.height
        span = span_of(spans, cloud_of[v])
        begin = span[0]
        end = span[1]
        lens = lenses[v]
        clear_image(pixels, keys_out)
        if wp.static(has_static):
            draw_static(view, lens, tables, fixed, keys_out)
        dropped = draw_points(view, lens, tables, points_world, begin, end, rank, keys_out)
        drawn = int(0)
        whole = pixels - pixels % wp.static(CELLS)
        for block in range(whole / wp.static(CELLS)):
            for k in range(wp.static(CELLS)):
                cell = block * wp.static(CELLS) + k
                drawn += resolve_cell(keys_out[cell], v, cell, depth_out, index_out, state_out)
        for cell in range(whole, pixels):
            drawn += resolve_cell(keys_out[cell], v, cell, depth_out, index_out, state_out)
        for reason in range(5):
            counts_out[v, reason] = wp.int64(dropped[reason])
        counts_out[v, DRAWN] = wp.int64(drawn)
        counts_out[v, TOTAL] = wp.int64(end - begin)

    return draw_views
