"""Filling empty pixels with planes through the surfaces round them.

The kernel reads only pixels that hold a depth and writes only those that hold none, so filling in
place sees the map as it was. It takes `first_row`: rows of all views counted on.
"""

import warp as wp

from depthwarp_kernels.filters_fill_planes import Moments, add_to, depth_of_plane, plane_of
from depthwarp_kernels.filters_fill_samples import (
    MOST_SAMPLES,
    closest_sample,
    gather_samples,
    squared,
)
from depthwarp_kernels.filters_hidden import sector_bit, surrounds
from depthwarp_kernels.filters_layers import PixelGrid, is_present, pitch
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

STATE_FILLED = wp.constant(wp.uint8(2))
STATE_FILLED_BORDER = wp.constant(wp.uint8(4))

MOST_LAYERS = wp.constant(3)
"""Layers that are tried, from the nearest on."""

FILL_EMPTY = wp.constant(8)
"""Longest run of empty sectors of 16 of a layer that surrounds a pixel."""

FILL_MARGIN = wp.constant(wp.float32(0.03))
FILL_SLOPE = wp.constant(wp.float32(4.0))
"""A layer holds what lies within 0.03 m + 4 d pitch behind its nearest sample, d px from it."""

NO_DEPTH = wp.constant(wp.float32(3.0e38))


@wp.struct
class Layer:
    """Samples of one surface: sectors and members as bits, depths from near to far, the closest."""

    sectors: wp.int32
    near: wp.float32
    far: wp.float32
    closest: wp.int32
    members: wp.uint64


# Which of its pixels are empty, as bits: row by row.
@wp.func
def empty_of_block(
    depth: wp.array3d[wp.float32],
    state: wp.array3d[wp.uint8],
    v: wp.int32,
    top: wp.int32,
    left: wp.int32,
):
    """The empty pixels of a block of 2 x 2, as bits."""
    empty = int(0)
    for k in range(4):
        row = top + k // 2
        column = left + k % 2
        if row < depth.shape[1] and column < depth.shape[2]:
            if not is_present(depth[v, row, column], state[v, row, column]):
                empty = empty | (1 << k)
    return empty


@wp.func
def layer_behind(
    beyond: wp.float32,
    depth: wp.array[wp.float32],
    right: wp.array[wp.int32],
    down: wp.array[wp.int32],
    count: wp.int32,
    grid: PixelGrid,
    sector_bits: wp.array[wp.uint16],
):
    """The nearest layer all of which is farther than a depth; `closest` is -1 without one."""
    layer = Layer()
    layer.closest = -1
    layer.near = NO_DEPTH
    start = int(0)
    for k in range(count):
        if depth[k] > beyond and depth[k] < layer.near:
            layer.near = depth[k]
            start = k
    if layer.near == NO_DEPTH:
        return layer
    layer.closest = start
    slope = wp.float32(0.5) * FILL_SLOPE * pitch(grid, layer.near)
    least = squared(right[start], down[start])
    for k in range(count):
        behind = depth[k] - layer.near
        if behind >= 0.0:
            apart = squared(right[k] - right[start], down[k] - down[start])
            if behind <= FILL_MARGIN + slope * wp.sqrt(wp.float32(apart)):
                layer.members = layer.members | (wp.uint64(1) << wp.uint64(k))
                layer.sectors = layer.sectors | sector_bit(sector_bits, right[k], down[k])
                layer.far = wp.max(layer.far, depth[k])
                way = squared(right[k], down[k])
                if way < least:
                    least = way
                    layer.closest = k
    return layer


# The four pixels of a block share their samples and their plane: of the first layer, from the
# nearest on, whose samples surround the block's middle. Else the closest sample, as at a border.
# Launch over (rows, columns) of blocks.
@wp.kernel
def fill_planes(
    # In:
    first_row: wp.int32,
    cells: wp.array2d[wp.uint64],
    sector_bits: wp.array[wp.uint16],
    grids: wp.array[PixelGrid],
    # Out:
    depth_out: wp.array3d[wp.float32],
    index_out: wp.array3d[wp.int32],
    state_out: wp.array3d[wp.uint8],
):
    i, j = wp.tid()
    rows = depth_out.shape[1]
    columns = depth_out.shape[2]
    v = (first_row + i) // ((rows + 1) // 2)
    top = 2 * ((first_row + i) % ((rows + 1) // 2))
    left = 2 * j
    empty = empty_of_block(depth_out, state_out, v, top, left)
    if empty == 0:
        return
    grid = grids[v]
    depth = wp.zeros(shape=(wp.static(MOST_SAMPLES),), dtype=wp.float32)
    right = wp.zeros(shape=(wp.static(MOST_SAMPLES),), dtype=wp.int32)
    down = wp.zeros(shape=(wp.static(MOST_SAMPLES),), dtype=wp.int32)
    count = gather_samples(cells, grid, v, top, left, rows, columns, depth, right, down)
    if count == 0:
        return
    chosen = int(-1)
    layer = Layer()
    for _layer in range(MOST_LAYERS):
        layer = layer_behind(layer.far, depth, right, down, count, grid, sector_bits)
        if layer.closest < 0:
            break
        if surrounds(layer.sectors, FILL_EMPTY):
            chosen = layer.closest
            break
    inside = chosen >= 0
    plane = wp.vec3f()
    if inside:
        sums = Moments()
        for k in range(count):
            if (layer.members >> wp.uint64(k)) & wp.uint64(1) != wp.uint64(0):
                sums = add_to(sums, right[k], down[k], depth[k])
        plane = plane_of(sums)
    else:
        chosen = closest_sample(depth, right, down, count)
    source = (left + ((right[chosen] + 1) >> 1) + columns) % columns
    index = index_out[v, top + ((down[chosen] + 1) >> 1), source]
    for k in range(4):
        if (empty >> k) & 1 != 0:
            z = depth[chosen]
            if inside:
                z = depth_of_plane(plane, k, layer.near, layer.far)
            depth_out[v, top + k // 2, left + k % 2] = z
            index_out[v, top + k // 2, left + k % 2] = index
            state_out[v, top + k // 2, left + k % 2] = wp.where(
                inside, STATE_FILLED, STATE_FILLED_BORDER
            )
