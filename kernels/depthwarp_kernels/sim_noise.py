"""What a depth sensor makes of true depths: noise, steps, dropouts, flying pixels.

A pixel's random numbers are four words of Philox4x32-10 (Salmon, Moraes, Dror, Shaw 2011, "Parallel
random numbers: as easy as 1, 2, 3"): the key is the seed, the counter is (pixel, camera, world,
step). Nothing else enters, and all of it is integers, + - * / and sqrt, so every device and every
sharing of the rows gives the same bits.
"""

import warp as wp

from depthwarp_kernels.filters_layers import LARGEST_DEPTH, column_in_image, is_present
from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

MULTIPLIER_0 = wp.constant(wp.uint64(0xD2511F53))
MULTIPLIER_1 = wp.constant(wp.uint64(0xCD9E8D57))
KEY_STEP_0 = wp.constant(wp.uint32(0x9E3779B9))
KEY_STEP_1 = wp.constant(wp.uint32(0xBB67AE85))

LN_2 = wp.constant(wp.float32(0.693147180559945))
SQRT_2 = wp.constant(wp.float32(1.41421356237310))
HALF_PI = wp.constant(wp.float32(1.57079632679490))
LN_3 = wp.constant(wp.float32(1.0 / 3.0))
LN_5 = wp.constant(wp.float32(1.0 / 5.0))
LN_7 = wp.constant(wp.float32(1.0 / 7.0))
LN_9 = wp.constant(wp.float32(1.0 / 9.0))
SIN_3 = wp.constant(wp.float32(-1.0 / 6.0))
SIN_5 = wp.constant(wp.float32(1.0 / 120.0))
SIN_7 = wp.constant(wp.float32(-1.0 / 5040.0))
COS_2 = wp.constant(wp.float32(-1.0 / 2.0))
COS_4 = wp.constant(wp.float32(1.0 / 24.0))
COS_6 = wp.constant(wp.float32(-1.0 / 720.0))
COS_8 = wp.constant(wp.float32(1.0 / 40320.0))

STATE_EMPTY = wp.constant(wp.uint8(0))


@wp.struct
class NoiseModel:
    """The sensor: numbers of `SensorNoise`; 0 turns each off, `grazing_cosine` included."""

    min_range: wp.float32
    disparity_noise: wp.float32
    disparity_step: wp.float32
    depth_step: wp.float32
    grazing_cosine: wp.float32
    flying_share: wp.float32
    flying_jump: wp.float32
    seed_low: wp.uint32
    seed_high: wp.uint32
    cameras: wp.int32


@wp.func
def philox(
    c0: wp.uint32, c1: wp.uint32, c2: wp.uint32, c3: wp.uint32, key_0: wp.uint32, key_1: wp.uint32
):
    """Four random words of a counter and a key: Philox4x32-10."""
    for _round in range(10):
        product_0 = MULTIPLIER_0 * wp.uint64(c0)
        product_1 = MULTIPLIER_1 * wp.uint64(c2)
        c0 = wp.uint32(product_1 >> wp.uint64(32)) ^ c1 ^ key_0
        c1 = wp.uint32(product_1)
        c2 = wp.uint32(product_0 >> wp.uint64(32)) ^ c3 ^ key_1
        c3 = wp.uint32(product_0)
        key_0 += KEY_STEP_0
        key_1 += KEY_STEP_1
    return wp.vec4ui(c0, c1, c2, c3)


@wp.func
def uniform(word: wp.uint32):
    """One of the 2^24 floats k / 2^24, from 0 to below 1."""
    return wp.float32(word >> wp.uint32(8)) * 5.9604644775390625e-08


@wp.func
def log_of(x: wp.float32):
    """Natural logarithm of a normal number 2^e m > 0: ln m = 2 artanh((m - 1) / (m + 1))."""
    bits = wp.cast(x, wp.uint32)
    exponent = wp.int32(bits >> wp.uint32(23)) - 127
    mantissa = wp.cast((bits & wp.uint32(0x7FFFFF)) | wp.uint32(0x3F800000), wp.float32)
    high = mantissa > SQRT_2
    mantissa = wp.where(high, 0.5 * mantissa, mantissa)
    exponent = wp.where(high, exponent + 1, exponent)
    s = (mantissa - 1.0) / (mantissa + 1.0)
    q = s * s
    series = 1.0 + q * (LN_3 + q * (LN_5 + q * (LN_7 + q * LN_9)))
    return wp.float32(exponent) * LN_2 + 2.0 * s * series


