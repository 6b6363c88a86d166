"""Small images on CUDA: the Z-buffer of a view lies in the shared memory of one block of threads.

The block clears its image, projects the points of its cloud, and writes the maps, all in one
launch: no keys in global memory, no atomics on it. Same bits and counts as `ragged`.
"""

from dataclasses import dataclass, replace
from functools import cache

import warp as wp

from depthwarp_kernels.lens import place_still
from depthwarp_kernels.options import EXACT
from depthwarp_kernels.ragged import LANES, TOTAL, cell_function, depth_cell_function
from depthwarp_kernels.spans import span_of
from depthwarp_kernels.splat import (
    COUNT_COLUMNS,
    DRAWN,
    EMPTY_KEY,
    SplatConfig,
    depth_key,
    pack_key,
    reason_function,
)
from depthwarp_kernels.view import View, pixel_of

STORAGE = 48 * 1024 - 4 * LANES
"""Bytes of shared memory for keys: every CUDA device gives a block 48 KiB unasked, and Warp itself
takes four bytes of it for each thread."""

MOST_PIXELS = {wp.uint64: STORAGE // 8, wp.uint32: STORAGE // 4}
"""Pixels of the largest image: with the index of the winner in the keys, and without."""

STEP = 512
"""There is room for whole multiples of so many pixels: few kernels for many sizes of images."""

# How many points are not drawn, by reason, and how many pixels are: the columns of `splat`.
Tally = wp.types.vector(length=COUNT_COLUMNS, dtype=wp.int32)


def points_of_thread(config: SplatConfig):
    """Points that a thread takes at a time.

    With two of an ideal pinhole a thread has 64 registers, so that a multiprocessor holds 1024
    threads. A lens that finds the pose for each point needs all of a thread's registers for one.
    """
    return 2 if config.lens.place is place_still else 1


@dataclass(frozen=True)
class SharedConfig:
    """What is decided at compile time.

    Attributes:
        splat: Lens and depth, and whether the keys hold the index of the winner.
        outputs: Which of the maps are written.
        cells: Pixels that there is room for.
        begins_with_keys: Whether an image begins with keys that were drawn before, or empty.
    """

    splat: SplatConfig
    outputs: frozenset[str]
    cells: int
    begins_with_keys: bool = False


def shared_config(
    splat: SplatConfig, outputs: frozenset[str], pixels: int, begins_with_keys: bool = False
):
    """The configuration for images of so many pixels; None if they are too large."""
    splat = replace(splat, with_index="index" in outputs)
    most = MOST_PIXELS[splat.key_type]
    if pixels > most:
        return None
    cells = min(-(-pixels // STEP) * STEP, most)
    return SharedConfig(splat, outputs, cells, begins_with_keys)


@wp.func_native("""
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif
""")
def wait_for_block():
    """Wait until all threads of the block are here. All of them have to call it."""


# On a CPU a block is one thread, and only one draws at a time.
STORAGE_CODE = """
#if defined(__CUDA_ARCH__)
    __shared__ {number} keys[{cells}];
#else
    static {number} keys[{cells}];
#endif
    return reinterpret_cast<uint64_t>(keys);
"""

# A key only ever falls, so a stale read can cost an atomic but never a point.
LOWER_CODE = """
    {number}& nearest = reinterpret_cast<{number}*>(keys)[cell];
    if (key < nearest)
#if defined(__CUDA_ARCH__)
        atomicMin(reinterpret_cast<{cuda_number}*>(&nearest), static_cast<{cuda_number}>(key));
#else
        nearest = key;
#endif
"""

NUMBERS = {
    wp.uint64: {"number": "uint64_t", "cuda_number": "unsigned long long"},
    wp.uint32: {"number": "uint32_t", "cuda_number": "unsigned int"},
}
"""What a key is called in C, and by CUDA's atomics."""


@cache
def storage_functions(Key: type, cells: int):
    """How the keys of a block are reached: (storage, key_at, put_key, lower_key)."""
    names = NUMBERS[Key] | {"cells": cells}
    number = names["number"]

    @wp.func_native(STORAGE_CODE.format(**names))
    def storage() -> wp.uint64:
        """Where the keys of the block are."""
        ...

    @wp.func_native(f"return reinterpret_cast<const {number}*>(keys)[cell];")
    def key_at(keys: wp.uint64, cell: wp.int32) -> Key:
        """The key of a cell."""
        ...

    @wp.func_native(f"reinterpret_cast<{number}*>(keys)[cell] = key;")
    def put_key(keys: wp.uint64, cell: wp.int32, key: Key):
        """Write the key of a cell."""

    @wp.func_native(LOWER_CODE.format(**names))
    def lower_key(keys: wp.uint64, cell: wp.int32, key: Key):
        """Put a key into a cell if it is smaller than the one there."""

    return storage, key_at, put_key, lower_key


# The keys are read by then: the first of them make room for the sums.
TALLY_CODE = f"""
#if defined(__CUDA_ARCH__)
    int* sums = reinterpret_cast<int*>(keys);
    const int t = threadIdx.x;
    __syncthreads();
    if (t < {COUNT_COLUMNS})
        sums[t] = 0;
    __syncthreads();
    for (int k = 0; k < {COUNT_COLUMNS}; ++k) {{
        int sum = tally[k];
#if __CUDA_ARCH__ >= 800
        sum = __reduce_add_sync(0xffffffffu, sum);
#else
        for (int step = 16; step > 0; step /= 2)
            sum += __shfl_down_sync(0xffffffffu, sum, step);
#endif
        if (t % 32 == 0 && sum > 0)
            atomicAdd(sums + k, sum);
    }}
    __syncthreads();
    if (t < {COUNT_COLUMNS})
        wp::index(counts_out, view, t) = sums[t];
    __syncthreads();
#else
    for (int k = 0; k < {COUNT_COLUMNS}; ++k)
        wp::index(counts_out, view, k) = tally[k];
#endif
"""


@wp.func_native(TALLY_CODE)
def write_tally(keys: wp.uint64, view: wp.int32, tally: Tally, counts_out: wp.array2d[wp.int64]):
    """Write the sums over the block; the keys are lost. All of its threads have to call it."""


@cache
def draw_function(config: SharedConfig):
    """The function that draws the points from `begin` to `end` into the keys of a block.

    A thread takes some points at a time: all coordinates first, so that many reads are on their
    way. It returns how many of its points were not drawn, and why.
    """
    splat = config.splat
    depth_of = splat.depth_of
    Lens, place, project = splat.lens.struct, splat.lens.place, splat.lens.project
    reason_of = reason_function(splat)
    lower_key = storage_functions(config.splat.key_type, config.cells)[3]
    with_index = splat.with_index
    size = points_of_thread(splat)
    Points = wp.types.matrix(shape=(size, 3), dtype=wp.float32)

    @wp.func
    def draw_points(
        view: View,
        lens: Lens,
        tables: wp.array[wp.float32],
        points_world: wp.array[wp.vec3f],
        begin: wp.int32,
        end: wp.int32,
        rank: wp.int32,
        lane: wp.int32,
        keys: wp.uint64,
    ):
        lanes = wp.block_dim()
        tally = Tally()
        for first in range(begin + lane, end, lanes * wp.static(size)):
            points = Points()
            for k in range(wp.static(size)):
                point = points_world[wp.min(first + k * lanes, end - 1)]
                points[k, 0] = point[0]
                points[k, 1] = point[1]
                points[k, 2] = point[2]
            for k in range(wp.static(size)):
                i = first + k * lanes
                p = place(view, lens, tables, wp.vec3f(points[k, 0], points[k, 1], points[k, 2]))
                pixel = pixel_of(project(lens, tables, p))
                depth = depth_of(lens, p)
                why = reason_of(view, p, pixel, depth)
                held = wp.where(i < end, 1, 0)
                for reason in range(wp.static(COUNT_COLUMNS - 1)):
                    tally[reason] += wp.where(why == reason, held, 0)
                if why == DRAWN and held == 1:
                    cell = wp.int32(pixel[1]) * view.width + wp.int32(pixel[0])
                    if wp.static(with_index):
                        lower_key(keys, cell, pack_key(depth, rank + (i - begin)))
                    else:
                        lower_key(keys, cell, depth_key(depth))
        return tally

    return draw_points


@cache
def shared_kernel(config: SharedConfig):
    """Kernel that draws a view with each block of threads; launch over (views, threads of a block).

    On a CPU with one thread a block, one launch at a time. Images have at most `cells` pixels. The
    first point of a cloud has the index `rank`. Arrays of maps that are not among the outputs are
    not written, nor is `begun` read if images begin empty.
    """
    Lens = config.splat.lens.struct
    storage, key_at, put_key, _ = storage_functions(config.splat.key_type, config.cells)
    draw_points = draw_function(config)
    with_index = config.splat.with_index
    resolve_of = cell_function if with_index else depth_cell_function
    resolve_cell = resolve_of(config.outputs)

    @wp.func
    def first_key(begun: wp.array2d[wp.uint64], v: wp.int32, cell: wp.int32):
        """What a pixel begins with."""
        if wp.static(config.begins_with_keys):
            return begun[v, cell]
        else:
            return wp.uint64(EMPTY_KEY)

    @wp.kernel(module="unique", module_options=EXACT, enable_backward=False)
    def draw_views(
        # In:
        views: wp.array[View],
        lenses: wp.array[Lens],
        tables: wp.array[wp.float32],
        points_world: wp.array[wp.vec3f],
        spans: wp.array[wp.vec2i],
        cloud_of: wp.array[wp.int32],
        rank: wp.int32,
        begun: wp.array2d[wp.uint64],
        # Out:
        depth_out: wp.array2d[wp.float32],
        index_out: wp.array2d[wp.int32],
        state_out: wp.array2d[wp.uint8],
        counts_out: wp.array2d[wp.int64],
    ):
        v, lane = wp.tid()
        view = views[v]
        pixels = view.width * view.height
        span = span_of(spans, cloud_of[v])
        keys = storage()
        for cell in range(lane, pixels, wp.block_dim()):
            key = first_key(begun, v, cell)
            if wp.static(with_index):
                put_key(keys, cell, key)
            else:
                put_key(keys, cell, wp.uint32(key >> wp.uint64(32)))
        wait_for_block()
        tally = draw_points(
            view, lenses[v], tables, points_world, span[0], span[1], rank, lane, keys
        )
        wait_for_block()
        for cell in range(lane, pixels, wp.block_dim()):
            tally[DRAWN] += resolve_cell(
                key_at(keys, cell), v, cell, depth_out, index_out, state_out
            )
        write_tally(keys, v, tally, counts_out)
        if lane == 0:
            counts_out[v, TOTAL] = wp.int64(span[1] - span[0])

    return draw_views
