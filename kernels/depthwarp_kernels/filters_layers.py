"""Layers of a depth map: how far a surface's own pixels are apart, and its nearest ones by area.

The own-layer spacing S of a pixel is the radius of the smallest square ring that holds `COMPANIONS`
pixels of its layer. The pyramid of minima keeps, for areas of 1, 2, 4, 8 and 16 pixels a side, the
nearest pixel with its spacing and place. Kernels take `first_row`: rows of all views counted on.
"""

import warp as wp

from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

COMPANIONS = wp.constant(4)
"""Pixels of the same layer that a ring has to hold."""

LAYER_MARGIN = wp.constant(wp.float32(0.03))
LAYER_SLOPE = wp.constant(wp.float32(1.5))
"""Pixels d apart are of one layer if their depths differ by at most 0.03 m + 1.5 d pitch."""

FARTHEST_RING = wp.constant(32)
"""Largest ring that is searched [px]."""

NO_RING = wp.constant(33)
"""Spacing of a pixel without enough companions in the largest ring."""

SPACING_BINS = 34
"""Counts of a row: of each spacing from 0 to `NO_RING`."""

LEVELS = 5
"""Levels of the pyramid: areas of 1 to 16 pixels a side."""

EMPTY_CELL = 0xFFFFFFFFFFFFFFFF

LARGEST_DEPTH = wp.constant(wp.float32(3.0e38))

STATE_ERASED = wp.constant(wp.uint8(3))


@wp.struct
class PixelGrid:
    """What filters know of a camera.

    At depth z two neighbouring pixels are `slope * z + constant` metres apart. `wraps` is 1 where
    the first and the last column are neighbours.
    """

    slope: wp.float32
    constant: wp.float32
    wraps: wp.int32


@wp.func
def pitch(grid: PixelGrid, depth: wp.float32):
    """Metres between neighbouring pixels at a depth."""
    return grid.slope * depth + grid.constant


@wp.func
def is_present(depth: wp.float32, state: wp.uint8):
    """Whether a pixel has a depth: it is not empty, not erased with its depth kept, and finite."""
    return depth > 0.0 and depth < LARGEST_DEPTH and state != STATE_ERASED


@wp.func
def column_in_image(column: wp.int32, columns: wp.int32, wraps: wp.int32):
    """The column, round the turn where the image wraps; -1 outside."""
    if column >= 0 and column < columns:
        return column
    if wraps == 0:
        return -1
    if column < 0:
        column += columns
    else:
        column -= columns
    return wp.where(column >= 0 and column < columns, column, -1)


@wp.func
def companions_in_row(
    depth: wp.array3d[wp.float32],
    state: wp.array3d[wp.uint8],
    v: wp.int32,
    row: wp.int32,
    first: wp.int32,
    last: wp.int32,
    step: wp.int32,
    wraps: wp.int32,
    own: wp.float32,
    within: wp.float32,
):
    """Pixels of a row, in columns from first to last, whose depth is within metres of one's own."""
    found = int(0)
    columns = depth.shape[2]
    if row >= 0 and row < depth.shape[1]:
        c = int(first)
        while c <= last:
            column = wp.where(wraps != 0, column_in_image(c, columns, wraps), c)
            if column >= 0 and column < columns:
                d = depth[v, row, column]
                if wp.abs(d - own) <= within and is_present(d, state[v, row, column]):
                    found += 1
            c += step
    return found


# The smallest ring of whole radius, at most `FARTHEST_RING`, inside which `COMPANIONS` pixels are
# of the pixel's own layer: within 0.03 m + 1.5 r pitch of its depth, r the companion's own ring.
# Row counts belong to the thread that has the row, so on a CPU they need no atomics.
# Launch over (rows, columns).
@wp.kernel
def find_spacing(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    state: wp.array3d[wp.uint8],
    grids: wp.array[PixelGrid],
    # Out:
    spacing_out: wp.array3d[wp.uint8],
    counts_out: wp.array3d[wp.int32],
):
    i, column = wp.tid()
    v = (first_row + i) // depth.shape[1]
    row = (first_row + i) % depth.shape[1]
    own = depth[v, row, column]
    spacing = int(0)
    if is_present(own, state[v, row, column]):
        grid = grids[v]
        slope = LAYER_SLOPE * pitch(grid, own)
        found = int(0)
        r = int(0)
        while found < COMPANIONS and r < FARTHEST_RING:
            r += 1
            within = LAYER_MARGIN + slope * wp.float32(r)
            left = column - r
            right = column + r
            for k in range(-r, r + 1):
                # The whole of the uppermost and the lowest row, of the others both ends.
                step = wp.where(wp.abs(k) == r, 1, 2 * r)
                found += companions_in_row(
                    depth, state, v, row + k, left, right, step, grid.wraps, own, within
                )
        spacing = wp.where(found < COMPANIONS, NO_RING, r)
        wp.atomic_add(counts_out, v, row, spacing, 1)
    spacing_out[v, row, column] = wp.uint8(spacing)


