"""The splat for CUDA: threads that stay, chunks of points that they take in turn, few atomics.

A chunk is a block of a cloud. Neighbouring threads, its lanes, take it together, some points each:
all coordinates first, then all keys of before, so that many reads are on their way at a time. What
becomes of the points is counted in registers and added up once a warp. Same bits and counts as
`splat`, on a CPU too, where a warp is one thread.
"""

from functools import cache

import warp as wp

from depthwarp_kernels.lens import place_still
from depthwarp_kernels.options import EXACT
from depthwarp_kernels.point_source import (
    ALL_BEHIND,
    ALL_OUTSIDE,
    BLOCK,
    PREPARED,
    PreparedPoints,
)
from depthwarp_kernels.resolve import (
    depth_alone,
    depth_of_key,
    index_of_key,
    is_empty,
    state_alone,
    state_of_key,
)
from depthwarp_kernels.splat import (
    BEHIND,
    DRAWN,
    EMPTY_KEY,
    NOT_FINITE,
    OUTSIDE,
    TOO_FAR,
    TOO_NEAR,
    SplatConfig,
    depth_key,
    pack_key,
    reason_function,
    verdict_function,
)
from depthwarp_kernels.view import View, pixel_of

wp.set_module_options(EXACT)

WARP = 32
"""Threads of a warp. Launches are whole warps in each view, and a warp stays together."""

PIXELS = 4
"""Pixels of a thread when keys are resolved."""


def points_of_lane(config: SplatConfig):
    """Points that a thread takes at a time; `BLOCK` over it is the number of lanes of a chunk.

    Four are 16 bytes of each coordinate. A lens that finds the pose for each point needs all of a
    thread's registers for one.
    """
    return 4 if config.lens.place is place_still else 1


# On a CPU a thread is a warp of its own.
WARP_SUM = f"""
#if defined(__CUDA_ARCH__)
    int sum = number;
    for (int step = {WARP // 2}; step > 0; step /= 2)
        sum += __shfl_down_sync(0xffffffffu, sum, step);
    return threadIdx.x % {WARP} == 0 ? sum : 0;
#else
    return number;
#endif
"""


@wp.func_native(WARP_SUM)
def warp_sum(number: wp.int32) -> wp.int32:
    """The sum over a warp for its first thread, 0 for the others. All of them have to call it."""
    ...


WARP_PLACE = f"""
#if defined(__CUDA_ARCH__)
    const unsigned wanting = __ballot_sync(0xffffffffu, wanted);
    const int lane = threadIdx.x % {WARP};
    int first = 0;
    if (lane == 0 && wanting != 0)
        first = atomicAdd(lengths_out.data + row, __popc(wanting));
    first = __shfl_sync(0xffffffffu, first, 0);
    return first + __popc(wanting & ((1u << lane) - 1));
#else
    const int place = lengths_out.data[row];
    lengths_out.data[row] += wanted;
    return place;
#endif
"""


@wp.func_native(WARP_PLACE)
def place_in_list(lengths_out: wp.array[wp.int32], row: wp.int32, wanted: wp.int32) -> wp.int32:
    """A place in list `row` for each thread that wants one (1, else 0); one atomic a warp."""
    ...


# Warp reads a vector number by number; CUDA has one instruction for 16 bytes on their boundary.
FOUR_NUMBERS = """
#if defined(__CUDA_ARCH__)
    const float4 four = *reinterpret_cast<const float4*>(numbers.data + first);
    return wp::vec_t<4, wp::float32>(four.x, four.y, four.z, four.w);
#else
    const wp::float32* four = numbers.data + first;
    return wp::vec_t<4, wp::float32>(four[0], four[1], four[2], four[3]);
#endif
"""


@wp.func_native(FOUR_NUMBERS)
def four_numbers(numbers: wp.array[wp.float32], first: wp.int32) -> wp.vec4f:
    """Four neighbouring numbers, the first at a whole multiple of four."""
    ...


@wp.func
def add_count(counts: wp.array2d[wp.int64], view: wp.int32, reason: wp.int32, number: wp.int32):
    """Add the numbers of a warp to a count of a view."""
    total = warp_sum(number)
    if total > 0:
        wp.atomic_add(counts, view, reason, wp.int64(total))


