"""Filling empty pixels with planes through the surfaces round them.

The kernel reads only pixels that hold a depth and writes only those that hold none, so filling in
place sees the map as it was. It takes `first_row`: rows of all views counted on.
"""

import warp as wp

from depthwarp_kernels.filters_fill_layers import (
    Layer,
    layer_behind,
    layer_round,
    plane_through,
    thickened,
)
from depthwarp_kernels.filters_fill_planes import depth_of_plane
from depthwarp_kernels.filters_fill_samples import (
    MOST_SAMPLES,
    closest_at_border,
    column_of_sample,
    gather_samples,
    row_of_sample,
)
from depthwarp_kernels.filters_layers import WORD, PixelGrid
from depthwarp_kernels.filters_sectors import surrounds
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

STATE_FILLED = wp.constant(wp.uint8(2))
STATE_FILLED_BORDER = wp.constant(wp.uint8(4))

MOST_LAYERS = wp.constant(3)
"""Layers that are tried, from the nearest on."""

FILL_EMPTY = wp.constant(18)
"""Longest run of empty sectors of 32 of a layer that surrounds a pixel."""

WIDER_REACH = wp.constant(3)
"""Half pixels more of reach round a whole block: what reaches one of its quarters reaches it."""


@wp.func
def empty_of_block(
    words: wp.array3d[wp.uint32], columns: wp.int32, v: wp.int32, top: wp.int32, left: wp.int32
):
    """The empty pixels of a block of 4 x 4, as bits, row by row."""
    inside = (1 << wp.min(columns - left, 4)) - 1
    empty = int(0)
    for k in range(wp.min(words.shape[1] - top, 4)):
        present = words[v, top + k, left // WORD] >> wp.uint32(left % WORD)
        empty = empty | ((~wp.int32(present) & inside) << (4 * k))
    return empty


# `empty` are bits of a row of 4; (right, down) is the pixel that gives its index, in half pixels
# from the middle.
@wp.func
def write_block(
    empty: wp.int32,
    size: wp.int32,
    inside: bool,
    plane: wp.vec3f,
    near: wp.float32,
    far: wp.float32,
    right: wp.int32,
    down: wp.int32,
    v: wp.int32,
    top: wp.int32,
    left: wp.int32,
    depth_out: wp.array3d[wp.float32],
    index_out: wp.array3d[wp.int32],
    state_out: wp.array3d[wp.uint8],
):
    """Fill the empty pixels of a block with a plane's depths."""
    columns = depth_out.shape[2]
    source = column_of_sample(right, left, size, columns)
    index = index_out[v, row_of_sample(down, top, size), source]
    for k in range(size * size):
        row = k // size
        column = k % size
        if (empty >> (4 * row + column)) & 1 != 0:
            depth_out[v, top + row, left + column] = depth_of_plane(
                plane, 2 * column - size + 1, 2 * row - size + 1, near, far
            )
            index_out[v, top + row, left + column] = index
            state_out[v, top + row, left + column] = wp.where(
                inside, STATE_FILLED, STATE_FILLED_BORDER
            )


# The last three arrays before the maps are room for samples.
@wp.func
def fill_quarter(
    empty: wp.int32,
    v: wp.int32,
    top: wp.int32,
    left: wp.int32,
    cells: wp.array2d[wp.uint64],
    sector_bits: wp.array[wp.uint32],
    grid: PixelGrid,
    depth: wp.array[wp.float32],
    right: wp.array[wp.int32],
    down: wp.array[wp.int32],
    depth_out: wp.array3d[wp.float32],
    index_out: wp.array3d[wp.int32],
    state_out: wp.array3d[wp.uint8],
):
    """Fill the empty pixels of a block of 2 x 2."""
    if empty == 0:
        return
    rows = depth_out.shape[1]
    columns = depth_out.shape[2]
    count = gather_samples(cells, grid, v, top, left, 2, 0, rows, columns, depth, right, down)
    if count == 0:
        return
    inside = bool(False)
    layer = Layer()
    for _layer in range(MOST_LAYERS):
        layer = layer_behind(layer.far, depth, right, down, count, grid, sector_bits)
        if layer.closest < 0:
            break
        if surrounds(layer.sectors, FILL_EMPTY):
            inside = True
            break
    chosen = layer.closest
    if not inside:
        chosen = closest_at_border(cells, v, top, left, columns, depth, right, down, count)
        if chosen < 0:
            return
    layer = thickened(layer_round(chosen, depth, right, down, count, grid))
    write_block(
        empty,
        2,
        inside,
        plane_through(layer, depth, right, down, count),
        layer.near,
        layer.far,
        right[layer.closest],
        down[layer.closest],
        v,
        top,
        left,
        depth_out,
        index_out,
        state_out,
    )


# A block of 4 x 4 round which there is one surface alone, on all sides, takes its plane. Of another
# each quarter has samples of its own: it takes the plane of the first layer, from the nearest on,
# that surrounds its middle, or else, as at a border, that of the closest sample's layer.
# Launch over (rows, columns) of blocks of 4 x 4.
@wp.kernel
def fill_planes(
    # In:
    first_row: wp.int32,
    words: wp.array3d[wp.uint32],
    cells: wp.array2d[wp.uint64],
    sector_bits: wp.array[wp.uint32],
    grids: wp.array[PixelGrid],
    # Out:
    depth_out: wp.array3d[wp.float32],
    index_out: wp.array3d[wp.int32],
    state_out: wp.array3d[wp.uint8],
):
    i, j = wp.tid()
    rows = depth_out.shape[1]
    columns = depth_out.shape[2]
    v = (first_row + i) // ((rows + 3) // 4)
    top = 4 * ((first_row + i) % ((rows + 3) // 4))
    left = 4 * j
    empty = empty_of_block(words, columns, v, top, left)
    if empty == 0:
        return
    grid = grids[v]
    depth = wp.zeros(shape=(wp.static(MOST_SAMPLES),), dtype=wp.float32)
    right = wp.zeros(shape=(wp.static(MOST_SAMPLES),), dtype=wp.int32)
    down = wp.zeros(shape=(wp.static(MOST_SAMPLES),), dtype=wp.int32)
    count = gather_samples(
        cells, grid, v, top, left, 4, WIDER_REACH, rows, columns, depth, right, down
    )
    if count == 0:
        return
    layer = layer_behind(wp.float32(0.0), depth, right, down, count, grid, sector_bits)
    all_members = (wp.uint64(1) << wp.uint64(count)) - wp.uint64(1)
    if layer.members == all_members and surrounds(layer.sectors, FILL_EMPTY):
        whole = thickened(layer)  # its corners may lie outside
        write_block(
            empty,
            4,
            True,
            plane_through(layer, depth, right, down, count),
            whole.near,
            whole.far,
            right[layer.closest],
            down[layer.closest],
            v,
            top,
            left,
            depth_out,
            index_out,
            state_out,
        )
        return
    for quarter in range(4):
        fill_quarter(
            (empty >> (8 * (quarter // 2) + 2 * (quarter % 2))) & 0x33,
            v,
            top + 2 * (quarter // 2),
            left + 2 * (quarter % 2),
            cells,
            sector_bits,
            grid,
            depth,
            right,
            down,
            depth_out,
            index_out,
            state_out,
        )