# The words give a radius and a direction (Box, Muller 1958); the radius uses all 32 bits of its
# word, so values reach 6.66 standard deviations. The direction's upper two bits are the quarter of
# the turn, the rest the place in it, from -45 to 45 degrees.
@wp.func
def normal(radius_word: wp.uint32, turn_word: wp.uint32):
    """A number of the standard normal distribution, at most 6.66 from 0."""
    # An odd word is never 0; 2^-32 of it is rounded to at most 1.
    radius = wp.sqrt(-2.0 * log_of(wp.float32(radius_word | wp.uint32(1)) * 2.3283064365386963e-10))
    x = HALF_PI * (uniform(turn_word << wp.uint32(2)) - 0.5)
    q = x * x
    sine = x * (1.0 + q * (SIN_3 + q * (SIN_5 + q * SIN_7)))
    cosine = 1.0 + q * (COS_2 + q * (COS_4 + q * (COS_6 + q * COS_8)))
    quarter = turn_word >> wp.uint32(30)
    part = wp.where((quarter & wp.uint32(1)) == wp.uint32(0), cosine, sine)
    return radius * wp.where(quarter < wp.uint32(2), part, -part)


@wp.func
def sample_at(
    before: wp.array3d[wp.float32],
    origins: wp.array3d[wp.vec3f],
    directions: wp.array3d[wp.vec3f],
    wraps: wp.int32,
    v: wp.int32,
    slot: wp.int32,
    row: wp.int32,
    column: wp.int32,
):
    """Point that a pixel sees, in the camera frame, and its depth: 0 if empty or no pixel."""
    c = column_in_image(column, before.shape[2], wraps)
    sample = wp.vec4f()
    if c >= 0 and row >= 0 and row < before.shape[1]:
        depth = before[v, row, c]
        if depth > 0.0:
            p = origins[slot, row, c] + directions[slot, row, c] * depth
            sample = wp.vec4f(p[0], p[1], p[2], depth)
    return sample


@wp.func
def way(a: wp.vec4f, b: wp.vec4f):
    """The vector from one sample's point to another's."""
    return wp.vec3f(b[0] - a[0], b[1] - a[1], b[2] - a[2])


@wp.func
def tangent(own: wp.vec4f, a: wp.vec4f, b: wp.vec4f):
    """A vector on the surface: to that neighbour on the axis whose depth is nearer to one's own."""
    use_a = a[3] > 0.0 and (b[3] == 0.0 or wp.abs(a[3] - own[3]) <= wp.abs(b[3] - own[3]))
    vector = wp.vec3f()
    if use_a:
        vector = way(own, a)
    elif b[3] > 0.0:
        vector = way(own, b)
    return vector


@wp.func
def grazing_share(
    before: wp.array3d[wp.float32],
    origins: wp.array3d[wp.vec3f],
    directions: wp.array3d[wp.vec3f],
    wraps: wp.int32,
    v: wp.int32,
    slot: wp.int32,
    row: wp.int32,
    column: wp.int32,
    grazing_cosine: wp.float32,
):
    """Probability of a dropout: 1 - cos(incidence) / cos(grazing angle); without a normal 0."""
    own = sample_at(before, origins, directions, wraps, v, slot, row, column)
    left = sample_at(before, origins, directions, wraps, v, slot, row, column - 1)
    right = sample_at(before, origins, directions, wraps, v, slot, row, column + 1)
    up = sample_at(before, origins, directions, wraps, v, slot, row - 1, column)
    down = sample_at(before, origins, directions, wraps, v, slot, row + 1, column)
    across = wp.cross(tangent(own, left, right), tangent(own, up, down))
    ray = directions[slot, row, column]
    square = wp.dot(across, across) * wp.dot(ray, ray)
    share = float(0.0)
    if square > 0.0:
        share = 1.0 - wp.abs(wp.dot(across, ray)) / (wp.sqrt(square) * grazing_cosine)
    return share


@wp.func
def in_line(a: wp.vec4f, b: wp.vec4f, c: wp.vec4f, within: wp.float32):
    """Whether depth goes on in one direction from a over b to c, and c is near the line a b."""
    line = way(a, b)
    off = wp.cross(line, way(b, c))
    near = wp.dot(off, off) <= within * within * wp.dot(line, line)
    return a[3] > 0.0 and (b[3] - a[3]) * (c[3] - b[3]) > 0.0 and near


