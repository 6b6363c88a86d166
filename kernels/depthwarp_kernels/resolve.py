"""What a key of a Z-buffer says: depth, index and state."""

import warp as wp

from depthwarp_kernels.options import EXACT
from depthwarp_kernels.splat import EMPTY_KEY

wp.set_module_options(EXACT)

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
