"""Directions in an image as sectors of a turn, kept as bits of one word."""

import warp as wp

from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

HALF_REACH = wp.constant(63)
SIDE = wp.constant(127)
"""Sectors are in a table of offsets in half pixels: farthest one, and side of the table."""

SECTORS = 32
"""Sectors of a full turn."""


@wp.func
def sector_bit(sector_bits: wp.array[wp.uint32], right: wp.int32, down: wp.int32):
    """Sector of an offset in half pixels, as one bit of 32; none of no offset."""
    return sector_bits[(down + HALF_REACH) * SIDE + right + HALF_REACH]


@wp.func
def surrounds(sectors: wp.uint32, most_empty: wp.int32):
    """Whether sectors of 32, as bits, leave no run of more empty ones (8 to 23) round the turn."""
    empty = wp.uint64(~sectors)
    ring = empty | (empty << wp.uint64(32))
    runs = ring & (ring >> wp.uint64(1))  # bit i: 2 empty ones from i on
    runs = runs & (runs >> wp.uint64(2))  # 4
    runs = runs & (runs >> wp.uint64(4))  # 8
    last = most_empty - 7  # where the last 8 of one too many begin
    longer = runs & (runs >> wp.uint64(wp.min(last, 8))) & (runs >> wp.uint64(last))
    return (longer & wp.uint64(0xFFFFFFFF)) == wp.uint64(0)


@wp.func
def longest_empty_run(sectors: wp.uint32):
    """Length of the longest run of empty sectors round the turn, of 32."""
    empty = wp.uint64(~sectors)
    runs = empty | (empty << wp.uint64(32))
    longest = int(0)
    while longest < SECTORS and (runs & wp.uint64(0xFFFFFFFF)) != wp.uint64(0):
        runs = runs & (runs >> wp.uint64(1))  # bit i: one more empty from i on
        longest += 1
    return longest