# Launch over (views, `SPACING_BINS`).
@wp.kernel
def sum_counts(
    # In:
    row_counts: wp.array3d[wp.int32],
    # Out:
    counts_out: wp.array2d[wp.int32],
):
    v, spacing = wp.tid()
    total = int(0)
    for row in range(row_counts.shape[1]):
        total += row_counts[v, row, spacing]
    counts_out[v, spacing] = total


# A pixel farther from its companions than 6 times the median, from 12 to 32 px, is isolated.
# Launch over views.
@wp.kernel
def find_limit(
    # In:
    counts: wp.array2d[wp.int32],
    # Out:
    limit_out: wp.array[wp.int32],
):
    v = wp.tid()
    total = int(0)
    for spacing in range(1, counts.shape[1]):
        total += counts[v, spacing]
    below = int(0)
    median = int(0)
    while 2 * below < total:
        median += 1
        below += counts[v, median]
    limit_out[v] = wp.clamp(6 * median, 12, FARTHEST_RING)


# A cell is `depth bits << 32 | spacing << 16 | row in the area << 8 | column in the area`, so the
# smallest cell is the nearest pixel.
@wp.func
def depth_of_cell(cell: wp.uint64):
    """Depth [m]; NaN of an empty cell, so that no comparison with it holds."""
    return wp.cast(wp.uint32(cell >> wp.uint64(32)), wp.float32)


@wp.func
def spacing_of_cell(cell: wp.uint64):
    """Own-layer spacing [px]."""
    return wp.int32(wp.uint32(cell) >> wp.uint32(16))


@wp.func
def row_of_cell(cell: wp.uint64):
    """Row of the pixel inside the area."""
    return wp.int32((wp.uint32(cell) >> wp.uint32(8)) & wp.uint32(255))


@wp.func
def column_of_cell(cell: wp.uint64):
    """Column of the pixel inside the area."""
    return wp.int32(wp.uint32(cell) & wp.uint32(255))


# Isolated pixels are left out: they speak for no surface.
# Launch over (rows, columns).
@wp.kernel
def fill_first_level(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    spacing: wp.array3d[wp.uint8],
    limit: wp.array[wp.int32],
    # Out:
    cells_out: wp.array2d[wp.uint64],
):
    i, column = wp.tid()
    v = (first_row + i) // depth.shape[1]
    row = (first_row + i) % depth.shape[1]
    s = wp.int32(spacing[v, row, column])
    cell = wp.uint64(EMPTY_CELL)
    if s > 0 and s <= limit[v]:
        bits = wp.uint64(wp.cast(depth[v, row, column], wp.uint32))
        cell = (bits << wp.uint64(32)) | wp.uint64(s << 16)
    cells_out[v, row * depth.shape[2] + column] = cell


# Launch over (rows, columns) of the level; `below` is the first cell of the finer level, of
# `rows` x `columns` cells, and `own` that of this one.
@wp.kernel
def fill_next_level(
    # In:
    first_row: wp.int32,
    below: wp.int32,
    own: wp.int32,
    rows: wp.int32,
    columns: wp.int32,
    level: wp.int32,
    # Out:
    cells_out: wp.array2d[wp.uint64],
):
    i, column = wp.tid()
    own_rows = (rows + 1) // 2
    v = (first_row + i) // own_rows
    row = (first_row + i) % own_rows
    half = wp.uint64(1 << (level - 1))
    nearest = wp.uint64(EMPTY_CELL)
    for k in range(4):
        r = 2 * row + k // 2
        c = 2 * column + k % 2
        if r < rows and c < columns:
            cell = cells_out[v, below + r * columns + c]
            if cell != wp.uint64(EMPTY_CELL):
                place = half * wp.uint64(k % 2) + (half * wp.uint64(k // 2) << wp.uint64(8))
                nearest = wp.min(nearest, cell + place)
    cells_out[v, own + row * ((columns + 1) // 2) + column] = nearest
