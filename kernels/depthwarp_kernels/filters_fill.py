"""Filling empty pixels with planes through the surfaces round them.

The kernel reads only pixels that hold a depth and writes only those that hold none, so filling in
place sees the map as it was. It takes `first_row`: rows of all views counted on.
"""

import warp as wp

from depthwarp_kernels.filters_hidden import offset_round, sector_bit, surrounds
from depthwarp_kernels.filters_layers import (
    LEVELS,
    PixelGrid,
    column_in_image,
    column_of_cell,
    depth_of_cell,
    is_present,
    pitch,
    row_of_cell,
    spacing_of_cell,
)
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

STATE_FILLED = wp.constant(wp.uint8(2))
STATE_FILLED_BORDER = wp.constant(wp.uint8(4))

MOST_SAMPLES = 52
"""Samples round a block: 4 x 4 pixels, and 3 x 3 areas of each of the other levels."""

ENOUGH = wp.constant(4)
"""Samples from which coarser areas are not looked at."""

MOST_LAYERS = wp.constant(3)
"""Layers that are tried, from the nearest on."""

FILL_REACH = wp.constant(wp.float32(1.5))
"""A sample speaks for pixels up to so many times its own spacing away."""

FILL_EMPTY = wp.constant(8)
"""Longest run of empty sectors of 16 of a layer that surrounds a pixel."""

FILL_MARGIN = wp.constant(wp.float32(0.03))
FILL_SLOPE = wp.constant(wp.float32(4.0))
"""A layer holds what lies within 0.03 m + 4 d pitch behind its nearest sample, d px from it."""

WEIGHT_AREA = wp.constant(wp.float32(0.25))
RIDGE = wp.constant(wp.float32(0.05))
"""Weights are 1 / (d^2 + 0.25 px^2); 0.05 px^2 added to the spread keeps slopes of lines finite."""

NO_DEPTH = wp.constant(wp.float32(3.0e38))


@wp.struct
class Moments:
    """Weighted sums over a layer: of 1, offsets x and y, inverse depth q, and their products."""

    w: wp.float32
    x: wp.float32
    y: wp.float32
    q: wp.float32
    xx: wp.float32
    xy: wp.float32
    yy: wp.float32
    xq: wp.float32
    yq: wp.float32


@wp.struct
class Layer:
    """Samples of one surface: sectors as bits, depths from near to far, and the closest of them."""

    sectors: wp.int32
    near: wp.float32
    far: wp.float32
    closest: wp.int32
    sums: Moments


@wp.func
def squared(right: wp.int32, down: wp.int32):
    """Square of a distance."""
    return right * right + down * down


@wp.func
def add_to(m: Moments, right: wp.int32, down: wp.int32, depth: wp.float32):
    """The sums with one more sample, at an offset in half pixels."""
    x = wp.float32(0.5) * wp.float32(right)
    y = wp.float32(0.5) * wp.float32(down)
    q = wp.float32(1.0) / depth
    w = wp.float32(1.0) / (x * x + y * y + WEIGHT_AREA)
    m.w += w
    m.x += w * x
    m.y += w * y
    m.q += w * q
    m.xx += w * (x * x)
    m.xy += w * (x * y)
    m.yy += w * (y * y)
    m.xq += w * (x * q)
    m.yq += w * (y * q)
    return m


# A plane in space is one in inverse depth: 1/z = a + b x + c y (by least squares).
@wp.func
def plane_of(m: Moments):
    """The fitted plane's (a, b, c)."""
    x = m.x / m.w
    y = m.y / m.w
    q = m.q / m.w
    xx = m.xx / m.w - x * x + RIDGE
    xy = m.xy / m.w - x * y
    yy = m.yy / m.w - y * y + RIDGE
    xq = m.xq / m.w - x * q
    yq = m.yq / m.w - y * q
    determinant = xx * yy - xy * xy
    b = (xq * yy - yq * xy) / determinant
    c = (yq * xx - xq * xy) / determinant
    return wp.vec3f(q - b * x - c * y, b, c)


