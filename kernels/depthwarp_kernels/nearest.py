"""The one minimum a point that a splat on a CPU ends in.

Written in C: of an indexed array, generated code asks each time whether the index is negative, and
it cannot fetch memory ahead.
"""

import warp as wp

from depthwarp_kernels.point_source import BLOCK

KEEP_NEAREST = """
        const uint64_t depth = reinterpret_cast<const uint32_t*>(depths.data)[k];
        const uint64_t key = depth << 32 | uint32_t(rows.data[k]);
        uint64_t& nearest = keys_out.data[cells.data[k]];
        const uint64_t before = nearest;
        nearest = key < before ? key : before;
"""


@wp.func_native(f"""
    for (int k = 0; k < {BLOCK}; ++k) {{
        {KEEP_NEAREST}
    }}
""")
def keep_nearest(
    cells: wp.array[wp.int32],
    depths: wp.array[wp.float32],
    rows: wp.array[wp.int32],
    keys_out: wp.array[wp.uint64],
):
    """Put the key of each point of a block into its cell if it is smaller than what is there."""


# Blocks in view lie apart in memory, so no processor guesses the next one: line by line, of 16
# numbers, it is fetched while this one is drawn. All lines at once would block other reads.
@wp.func_native(f"""
    for (int k = 0; k < {BLOCK}; ++k) {{
        {KEEP_NEAREST}
        if (k % 16 == 0) {{
            __builtin_prefetch(x.data + next + k);
            __builtin_prefetch(y.data + next + k);
            __builtin_prefetch(z.data + next + k);
            __builtin_prefetch(original.data + next + k);
        }}
    }}
""")
def keep_nearest_and_fetch(
    cells: wp.array[wp.int32],
    depths: wp.array[wp.float32],
    rows: wp.array[wp.int32],
    x: wp.array[wp.float32],
    y: wp.array[wp.float32],
    z: wp.array[wp.float32],
    original: wp.array[wp.int32],
    next: wp.int32,
    keys_out: wp.array[wp.uint64],
):
    """The same, and start to read the points from `next` on, which are drawn after these."""