@cache
def reader_functions(config: SplatConfig):
    """How a lane reads its points of a chunk: (place_at, points_at).

    Of a prepared cloud a lane reads neighbouring points, of a plain one, whose start may lie
    anywhere, the lanes do.
    """
    point_at = config.source.point_at
    Source = config.source.struct
    size = points_of_lane(config)
    lanes = BLOCK // size
    Points = wp.types.matrix(shape=(size, 3), dtype=wp.float32)

    @wp.func
    def place_apart(chunk: wp.int32, lane: wp.int32, k: wp.int32):
        """Point `k` of a lane, with the neighbouring point in the next lane."""
        return chunk * wp.static(BLOCK) + k * wp.static(lanes) + lane

    @wp.func
    def points_apart(source: Source, chunk: wp.int32, lane: wp.int32, count: wp.int32):
        """The points of a lane; behind the last one of the cloud, that one."""
        points = Points()
        for k in range(wp.static(size)):
            point = point_at(source, wp.min(place_apart(chunk, lane, k), count - 1))
            points[k, 0] = point[0]
            points[k, 1] = point[1]
            points[k, 2] = point[2]
        return points

    @wp.func
    def place_adjoining(chunk: wp.int32, lane: wp.int32, k: wp.int32):
        """Point `k` of a lane, with the neighbouring point in the same lane."""
        return chunk * wp.static(BLOCK) + lane * wp.static(size) + k

    @wp.func
    def points_adjoining(source: PreparedPoints, chunk: wp.int32, lane: wp.int32, count: wp.int32):
        """The four points of a lane; the last block is filled up to its end."""
        first = place_adjoining(chunk, lane, 0)
        x = four_numbers(source.x, first)
        y = four_numbers(source.y, first)
        z = four_numbers(source.z, first)
        points = Points()
        for k in range(wp.static(size)):
            points[k, 0] = x[k]
            points[k, 1] = y[k]
            points[k, 2] = z[k]
        return points

    if config.source is PREPARED and size == 4:
        return place_adjoining, points_adjoining
    return place_apart, points_apart


@cache
def list_kernel(config: SplatConfig):
    """Kernel that lists the chunks each view may see and counts the points of the others.

    Launch over (views from `first_view` on, `chunks` rounded up to whole warps). The chunks are
    those from `first` on. Of `listed_out`, `chunks` places a view are filled from their start, in
    no fixed order; `lengths_out` comes as zeros.
    """
    Source = config.source.struct
    sphere_of = config.source.sphere_of
    verdict_of = verdict_function(config)

    @wp.kernel(module="unique", module_options=EXACT, enable_backward=False)
    def list_chunks(
        # In:
        views: wp.array[View],
        source: Source,
        first_view: wp.int32,
        first: wp.int32,
        chunks: wp.int32,
        count: wp.int32,
        # Out:
        listed_out: wp.array[wp.int32],
        lengths_out: wp.array[wp.int32],
        counts_out: wp.array2d[wp.int64],
    ):
        row, i = wp.tid()
        v = first_view + row
        chunk = first + wp.min(i, chunks - 1)
        verdict = verdict_of(views[v], sphere_of(source, chunk))
        held = wp.min(wp.static(BLOCK), count - chunk * wp.static(BLOCK))
        held = wp.where(i < chunks, held, 0)
        behind = wp.where(verdict == ALL_BEHIND, held, 0)
        outside = wp.where(verdict == ALL_OUTSIDE, held, 0)
        wanted = wp.where(held > behind + outside, 1, 0)
        place = place_in_list(lengths_out, row, wanted)
        if wanted == 1:
            listed_out[row * chunks + place] = chunk
        add_count(counts_out, v, BEHIND, behind)
        add_count(counts_out, v, OUTSIDE, outside)

    return list_chunks


