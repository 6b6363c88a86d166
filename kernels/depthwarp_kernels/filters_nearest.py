"""Filling empty pixels with the nearest pixel of the image.

Kernels read only pixels that hold a depth and write only those that hold none, so filling in place
sees the map as it was. They take `first_row`: rows of all views counted on.
"""

import warp as wp

from depthwarp_kernels.filters_fill import STATE_FILLED
from depthwarp_kernels.filters_layers import PixelGrid, column_in_image, is_present
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)


@wp.func
def is_before(
    way: wp.int32,
    depth: wp.float32,
    index: wp.int32,
    other_way: wp.int32,
    other_depth: wp.float32,
    other_index: wp.int32,
):
    """Order of candidates: by distance in pixels, then depth, then index."""
    if way != other_way:
        return way < other_way
    if depth != other_depth:
        return depth < other_depth
    return index < other_index


# Row of the nearest pixel with a depth in the own column, at most `radius` away; -1 without one.
# Launch over (rows, columns).
@wp.kernel
def nearest_in_column(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    index: wp.array3d[wp.int32],
    state: wp.array3d[wp.uint8],
    radius: wp.int32,
    # Out:
    source_out: wp.array3d[wp.int32],
):
    i, column = wp.tid()
    rows = depth.shape[1]
    v = (first_row + i) // rows
    row = (first_row + i) % rows
    source = int(-1)
    for k in range(radius + 1):
        if source < 0:
            for side in range(2):
                r = wp.where(side == 0, row - k, row + k)
                if r >= 0 and r < rows:
                    d = depth[v, r, column]
                    if is_present(d, state[v, r, column]):
                        if source < 0 or is_before(
                            0,
                            d,
                            index[v, r, column],
                            0,
                            depth[v, source, column],
                            index[v, source, column],
                        ):
                            source = r
    source_out[v, row, column] = source


# Launch over (rows, columns).
@wp.kernel
def fill_nearest(
    # In:
    first_row: wp.int32,
    source: wp.array3d[wp.int32],
    radius: wp.int32,
    grids: wp.array[PixelGrid],
    # Out:
    depth_out: wp.array3d[wp.float32],
    index_out: wp.array3d[wp.int32],
    state_out: wp.array3d[wp.uint8],
):
    i, column = wp.tid()
    rows = depth_out.shape[1]
    v = (first_row + i) // rows
    row = (first_row + i) % rows
    if is_present(depth_out[v, row, column], state_out[v, row, column]):
        return
    wraps = grids[v].wraps
    best = int(radius * radius + 1)
    depth = wp.float32(0.0)
    index = int(-1)
    for k in range(-radius, radius + 1):
        c = column_in_image(column + k, depth_out.shape[2], wraps)
        if c >= 0:
            r = source[v, row, c]
            way = (r - row) * (r - row) + k * k
            if r >= 0 and way <= best:
                d = depth_out[v, r, c]
                j = index_out[v, r, c]
                if is_before(way, d, j, best, depth, index):
                    best = way
                    depth = d
                    index = j
    if depth > 0.0:
        depth_out[v, row, column] = depth
        index_out[v, row, column] = index
        state_out[v, row, column] = STATE_FILLED
