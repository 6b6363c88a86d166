"""Blocks that lie behind what has been drawn: no point of theirs can win a pixel.

Only blocks of which every point is drawn are left out, so no count changes: what is neither
dropped nor a winner is hidden.
"""

from functools import cache

import warp as wp

from depthwarp_kernels.options import EXACT
from depthwarp_kernels.point_source import camera_sphere
from depthwarp_kernels.splat import DEPTH_ROUNDING, SplatConfig, center_depth_function
from depthwarp_kernels.view import View

TILE = 16
"""Side of a tile of pixels [px], of which the farthest depth is kept."""

# A sphere so near that its picture is a large part of the image hides or is hidden by nothing.
LEAST_DISTANCE = wp.constant(wp.float32(1.5))


@cache
def tile_kernel(config: SplatConfig):
    """Kernel that finds the farthest depth in each tile; launch over (rows, columns) of tiles.

    A pixel's depth is the nearest of all buffers, shape (buffers, cells); infinity where nothing is
    drawn.
    """
    Key = config.key_type
    with_index = config.with_index

    @wp.func
    def depth_of(key: Key):
        """Depth of a key [m], infinite of an empty one."""
        if wp.static(with_index):
            bits = wp.uint32(key >> wp.uint64(32))
        else:
            bits = key
        return wp.where(wp.int32(bits) == -1, wp.inf, wp.cast(bits, wp.float32))

    @wp.kernel(module="unique", module_options=EXACT, enable_backward=False)
    def farthest_in_tiles(
        # In:
        keys: wp.array2d[Key],
        width: wp.int32,
        height: wp.int32,
        # Out:
        farthest_out: wp.array2d[wp.float32],
    ):
        row, column = wp.tid()
        farthest = float(0.0)
        for v in range(row * TILE, wp.min((row + 1) * TILE, height)):
            for u in range(column * TILE, wp.min((column + 1) * TILE, width)):
                nearest = keys[0, v * width + u]
                for buffer in range(1, keys.shape[0]):
                    nearest = wp.min(nearest, keys[buffer, v * width + u])
                farthest = wp.max(farthest, depth_of(nearest))
        farthest_out[row, column] = farthest

    return farthest_in_tiles


@cache
def near_kernel(config: SplatConfig):
    """Kernel that bounds the depth of blocks from below; launch over the list `seen`."""
    Source = config.source.struct
    sphere_of = config.source.sphere_of
    center_depth = center_depth_function(config)

    @wp.kernel(module="unique", module_options=EXACT, enable_backward=False)
    def nearest_depths(
        # In:
        views: wp.array[View],
        v: wp.int32,
        source: Source,
        seen: wp.array[wp.int32],
        # Out:
        near_out: wp.array[wp.float32],
    ):
        i = wp.tid()
        entry = seen[i]
        block = wp.where(entry < 0, -1 - entry, entry)
        sphere = camera_sphere(views[v], sphere_of(source, block))
        depth = center_depth(wp.vec3f(sphere[0], sphere[1], sphere[2]))
        near_out[i] = depth - (sphere[3] + DEPTH_ROUNDING * depth)

    return nearest_depths


@wp.func
def tiles_beyond(farthest: wp.array2d[wp.float32], view: View, bounds: wp.vec4f, near: wp.float32):
    """Tiles in bounds, and a pixel round them for rounding, that reach to a depth or beyond it."""
    low_u = wp.max(wp.int32(bounds[0]) - 1, 0) / TILE
    low_v = wp.max(wp.int32(bounds[1]) - 1, 0) / TILE
    high_u = wp.min(wp.int32(bounds[2]) + 2, view.width - 1) / TILE
    high_v = wp.min(wp.int32(bounds[3]) + 2, view.height - 1) / TILE
    beyond = int(0)
    for row in range(low_v, high_v + 1):
        for column in range(low_u, high_u + 1):
            beyond += wp.where(farthest[row, column] >= near, 1, 0)
    return beyond


@cache
def hide_kernel(config: SplatConfig):
    """Kernel, for one thread, that leaves the blocks of a list that may still win a pixel.

    They are those of `seen` from `first` to before `end`, with lower bounds `near` of their depths;
    `farthest` is of the tiles.
    """
    Source = config.source.struct
    sphere_of = config.source.sphere_of
    Lens = config.lens.struct
    bounds_of = config.lens.bounds

    @wp.kernel(module="unique", module_options=EXACT, enable_backward=False)
    def leave_out_hidden(
        # In:
        views: wp.array[View],
        lenses: wp.array[Lens],
        v: wp.int32,
        source: Source,
        seen: wp.array[wp.int32],
        near: wp.array[wp.float32],
        first: wp.int32,
        end: wp.int32,
        farthest: wp.array2d[wp.float32],
        # Out:
        left_out: wp.array[wp.int32],
        length_out: wp.array[wp.int32],
    ):
        view = views[v]
        length = int(0)
        for i in range(first, end):
            entry = seen[i]
            may_win = int(1)
            if entry < 0:
                sphere = camera_sphere(view, sphere_of(source, -1 - entry))
                center = wp.vec3f(sphere[0], sphere[1], sphere[2])
                if center[0] > LEAST_DISTANCE * sphere[3]:
                    bounds = bounds_of(lenses[v], center, sphere[3])
                    may_win = tiles_beyond(farthest, view, bounds, near[i])
            if may_win > 0:
                left_out[length] = entry
                length += 1
        length_out[0] = length

    return leave_out_hidden
