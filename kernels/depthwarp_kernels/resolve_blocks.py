"""From the key buffers of a CPU's threads to depth, index and state, in blocks of pixels.

One pass: the smallest key of all buffers is taken, written as depth, index and state, and the
buffers are empty again for the next drawing while they are still in the caches.
"""

import warp as wp

from depthwarp_kernels.options import EXACT
from depthwarp_kernels.resolve import (
    depth_alone,
    depth_of_key,
    index_of_key,
    is_empty,
    state_alone,
    state_of_key,
)
from depthwarp_kernels.splat import DRAWN, EMPTY_KEY

wp.set_module_options(EXACT)

BLOCK = 512
"""Pixels of a block: a loop of fixed length without branches, several pixels at once."""


# In C: of all buffers together, an index can be beyond 32 bits.
def smallest_of_buffers(key_type: str):
    """Loops that bring the smallest keys of a block together and empty the block, all ones."""
    return f"""
        for (int b = 0; b < keys_out.shape[0]; ++b) {{
            {key_type}* of_buffer = keys_out.data + (b * int64_t(keys_out.shape[1]) + begin);
            for (int k = 0; k < {BLOCK}; ++k) {{
                const {key_type} key = of_buffer[k];
                {key_type}& smallest = smallest_out.data[k];
                smallest = b == 0 || key < smallest ? key : smallest;
                of_buffer[k] = ~{key_type}(0);
            }}
        }}
    """


@wp.func_native(smallest_of_buffers("uint64_t"))
def take_smallest(
    begin: wp.int32,
    keys_out: wp.array2d[wp.uint64],
    smallest_out: wp.array[wp.uint64],
):
    """The smallest keys of the cells from `begin` on, which are emptied."""


@wp.func_native(smallest_of_buffers("uint32_t"))
def take_nearest(
    begin: wp.int32,
    keys_out: wp.array2d[wp.uint32],
    smallest_out: wp.array[wp.uint32],
):
    """The same of keys that are depths alone."""


# Launch over blocks of the pixels of a view, from block `first` on; `keys_out` are the buffers that
# hold something, shape (buffers, cells). Only the last block may reach beyond the image's `pixels`.
@wp.kernel
def resolve_blocks(
    # In:
    first: wp.int32,
    pixels: wp.int32,
    # Out:
    keys_out: wp.array2d[wp.uint64],
    depth_out: wp.array[wp.float32],
    index_out: wp.array[wp.int32],
    state_out: wp.array[wp.uint8],
    counts_out: wp.array[wp.int64],
):
    begin = (first + wp.tid()) * wp.static(BLOCK)
    keys = wp.zeros(shape=(wp.static(BLOCK),), dtype=wp.uint64)
    take_smallest(begin, keys_out, keys)
    drawn = int(0)
    if begin + wp.static(BLOCK) <= pixels:
        for k in range(wp.static(BLOCK)):
            depth_out[begin + k] = depth_of_key(keys[k])
            index_out[begin + k] = index_of_key(keys[k])
            state_out[begin + k] = state_of_key(keys[k])
            drawn += wp.where(keys[k] == wp.uint64(EMPTY_KEY), 0, 1)
    else:
        for k in range(pixels - begin):
            depth_out[begin + k] = depth_of_key(keys[k])
            index_out[begin + k] = index_of_key(keys[k])
            state_out[begin + k] = state_of_key(keys[k])
            drawn += wp.where(keys[k] == wp.uint64(EMPTY_KEY), 0, 1)
    counts_out[DRAWN] = counts_out[DRAWN] + wp.int64(drawn)


# The same of keys that are depths alone.
@wp.kernel
def resolve_depth_blocks(
    # In:
    first: wp.int32,
    pixels: wp.int32,
    # Out:
    keys_out: wp.array2d[wp.uint32],
    depth_out: wp.array[wp.float32],
    state_out: wp.array[wp.uint8],
    counts_out: wp.array[wp.int64],
):
    begin = (first + wp.tid()) * wp.static(BLOCK)
    keys = wp.zeros(shape=(wp.static(BLOCK),), dtype=wp.uint32)
    take_nearest(begin, keys_out, keys)
    drawn = int(0)
    if begin + wp.static(BLOCK) <= pixels:
        for k in range(wp.static(BLOCK)):
            depth_out[begin + k] = depth_alone(keys[k])
            state_out[begin + k] = state_alone(keys[k])
            drawn += wp.where(is_empty(keys[k]), 0, 1)
    else:
        for k in range(pixels - begin):
            depth_out[begin + k] = depth_alone(keys[k])
            state_out[begin + k] = state_alone(keys[k])
            drawn += wp.where(is_empty(keys[k]), 0, 1)
    counts_out[DRAWN] = counts_out[DRAWN] + wp.int64(drawn)