# A slope is no edge: there either side goes on to the other's point in a line.
@wp.func
def jump_across_edge(
    before: wp.array3d[wp.float32],
    origins: wp.array3d[wp.vec3f],
    directions: wp.array3d[wp.vec3f],
    wraps: wp.int32,
    v: wp.int32,
    slot: wp.int32,
    row: wp.int32,
    column: wp.int32,
    flying_jump: wp.float32,
):
    """The largest difference of depth to a neighbour across an edge, the first of equal ones."""
    own = sample_at(before, origins, directions, wraps, v, slot, row, column)
    jump = float(0.0)
    for k in range(4):
        # Left, right, up, down.
        y = wp.where(k < 2, 0, 2 * k - 5)
        x = wp.where(k < 2, 2 * k - 1, 0)
        other = sample_at(before, origins, directions, wraps, v, slot, row + y, column + x)
        step = other[3] - own[3]
        if other[3] > 0.0 and wp.abs(step) > wp.max(flying_jump, wp.abs(jump)):
            opposite = sample_at(before, origins, directions, wraps, v, slot, row - y, column - x)
            beyond = sample_at(
                before, origins, directions, wraps, v, slot, row + 2 * y, column + 2 * x
            )
            slope = in_line(opposite, own, other, flying_jump)
            slope = slope or in_line(beyond, other, own, flying_jump)
            jump = wp.where(slope, jump, step)
    return jump


@wp.func
def in_steps(depth: wp.float32, disparity_step: wp.float32, depth_step: wp.float32):
    """The nearest depth that the sensor can say; 0 if its disparity or depth is nearest to 0."""
    if disparity_step > 0.0 and depth > 0.0:
        level = wp.floor(1.0 / (depth * disparity_step) + 0.5)
        depth = wp.where(level > 0.0, 1.0 / (level * disparity_step), 0.0)
    if depth_step > 0.0:
        depth = wp.floor(depth / depth_step + 0.5) * depth_step
    return depth


# Neighbours are to be seen as they were, so the depths are kept first; the counter of the steps is
# raised by the one thread that has the first pixel of all.
# Launch over (rows, columns).
@wp.kernel
def begin_step(
    # In:
    first_row: wp.int32,
    depth: wp.array3d[wp.float32],
    state: wp.array3d[wp.uint8],
    # Out:
    before_out: wp.array3d[wp.float32],
    steps_out: wp.array[wp.uint32],
):
    i, column = wp.tid()
    v = (first_row + i) // depth.shape[1]
    row = (first_row + i) % depth.shape[1]
    own = depth[v, row, column]
    before_out[v, row, column] = wp.where(is_present(own, state[v, row, column]), own, 0.0)
    if first_row + i == 0 and column == 0:
        steps_out[0] = steps_out[0] + wp.uint32(1)


# `before` is what `begin_step` kept. Rays of a pixel: the point at depth z is origin + z direction;
# they are read only for dropouts and flying pixels. View v is camera v % cameras of world
# v // cameras. Launch over (rows, columns).
@wp.kernel
def add_noise(
    # In:
    first_row: wp.int32,
    before: wp.array3d[wp.float32],
    origins: wp.array3d[wp.vec3f],
    directions: wp.array3d[wp.vec3f],
    wraps: wp.array[wp.int32],
    steps: wp.array[wp.uint32],
    model: NoiseModel,
    # Out:
    depth_out: wp.array3d[wp.float32],
    index_out: wp.array3d[wp.int32],
    state_out: wp.array3d[wp.uint8],
):
    i, column = wp.tid()
    rows = before.shape[1]
    v = (first_row + i) // rows
    row = (first_row + i) % rows
    depth = before[v, row, column]
    if depth == 0.0:
        return
    slot = v % model.cameras
    words = philox(
        wp.uint32(row * before.shape[2] + column),
        wp.uint32(slot),
        wp.uint32(v // model.cameras),
        steps[0],
        model.seed_low,
        model.seed_high,
    )
    kept = depth >= model.min_range
    turn = wraps[slot]
    if model.grazing_cosine > 0.0:
        lost = grazing_share(
            before, origins, directions, turn, v, slot, row, column, model.grazing_cosine
        )
        kept = kept and uniform(words[2]) >= lost
    # Where a number is below the share, number / share is again uniform from 0 to 1.
    chance = uniform(words[3])
    if chance < model.flying_share:
        jump = jump_across_edge(
            before, origins, directions, turn, v, slot, row, column, model.flying_jump
        )
        depth += jump * (chance / model.flying_share)
    if model.disparity_noise > 0.0:
        depth += model.disparity_noise * depth * depth * normal(words[0], words[1])
    depth = in_steps(depth, model.disparity_step, model.depth_step)
    if kept and depth > 0.0 and depth >= model.min_range and depth < LARGEST_DEPTH:
        depth_out[v, row, column] = depth
    else:
        depth_out[v, row, column] = 0.0
        state_out[v, row, column] = STATE_EMPTY
        index_out[v, row, column] = -1