@wp.func
def depth_of_plane(plane: wp.vec3f, k: wp.int32, near: wp.float32, far: wp.float32):
    """Of a plane about the middle of a block, at its pixel k, within the depths of its samples."""
    x = wp.float32(k % 2) - wp.float32(0.5)
    y = wp.float32(k // 2) - wp.float32(0.5)
    inverse = plane[0] + plane[1] * x + plane[2] * y
    inverse = wp.clamp(inverse, wp.float32(1.0) / far, wp.float32(1.0) / near)
    return wp.clamp(wp.float32(1.0) / inverse, near, far)


# What is the nearest of a coarse area is also the nearest of the finer area that it lies in.
@wp.func
def was_seen(
    row: wp.int32,
    column: wp.int32,
    level: wp.int32,
    top: wp.int32,
    left: wp.int32,
    finer_columns: wp.int32,
    wraps: wp.int32,
):
    """Whether the finer areas round the block at (top, left) held a pixel."""
    if level == 0:
        return False
    finer = level - 1
    most = wp.where(finer == 0, 2, 1)
    rows = (row >> finer) - (top >> finer)
    columns = offset_round((column >> finer) - (left >> finer), finer_columns, wraps)
    return rows >= -1 and rows <= most and columns >= -1 and columns <= most


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


# From small areas to large ones, until there are enough. Offsets are in half pixels from the middle
# of the block at (top, left).
@wp.func
def gather_samples(
    cells: wp.array2d[wp.uint64],
    grid: PixelGrid,
    v: wp.int32,
    top: wp.int32,
    left: wp.int32,
    rows: wp.int32,
    columns: wp.int32,
    depth_out: wp.array[wp.float32],
    right_out: wp.array[wp.int32],
    down_out: wp.array[wp.int32],
):
    """Number of samples whose reach covers a block's middle, written one after the other."""
    count = int(0)
    first = int(0)
    level_rows = int(rows)
    level_columns = int(columns)
    finer_columns = int(0)
    finer_wraps = int(0)
    for level in range(LEVELS):
        below = wp.where(level == 0, 2, 1)
        wraps = wp.where(level_columns > below + 1, grid.wraps, 0)  # no area twice
        for r in range(
            wp.max((top >> level) - 1, 0), wp.min((top >> level) + below + 1, level_rows)
        ):
            for side in range((left >> level) - 1, (left >> level) + below + 1):
                c = column_in_image(side, level_columns, wraps)
                if c >= 0:
                    cell = cells[v, first + r * level_columns + c]
                    if depth_of_cell(cell) > 0.0:
                        row = (r << level) + row_of_cell(cell)
                        column = (c << level) + column_of_cell(cell)
                        x = 2 * offset_round(column - left, columns, grid.wraps) - 1
                        y = 2 * (row - top) - 1
                        way = wp.float32(0.5) * wp.sqrt(wp.float32(squared(x, y)))
                        if way <= FILL_REACH * wp.float32(spacing_of_cell(cell)):
                            if not was_seen(
                                row, column, level, top, left, finer_columns, finer_wraps
                            ):
                                depth_out[count] = depth_of_cell(cell)
                                right_out[count] = x
                                down_out[count] = y
                                count += 1
        if count >= ENOUGH:
            return count
        finer_columns = level_columns
        finer_wraps = wraps
        first += level_rows * level_columns
        level_rows = (level_rows + 1) >> 1
        level_columns = (level_columns + 1) >> 1
    return count


@wp.func
def closest_sample(
    depth: wp.array[wp.float32],
    right: wp.array[wp.int32],
    down: wp.array[wp.int32],
    count: wp.int32,
):
    """The sample nearest in the image, of several the one with the smallest depth."""
    best = int(0)
    least = squared(right[0], down[0])
    for k in range(1, count):
        way = squared(right[k], down[k])
        if way < least or (way == least and depth[k] < depth[best]):
            best = k
            least = way
    return best


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
    for k in range(count):
        apart = squared(right[k] - right[start], down[k] - down[start])
        within = FILL_MARGIN + slope * wp.sqrt(wp.float32(apart))
        if depth[k] >= layer.near and depth[k] - layer.near <= within:
            layer.sectors = layer.sectors | sector_bit(sector_bits, right[k], down[k])
            layer.far = wp.max(layer.far, depth[k])
            layer.sums = add_to(layer.sums, right[k], down[k], depth[k])
            closest = layer.closest
            if squared(right[k], down[k]) < squared(right[closest], down[closest]):
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
        plane = plane_of(layer.sums)
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