@cache
def chunk_kernel(config: SplatConfig):
    """Kernel that draws chunks into the keys of views.

    Launch over (views from `first_view` on, groups * lanes). Group g of a view takes chunks g,
    g + groups and so on: of a prepared cloud those in the view's list, of a plain one all `chunks`.
    """
    depth_of = config.depth_of
    is_prepared = config.source.sphere_of is not None
    size = points_of_lane(config)
    lanes = BLOCK // size
    Cells = wp.types.vector(length=size, dtype=wp.int32)
    Key = config.key_type
    with_index = config.with_index
    Keys = wp.types.vector(length=size, dtype=Key)
    Lens, Source = config.lens.struct, config.source.struct
    place, project = config.lens.place, config.lens.project
    index_at = config.source.index_at
    reason_of = reason_function(config)
    place_at, points_at = reader_functions(config)

    @wp.kernel(module="unique", module_options=EXACT, enable_backward=False)
    def splat_chunks(
        # In:
        views: wp.array[View],
        lenses: wp.array[Lens],
        tables: wp.array[wp.float32],
        source: Source,
        listed: wp.array[wp.int32],
        lengths: wp.array[wp.int32],
        first_view: wp.int32,
        chunks: wp.int32,
        count: wp.int32,
        groups: wp.int32,
        # Out:
        keys_out: wp.array2d[Key],
        counts_out: wp.array2d[wp.int64],
    ):
        row, t = wp.tid()
        group = t / wp.static(lanes)
        lane = t % wp.static(lanes)
        v = first_view + row
        view = views[v]
        lens = lenses[v]
        end = chunks
        if wp.static(is_prepared):
            end = lengths[row]
        not_finite = int(0)
        behind = int(0)
        outside = int(0)
        too_far = int(0)
        too_near = int(0)
        for n in range(group, end, groups):
            chunk = n
            if wp.static(is_prepared):
                chunk = listed[row * chunks + n]
            points = points_at(source, chunk, lane, count)
            cells = Cells()
            keys = Keys()
            for k in range(wp.static(size)):
                point = wp.vec3f(points[k, 0], points[k, 1], points[k, 2])
                p = place(view, lens, tables, point)
                pixel = pixel_of(project(lens, tables, p))
                depth = depth_of(lens, p)
                why = reason_of(view, p, pixel, depth)
                held = wp.where(place_at(chunk, lane, k) < count, 1, 0)
                not_finite += wp.where(why == NOT_FINITE, held, 0)
                behind += wp.where(why == BEHIND, held, 0)
                outside += wp.where(why == OUTSIDE, held, 0)
                too_far += wp.where(why == TOO_FAR, held, 0)
                too_near += wp.where(why == TOO_NEAR, held, 0)
                is_drawn = why == DRAWN and held == 1
                cell = wp.int32(pixel[1]) * view.width + wp.int32(pixel[0])
                cells[k] = wp.where(is_drawn, cell, -1)
                if wp.static(with_index):
                    keys[k] = pack_key(depth, 0)
                else:
                    keys[k] = depth_key(depth)
            befores = Keys()
            for k in range(wp.static(size)):
                if cells[k] >= 0:
                    befores[k] = keys_out[v, cells[k]]
            # With index 0 a key is the least of its depth: the index is read where it can matter.
            for k in range(wp.static(size)):
                if keys[k] < befores[k]:
                    key = keys[k]
                    if wp.static(with_index):
                        key = key | wp.uint64(index_at(source, place_at(chunk, lane, k)))
                    # A key only ever falls, so a stale read costs an atomic but never a point.
                    if key < befores[k]:
                        wp.atomic_min(keys_out, v, cells[k], key)
        add_count(counts_out, v, NOT_FINITE, not_finite)
        add_count(counts_out, v, BEHIND, behind)
        add_count(counts_out, v, OUTSIDE, outside)
        add_count(counts_out, v, TOO_FAR, too_far)
        add_count(counts_out, v, TOO_NEAR, too_near)

    return splat_chunks


# Launch over (views, pixels over PIXELS, rounded up to whole warps).
@wp.kernel
def resolve_lanes(
    # In:
    keys: wp.array2d[wp.uint64],
    pixels: wp.int32,
    # Out:
    depth_out: wp.array2d[wp.float32],
    index_out: wp.array2d[wp.int32],
    state_out: wp.array2d[wp.uint8],
    counts_out: wp.array2d[wp.int64],
):
    v, t = wp.tid()
    first = (t / WARP) * wp.static(WARP * PIXELS) + t % WARP
    drawn = int(0)
    for k in range(wp.static(PIXELS)):
        cell = first + k * WARP
        if cell < pixels:
            key = keys[v, cell]
            depth_out[v, cell] = depth_of_key(key)
            index_out[v, cell] = index_of_key(key)
            state_out[v, cell] = state_of_key(key)
            drawn += wp.where(key == wp.uint64(EMPTY_KEY), 0, 1)
    add_count(counts_out, v, DRAWN, drawn)


# The same of keys that are depths alone.
@wp.kernel
def resolve_depth_lanes(
    # In:
    keys: wp.array2d[wp.uint32],
    pixels: wp.int32,
    # Out:
    depth_out: wp.array2d[wp.float32],
    state_out: wp.array2d[wp.uint8],
    counts_out: wp.array2d[wp.int64],
):
    v, t = wp.tid()
    first = (t / WARP) * wp.static(WARP * PIXELS) + t % WARP
    drawn = int(0)
    for k in range(wp.static(PIXELS)):
        cell = first + k * WARP
        if cell < pixels:
            key = keys[v, cell]
            depth_out[v, cell] = depth_alone(key)
            state_out[v, cell] = state_alone(key)
            drawn += wp.where(is_empty(key), 0, 1)
    add_count(counts_out, v, DRAWN, drawn)
