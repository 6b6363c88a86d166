"""Where each of many clouds begins and ends in one array of points.

Nobody has looked at the numbers before that these kernels read: whatever they are, a span lies
within the points.
"""

import warp as wp

from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

SURPLUS = wp.constant(1)
"""Flag of a world: more points were counted than it has room for; the rest was not drawn."""

NEGATIVE_COUNT = wp.constant(2)
"""Flag of a world: its count of points is below 0; none was drawn."""


@wp.func
def span_of(spans: wp.array[wp.vec2i], cloud: wp.int32):
    """Where a cloud begins and ends among the points; nowhere if there is no such cloud."""
    exists = cloud >= 0 and cloud < spans.shape[0]
    span = spans[wp.where(exists, cloud, 0)]
    return wp.vec2i(span[0], wp.where(exists, span[1], span[0]))


# Launch over clouds.
@wp.kernel
def spans_of_offsets(
    # In:
    offsets: wp.array[wp.int32],
    points: wp.int32,
    # Out:
    spans_out: wp.array[wp.vec2i],
):
    cloud = wp.tid()
    begin = wp.clamp(offsets[cloud], 0, points)
    spans_out[cloud] = wp.vec2i(begin, wp.clamp(offsets[cloud + 1], begin, points))


# Worlds of `stride` rows each, all of them in use. Launch over worlds.
@wp.kernel
def spans_of_rows(
    # In:
    stride: wp.int32,
    # Out:
    spans_out: wp.array[wp.vec2i],
):
    world = wp.tid()
    spans_out[world] = wp.vec2i(world * stride, world * stride + stride)


# Flags stay until somebody has read them, and so does the largest surplus.
@wp.func
def note_count(
    world: wp.int32,
    count: wp.int32,
    room: wp.int32,
    flags: wp.array[wp.int32],
    surplus: wp.array[wp.int32],
):
    """Note a count of points that is negative or beyond the room for them."""
    if count < 0:
        flags[world] = flags[world] | NEGATIVE_COUNT
    if count > room:
        flags[world] = flags[world] | SURPLUS
        surplus[world] = wp.max(surplus[world], count - room)


# Worlds of `stride` rows each, the first `counts` of them in use. Launch over worlds.
@wp.kernel
def spans_of_worlds(
    # In:
    counts: wp.array[wp.int32],
    stride: wp.int32,
    # Out:
    spans_out: wp.array[wp.vec2i],
    flags_out: wp.array[wp.int32],
    surplus_out: wp.array[wp.int32],
):
    world = wp.tid()
    count = counts[world]
    note_count(world, count, stride, flags_out, surplus_out)
    spans_out[world] = wp.vec2i(world * stride, world * stride + wp.clamp(count, 0, stride))


# Worlds one behind the other. A thread has some worlds in a row, and counts itself what stands
# before them. Launch over threads.
@wp.kernel
def spans_of_counts(
    # In:
    counts: wp.array[wp.int32],
    points: wp.int32,
    most: wp.int32,
    worlds_a_thread: wp.int32,
    # Out:
    spans_out: wp.array[wp.vec2i],
    flags_out: wp.array[wp.int32],
    surplus_out: wp.array[wp.int32],
):
    first = wp.tid() * worlds_a_thread
    begin = wp.int64(0)
    for world in range(wp.min(first, counts.shape[0])):
        begin += wp.int64(wp.max(counts[world], 0))
    for world in range(first, wp.min(first + worlds_a_thread, counts.shape[0])):
        count = counts[world]
        start = wp.int32(wp.min(begin, wp.int64(points)))
        room = wp.min(most, points - start)
        note_count(world, count, room, flags_out, surplus_out)
        spans_out[world] = wp.vec2i(start, start + wp.clamp(count, 0, room))
        begin += wp.int64(wp.max(count, 0))
