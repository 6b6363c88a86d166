"""Filling by push and pull: averages of ever larger areas, brought back where pixels are empty.

Maps of inverse depth q, weight from 0 to 1, and source (number of a pixel, -1 = none) for areas of
1, 2, 4, ... pixels a side, all levels one after the other. Kernels run over (rows, columns) of a
level and take `first_row`: rows of all views counted on.
"""

import warp as wp

from depthwarp_kernels.filters_layers import is_present
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

STATE_FILLED = wp.constant(wp.uint8(2))


@wp.kernel
def start_level(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    state: wp.array3d[wp.uint8],
    # Out:
    inverse_out: wp.array2d[wp.float32],
    weight_out: wp.array2d[wp.float32],
    source_out: wp.array2d[wp.int32],
):
    i, column = wp.tid()
    v = (first_row + i) // depth.shape[1]
    row = (first_row + i) % depth.shape[1]
    cell = row * depth.shape[2] + column
    present = is_present(depth[v, row, column], state[v, row, column])
    inverse_out[v, cell] = wp.where(present, wp.float32(1.0) / depth[v, row, column], 0.0)
    weight_out[v, cell] = wp.where(present, 1.0, 0.0)
    source_out[v, cell] = wp.where(present, cell, -1)


# `below` is the first cell of the finer level, of `rows` x `columns` cells, `own` that of this one.
# The source is that of the nearest of the four.
@wp.kernel
def pull(
    # In:
    first_row: wp.int32,
    below: wp.int32,
    own: wp.int32,
    rows: wp.int32,
    columns: wp.int32,
    # Out:
    inverse_out: wp.array2d[wp.float32],
    weight_out: wp.array2d[wp.float32],
    source_out: wp.array2d[wp.int32],
):
    i, column = wp.tid()
    v = (first_row + i) // ((rows + 1) // 2)
    row = (first_row + i) % ((rows + 1) // 2)
    total = wp.float32(0.0)
    inverse = wp.float32(0.0)
    largest = wp.float32(0.0)
    source = int(-1)
    for k in range(4):
        r = 2 * row + k // 2
        c = 2 * column + k % 2
        if r < rows and c < columns:
            cell = below + r * columns + c
            total += weight_out[v, cell]
            inverse += weight_out[v, cell] * inverse_out[v, cell]
            if source_out[v, cell] >= 0 and inverse_out[v, cell] > largest:
                largest = inverse_out[v, cell]
                source = source_out[v, cell]
    cell = own + row * ((columns + 1) // 2) + column
    inverse_out[v, cell] = wp.where(total > 0.0, inverse / total, 0.0)
    weight_out[v, cell] = wp.min(total, 1.0)
    source_out[v, cell] = source


# A cell that is not full takes the rest from the four coarse cells nearest to it, weighted as
# between their middles: 9, 3, 3 and 1. `above` is the first cell of the coarser level.
@wp.kernel
def push(
    # In:
    first_row: wp.int32,
    above: wp.int32,
    own: wp.int32,
    rows: wp.int32,
    columns: wp.int32,
    # Out:
    inverse_out: wp.array2d[wp.float32],
    weight_out: wp.array2d[wp.float32],
    source_out: wp.array2d[wp.int32],
):
    i, column = wp.tid()
    v = (first_row + i) // rows
    row = (first_row + i) % rows
    cell = own + row * columns + column
    weight = weight_out[v, cell]
    if weight == 1.0:
        return
    coarse_rows = (rows + 1) // 2
    coarse_columns = (columns + 1) // 2
    total = wp.float32(0.0)
    inverse = wp.float32(0.0)
    source = source_out[v, cell]
    for k in range(4):
        r = row // 2 + (k // 2) * (2 * (row % 2) - 1)
        c = column // 2 + (k % 2) * (2 * (column % 2) - 1)
        if r >= 0 and r < coarse_rows and c >= 0 and c < coarse_columns:
            coarse = above + r * coarse_columns + c
            share = wp.float32((3 - 2 * (k // 2)) * (3 - 2 * (k % 2)))
            total += share * weight_out[v, coarse]
            inverse += share * weight_out[v, coarse] * inverse_out[v, coarse]
            if source < 0:
                source = source_out[v, coarse]
    if total == 0.0:
        return
    mixed = weight * inverse_out[v, cell] + (wp.float32(1.0) - weight) * (inverse / total)
    inverse_out[v, cell] = mixed
    weight_out[v, cell] = 1.0
    source_out[v, cell] = source


@wp.kernel
def write_filled(
    # In:
    first_row: wp.int32,
    inverse: wp.array2d[wp.float32],
    weight: wp.array2d[wp.float32],
    source: wp.array2d[wp.int32],
    # Out:
    depth_out: wp.array3d[wp.float32],
    index_out: wp.array3d[wp.int32],
    state_out: wp.array3d[wp.uint8],
):
    i, column = wp.tid()
    v = (first_row + i) // depth_out.shape[1]
    row = (first_row + i) % depth_out.shape[1]
    columns = depth_out.shape[2]
    cell = row * columns + column
    if is_present(depth_out[v, row, column], state_out[v, row, column]):
        return
    from_pixel = source[v, cell]
    if from_pixel >= 0:
        depth_out[v, row, column] = wp.float32(1.0) / inverse[v, cell]
        index_out[v, row, column] = index_out[v, from_pixel // columns, from_pixel % columns]
        state_out[v, row, column] = STATE_FILLED
