"""Points of a prepared cloud in 4, 8 or 12 bytes: whole numbers of steps from a block's corner.

A block has one to three planes of 4-byte words, as few as hold its points well enough: one plane
holds 10 bits an axis, two hold 21, three the coordinates themselves, one axis each.
Source: Schuetz, Kerbl, Wimmer 2022, whose planes of a point these are.
"""

import warp as wp

from depthwarp_kernels.point_source import BLOCK, PointSource

SHORT_BITS = wp.constant(10)
LONG_BITS = wp.constant(21)
HIGH_SHIFT = wp.constant(32 - 21)  # bits of z beside x in the first word


# low: the corner [m]; step [m] an axis. Every block has a place of its own in the first plane;
# `second` and `third` are its places in the other two, in blocks, where it has that many planes.
@wp.struct
class PackedBlock:
    low: wp.vec3f
    step: wp.vec3f
    planes: wp.int32
    second: wp.int32
    third: wp.int32


@wp.struct
class PackedPoints:
    first: wp.array[wp.uint32]
    second: wp.array[wp.uint32]
    third: wp.array[wp.uint32]
    boxes: wp.array[PackedBlock]
    original: wp.array[wp.int32]
    spheres: wp.array[wp.vec4f]
    groups: wp.array[wp.vec4f]


# One rounding a product, one a sum, on every device: what is drawn is what was checked.
@wp.func
def decode(low: wp.vec3f, step: wp.vec3f, steps: wp.vec3f):
    """The point [m] so many steps from the corner of a block."""
    return wp.vec3f(
        low[0] + steps[0] * step[0], low[1] + steps[1] * step[1], low[2] + steps[2] * step[2]
    )


# By way of signed numbers: few processors make floats of several unsigned ones at once.
@wp.func
def bits_of(word: wp.uint32, shift: wp.int32, bits: wp.int32):
    """So many bits of a word from a shift on, as a float."""
    return wp.float32(wp.int32(word >> wp.uint32(shift)) & ((1 << bits) - 1))


@wp.func
def pack_short(steps: wp.vec3f):
    """Steps of 10 bits in one word."""
    x, y, z = wp.int32(steps[0]), wp.int32(steps[1]), wp.int32(steps[2])
    return wp.uint32(x | (y << SHORT_BITS) | (z << 2 * SHORT_BITS))


@wp.func
def unpack_short(word: wp.uint32):
    """Steps of 10 bits from one word."""
    return wp.vec3f(
        bits_of(word, 0, SHORT_BITS),
        bits_of(word, SHORT_BITS, SHORT_BITS),
        bits_of(word, 2 * SHORT_BITS, SHORT_BITS),
    )


# x and the low 11 bits of z; y and the high 10 bits of z.
@wp.func
def pack_long(steps: wp.vec3f):
    """Steps of 21 bits in two words."""
    x, y, z = wp.int32(steps[0]), wp.int32(steps[1]), wp.int32(steps[2])
    first = wp.uint32(x) | (wp.uint32(z) << wp.uint32(LONG_BITS))
    second = wp.uint32(y) | (wp.uint32(z >> HIGH_SHIFT) << wp.uint32(LONG_BITS))
    return first, second


@wp.func
def unpack_long(first: wp.uint32, second: wp.uint32):
    """Steps of 21 bits from two words."""
    low_z = first >> wp.uint32(LONG_BITS)
    high_z = (second >> wp.uint32(LONG_BITS)) << wp.uint32(HIGH_SHIFT)
    return wp.vec3f(
        bits_of(first, 0, LONG_BITS),
        bits_of(second, 0, LONG_BITS),
        wp.float32(wp.int32(low_z | high_z)),
    )


@wp.func
def packed_point(source: PackedPoints, i: wp.int32):
    """A point of a packed cloud."""
    box = source.boxes[i / wp.static(BLOCK)]
    k = i % wp.static(BLOCK)
    first = source.first[i]
    if box.planes == 1:
        return decode(box.low, box.step, unpack_short(first))
    second = source.second[box.second * wp.static(BLOCK) + k]
    if box.planes == 2:
        return decode(box.low, box.step, unpack_long(first, second))
    third = source.third[box.third * wp.static(BLOCK) + k]
    return wp.vec3f(
        wp.cast(first, wp.float32), wp.cast(second, wp.float32), wp.cast(third, wp.float32)
    )


@wp.func
def packed_index(source: PackedPoints, i: wp.int32):
    """Its row in the caller's cloud."""
    return source.original[i]


@wp.func
def packed_sphere(source: PackedPoints, block: wp.int32):
    """The sphere round a block."""
    return source.spheres[block]


@wp.func
def packed_group(source: PackedPoints, group: wp.int32):
    """The sphere round a group of blocks."""
    return source.groups[group]


PACKED = PointSource(PackedPoints, packed_point, packed_index, packed_sphere, packed_group)
