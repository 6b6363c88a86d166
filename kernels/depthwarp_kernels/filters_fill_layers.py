"""Layers among the samples round an empty pixel."""

import warp as wp

from depthwarp_kernels.filters_fill_planes import Moments, add_to, plane_of
from depthwarp_kernels.filters_fill_samples import squared
from depthwarp_kernels.filters_layers import PixelGrid, pitch
from depthwarp_kernels.filters_sectors import sector_bit
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

FILL_MARGIN = wp.constant(wp.float32(0.03))
FILL_SLOPE = wp.constant(wp.float32(4.0))
"""A layer holds what lies within 0.03 m + 4 d pitch of a sample, d px from it."""

NO_DEPTH = wp.constant(wp.float32(3.0e38))


@wp.struct
class Layer:
    """Samples of one surface: sectors and members as bits, depths from near to far, the closest."""

    sectors: wp.uint32
    near: wp.float32
    far: wp.float32
    closest: wp.int32
    members: wp.uint64


@wp.func
def layer_behind(
    beyond: wp.float32,
    depth: wp.array[wp.float32],
    right: wp.array[wp.int32],
    down: wp.array[wp.int32],
    count: wp.int32,
    grid: PixelGrid,
    sector_bits: wp.array[wp.uint32],
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


@wp.func
def layer_round(
    chosen: wp.int32,
    depth: wp.array[wp.float32],
    right: wp.array[wp.int32],
    down: wp.array[wp.int32],
    count: wp.int32,
    grid: PixelGrid,
):
    """The layer of one sample: what lies so little before or behind it; no sectors are marked."""
    layer = Layer()
    layer.closest = chosen
    own = depth[chosen]
    layer.near = own
    layer.far = own
    slope = wp.float32(0.5) * FILL_SLOPE * pitch(grid, own)
    for k in range(count):
        apart = squared(right[k] - right[chosen], down[k] - down[chosen])
        if wp.abs(depth[k] - own) <= FILL_MARGIN + slope * wp.sqrt(wp.float32(apart)):
            layer.members = layer.members | (wp.uint64(1) << wp.uint64(k))
            layer.near = wp.min(layer.near, depth[k])
            layer.far = wp.max(layer.far, depth[k])
    return layer


@wp.func
def thickened(layer: Layer):
    """A layer with half its thickness more on either side, for what lies outside its samples."""
    beyond = wp.float32(0.5) * (layer.far - layer.near)
    layer.near = wp.max(layer.near - beyond, wp.float32(0.5) * layer.near)
    layer.far += beyond
    return layer


@wp.func
def plane_through(
    layer: Layer,
    depth: wp.array[wp.float32],
    right: wp.array[wp.int32],
    down: wp.array[wp.int32],
    count: wp.int32,
):
    """The plane through the members of a layer."""
    sums = Moments()
    for k in range(count):
        if (layer.members >> wp.uint64(k)) & wp.uint64(1) != wp.uint64(0):
            sums = add_to(sums, right[k], down[k], depth[k])
    return plane_of(sums)
