"""From a Z-buffer of packed keys to depth, index and state; on CPUs in blocks of pixels."""

import warp as wp

from depthwarp_kernels.options import EXACT
from depthwarp_kernels.splat import DRAWN, EMPTY_KEY, count

wp.set_module_options(EXACT)

BLOCK = 512
"""Pixels of a block: a loop of fixed length without branches, several pixels at once."""

STATE_EMPTY = wp.constant(wp.uint8(0))
STATE_MEASURED = wp.constant(wp.uint8(1))


@wp.func
def depth_of_key(key: wp.uint64):
    """Depth [m] of the winner; 0 without one."""
    depth = wp.cast(wp.uint32(key >> wp.uint64(32)), wp.float32)
    return wp.where(key == wp.uint64(EMPTY_KEY), 0.0, depth)


# An empty key ends in 32 ones: as a signed number it is the -1 that says so.
@wp.func
def index_of_key(key: wp.uint64):
    """Row of the winner in the cloud; -1 without one."""
    return wp.int32(key & wp.uint64(0xFFFFFFFF))


@wp.func
def state_of_key(key: wp.uint64):
    """Empty or measured."""
    return wp.where(key == wp.uint64(EMPTY_KEY), STATE_EMPTY, STATE_MEASURED)


# Launch over (views, pixels from `first` on).
@wp.kernel
def resolve(
    # In:
    keys: wp.array2d[wp.uint64],
    first: wp.int32,
    # Out:
    depth_out: wp.array2d[wp.float32],
    index_out: wp.array2d[wp.int32],
    state_out: wp.array2d[wp.uint8],
    counts_out: wp.array2d[wp.int64],
):
    v, i = wp.tid()
    cell = first + i
    key = keys[v, cell]
    depth_out[v, cell] = depth_of_key(key)
    index_out[v, cell] = index_of_key(key)
    state_out[v, cell] = state_of_key(key)
    if key != wp.uint64(EMPTY_KEY):
        count(counts_out, v, DRAWN)


# Launch over blocks of the pixels of one view, from block `first` on.
@wp.kernel
def resolve_blocks(
    # In:
    keys: wp.array[wp.uint64],
    first: wp.int32,
    # Out:
    depth_out: wp.array[wp.float32],
    index_out: wp.array[wp.int32],
    state_out: wp.array[wp.uint8],
    counts_out: wp.array[wp.int64],
):
    begin = (first + wp.tid()) * wp.static(BLOCK)
    drawn = int(0)
    for k in range(wp.static(BLOCK)):
        cell = begin + k
        key = keys[cell]
        depth_out[cell] = depth_of_key(key)
        index_out[cell] = index_of_key(key)
        state_out[cell] = state_of_key(key)
        drawn += wp.where(key == wp.uint64(EMPTY_KEY), 0, 1)
    counts_out[DRAWN] = counts_out[DRAWN] + wp.int64(drawn)


# Launch over blocks of two buffers of one view, from block `first` on: the smaller keys stay in the
# second.
@wp.kernel
def merge_blocks(
    # In:
    keys: wp.array[wp.uint64],
    first: wp.int32,
    # Out:
    keys_out: wp.array[wp.uint64],
):
    begin = (first + wp.tid()) * wp.static(BLOCK)
    for k in range(wp.static(BLOCK)):
        cell = begin + k
        keys_out[cell] = wp.min(keys_out[cell], keys[cell])


@wp.func
def is_empty(key: wp.uint32):
    """Whether no depth is kept: all ones, as a signed number -1."""
    return wp.int32(key) == -1


@wp.func
def depth_alone(key: wp.uint32):
    """Depth [m] that is kept; 0 without one."""
    return wp.where(is_empty(key), 0.0, wp.cast(key, wp.float32))


@wp.func
def state_alone(key: wp.uint32):
    """Empty or measured."""
    return wp.where(is_empty(key), STATE_EMPTY, STATE_MEASURED)


# The same three of keys that are depths alone.
@wp.kernel
def resolve_depth(
    # In:
    keys: wp.array2d[wp.uint32],
    first: wp.int32,
    # Out:
    depth_out: wp.array2d[wp.float32],
    state_out: wp.array2d[wp.uint8],
    counts_out: wp.array2d[wp.int64],
):
    v, i = wp.tid()
    cell = first + i
    key = keys[v, cell]
    depth_out[v, cell] = depth_alone(key)
    state_out[v, cell] = state_alone(key)
    if not is_empty(key):
        count(counts_out, v, DRAWN)


@wp.kernel
def resolve_depth_blocks(
    # In:
    keys: wp.array[wp.uint32],
    first: wp.int32,
    # Out:
    depth_out: wp.array[wp.float32],
    state_out: wp.array[wp.uint8],
    counts_out: wp.array[wp.int64],
):
    begin = (first + wp.tid()) * wp.static(BLOCK)
    drawn = int(0)
    for k in range(wp.static(BLOCK)):
        cell = begin + k
        key = keys[cell]
        depth_out[cell] = depth_alone(key)
        state_out[cell] = state_alone(key)
        drawn += wp.where(is_empty(key), 0, 1)
    counts_out[DRAWN] = counts_out[DRAWN] + wp.int64(drawn)


@wp.kernel
def merge_depth_blocks(
    # In:
    keys: wp.array[wp.uint32],
    first: wp.int32,
    # Out:
    keys_out: wp.array[wp.uint32],
):
    begin = (first + wp.tid()) * wp.static(BLOCK)
    for k in range(wp.static(BLOCK)):
        cell = begin + k
        keys_out[cell] = wp.min(keys_out[cell], keys[cell])
