"""Pixels that see too little of the sky before them: hidden, by the solid angle of a cone.

Kernels take `first_row`: rows of all views counted on.
"""

import warp as wp

from depthwarp_kernels.filters_layers import (
    PixelGrid,
    column_in_image,
    erase_pixel,
    is_present,
    pitch,
)
from depthwarp_kernels.filters_sectors import sector_bit
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

REACH = wp.constant(31)
"""Farthest offset along rows and columns that the table of sectors holds [px]."""


# Depth of pixels that hold one, 0 elsewhere. Launch over (rows, columns).
@wp.kernel
def copy_present(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    state: wp.array3d[wp.uint8],
    # Out:
    depth_out: wp.array3d[wp.float32],
):
    i, column = wp.tid()
    v = (first_row + i) // depth.shape[1]
    row = (first_row + i) % depth.shape[1]
    d = depth[v, row, column]
    depth_out[v, row, column] = wp.where(is_present(d, state[v, row, column]), d, 0.0)


# In each of 8 sectors the pixel that stands highest above the viewing ray's foot leaves free what
# is nearer to the ray than it; together this is the part of the half sphere towards the camera
# that is free. Launch over (rows, columns).
@wp.kernel
def erase_by_cone(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    sector_bits: wp.array[wp.uint32],
    grids: wp.array[PixelGrid],
    radius: wp.int32,
    least_free: wp.float32,
    margin: wp.float32,
    keep_depth: wp.int32,
    # Out:
    depth_out: wp.array3d[wp.float32],
    index_out: wp.array3d[wp.int32],
    state_out: wp.array3d[wp.uint8],
):
    i, column = wp.tid()
    rows = depth.shape[1]
    columns = depth.shape[2]
    v = (first_row + i) // rows
    row = (first_row + i) % rows
    own = depth[v, row, column]
    if own == 0.0:
        return
    grid = grids[v]
    highest = wp.zeros(shape=(8,), dtype=wp.float32)  # cosine of the angle to the viewing ray
    for down in range(-radius, radius + 1):
        r = row + down
        if r >= 0 and r < rows:
            for right in range(-radius, radius + 1):
                c = column_in_image(column + right, columns, grid.wraps)
                way = down * down + right * right
                if c >= 0 and way <= radius * radius:
                    other = depth[v, r, c]
                    ahead = own - other
                    if other > 0.0 and ahead > margin:
                        aside = wp.sqrt(wp.float32(way)) * pitch(grid, other)
                        cosine = ahead / wp.sqrt(ahead * ahead + aside * aside)
                        bit = sector_bit(sector_bits, 2 * right, 2 * down)
                        for sector in range(8):
                            if (bit >> wp.uint32(4 * sector)) & wp.uint32(15) != wp.uint32(0):
                                highest[sector] = wp.max(highest[sector], cosine)
    free = wp.float32(0.0)
    for sector in range(8):
        free += wp.float32(0.125) * (wp.float32(1.0) - highest[sector])
    if free < least_free:
        erase_pixel(depth_out, index_out, state_out, v, row, column, keep_depth)
