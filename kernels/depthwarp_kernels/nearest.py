"""The one minimum a point that a splat on a CPU ends in.

Written in C: of an indexed array, generated code asks each time whether the index is negative, and
it cannot fetch memory ahead. A key is as in `splat`, with the row of the point or the depth alone.
"""

from functools import cache

import warp as wp

from depthwarp_kernels.packed_points import PACKED
from depthwarp_kernels.point_source import BLOCK
from depthwarp_kernels.splat import SplatConfig


# Blocks in view lie apart in memory, so no processor guesses the next one: line by line, of 16
# numbers, it is fetched while this one is drawn. All lines at once would block other reads.
def loop_over_block(key_type: str, key: str, **fetched: str):
    """Loop that puts the key of each point of a block into its cell if it is the smaller one.

    `fetched`: arrays, and where in each of them the next block begins.
    """
    fetch = "".join(
        f"__builtin_prefetch({array}.data + {begin} + k);" for array, begin in fetched.items()
    )
    return f"""
        for (int k = 0; k < {BLOCK}; k += 3) {{
            __builtin_prefetch(keys_out.data + cells.data[k], 1);
        }}
        for (int k = 0; k < {BLOCK}; ++k) {{
            const uint32_t depth = reinterpret_cast<const uint32_t*>(depths.data)[k];
            const {key_type} key = {key};
            {key_type}& nearest = keys_out.data[cells.data[k]];
            const {key_type} before = nearest;
            nearest = key < before ? key : before;
            if (k % 16 == 0) {{ {fetch} }}
        }}
    """


@wp.func_native(loop_over_block("uint64_t", "uint64_t(depth) << 32 | uint32_t(begin + k)"))
def keep_nearest(
    cells: wp.array[wp.int32],
    depths: wp.array[wp.float32],
    begin: wp.int32,
    keys_out: wp.array[wp.uint64],
):
    """Points of a plain cloud from row `begin` on."""


@wp.func_native(loop_over_block("uint32_t", "depth"))
def keep_nearest_depth(
    cells: wp.array[wp.int32], depths: wp.array[wp.float32], keys_out: wp.array[wp.uint32]
):
    """Points of a plain cloud, their depths alone."""


@wp.func_native(
    loop_over_block(
        "uint64_t",
        "uint64_t(depth) << 32 | uint32_t(original.data[begin + k])",
        x="next",
        y="next",
        z="next",
        original="next",
    )
)
def keep_nearest_of_block(
    cells: wp.array[wp.int32],
    depths: wp.array[wp.float32],
    x: wp.array[wp.float32],
    y: wp.array[wp.float32],
    z: wp.array[wp.float32],
    original: wp.array[wp.int32],
    begin: wp.int32,
    next: wp.int32,
    keys_out: wp.array[wp.uint64],
):
    """Points of a prepared cloud from `begin` on, while those from `next` on are fetched."""


@wp.func_native(
    loop_over_block(
        "uint64_t",
        "uint64_t(depth) << 32 | uint32_t(original.data[begin + k])",
        first="next",
        second="next_second",
        original="next",
    )
)
def keep_nearest_of_packed(
    cells: wp.array[wp.int32],
    depths: wp.array[wp.float32],
    first: wp.array[wp.uint32],
    second: wp.array[wp.uint32],
    original: wp.array[wp.int32],
    begin: wp.int32,
    next: wp.int32,
    next_second: wp.int32,
    keys_out: wp.array[wp.uint64],
):
    """Points of a packed cloud, while the next words of its first two planes are fetched."""


@wp.func_native(loop_over_block("uint32_t", "depth", first="next", second="next_second"))
def keep_nearest_depth_of_packed(
    cells: wp.array[wp.int32],
    depths: wp.array[wp.float32],
    first: wp.array[wp.uint32],
    second: wp.array[wp.uint32],
    next: wp.int32,
    next_second: wp.int32,
    keys_out: wp.array[wp.uint32],
):
    """The same, their depths alone."""


@wp.func_native(loop_over_block("uint32_t", "depth", x="next", y="next", z="next"))
def keep_nearest_depth_of_block(
    cells: wp.array[wp.int32],
    depths: wp.array[wp.float32],
    x: wp.array[wp.float32],
    y: wp.array[wp.float32],
    z: wp.array[wp.float32],
    next: wp.int32,
    keys_out: wp.array[wp.uint32],
):
    """The same, their depths alone."""


@cache
def keep_function(config: SplatConfig):
    """The function that keeps the nearest of a block's points in each cell, one of the above."""
    is_prepared = config.source.sphere_of is not None
    is_packed = config.source is PACKED
    with_index = config.with_index
    Word = wp.uint32 if is_packed else wp.float32
    Key = config.key_type

    @wp.func
    def keep(
        cells: wp.array[wp.int32],
        depths: wp.array[wp.float32],
        x: wp.array[Word],
        y: wp.array[Word],
        z: wp.array[Word],
        original: wp.array[wp.int32],
        begin: wp.int32,
        next: wp.int32,
        next_second: wp.int32,
        keys_out: wp.array[Key],
    ):
        """Keep the nearest point of each cell."""
        if wp.static(is_packed and with_index):
            keep_nearest_of_packed(
                cells, depths, x, y, original, begin, next, next_second, keys_out
            )
        elif wp.static(is_packed):
            keep_nearest_depth_of_packed(cells, depths, x, y, next, next_second, keys_out)
        elif wp.static(is_prepared and with_index):
            keep_nearest_of_block(cells, depths, x, y, z, original, begin, next, keys_out)
        elif wp.static(is_prepared):
            keep_nearest_depth_of_block(cells, depths, x, y, z, next, keys_out)
        elif wp.static(with_index):
            keep_nearest(cells, depths, begin, keys_out)
        else:
            keep_nearest_depth(cells, depths, keys_out)

    return keep
