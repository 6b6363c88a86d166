"""A spinning LiDAR of many beams: rows are beams, columns the moments of one turn.

Seen from above it turns clockwise. `tables` holds, from `first` on: rows + 1 limits between the
beams (tangents of elevations, descending), their rows, their azimuth offsets [columns]; and, for a
sensor that moves, 12 numbers a column: rotation (row-major) and position.
"""

import warp as wp

from depthwarp_kernels.angles import angle_of
from depthwarp_kernels.lens import LensModel, nowhere
from depthwarp_kernels.view import View, to_camera

POSE_NUMBERS = 12
MOVING_STEPS = 5
STEEPEST = wp.constant(0.5)  # columns that a point moves by, at most, while the head turns by one


# fx: columns a radian. cx: column of azimuth 0 without offset. period: columns of a turn.
# origin_offset: distance of the beams' origins from the axis [m].
@wp.struct
class SpinningLens:
    fx: wp.float32
    cx: wp.float32
    period: wp.float32
    rows: wp.int32
    origin_offset: wp.float32
    first: wp.int32


@wp.func
def nearest_beam(lens: SpinningLens, tables: wp.array[wp.float32], slope: wp.float32):
    """Place of the beam nearest to a tangent of elevation, counted from above."""
    above = int(0)
    below = int(lens.rows)
    while below - above > 1:
        middle = (above + below) / 2
        if slope > tables[lens.first + middle]:
            below = middle
        else:
            above = middle
    return above


# A beam starts `origin_offset` from the axis, in the direction of the turn, and leaves it turned by
# its own azimuth offset: to the first order in that, the elevation is that of (level - offset, z).
@wp.func
def column_of(
    lens: SpinningLens,
    tables: wp.array[wp.float32],
    p: wp.vec3f,
    level: wp.float32,
    beam: wp.int32,
):
    """Column in which a beam meets a point at the distance `level` from the axis."""
    offset = tables[lens.first + 2 * lens.rows + 1 + beam]
    seen_from_axis = offset - offset * (lens.origin_offset / level)
    u = lens.cx - (lens.fx * angle_of(p[1], p[0]) - seen_from_axis)
    if u < -0.5:
        u += lens.period
    if u + 0.5 >= lens.period:
        u -= lens.period
    return u


@wp.func
def project_spinning(lens: SpinningLens, tables: wp.array[wp.float32], p: wp.vec3f):
    """Column and row of a point in the frame of the sensor; nowhere above or below all beams."""
    level = wp.sqrt(p[0] * p[0] + p[1] * p[1])
    way = level - lens.origin_offset
    if not (way > 0.0):
        return nowhere()
    slope = p[2] / way
    if not (slope <= tables[lens.first] and slope >= tables[lens.first + lens.rows]):
        return nowhere()
    beam = nearest_beam(lens, tables, slope)
    row = tables[lens.first + lens.rows + 1 + beam]
    return wp.vec3f(column_of(lens, tables, p, level, beam), row, 1.0)


@wp.func
def range_spinning(lens: SpinningLens, p: wp.vec3f):
    """What the sensor reports: the way along the beam, and that of its origin from the axis."""
    way = wp.sqrt(p[0] * p[0] + p[1] * p[1]) - lens.origin_offset
    return wp.sqrt(way * way + p[2] * p[2]) + lens.origin_offset


SPINNING = LensModel(SpinningLens, project_spinning, ahead_only=False, range_of=range_spinning)


@wp.func
def between(tables: wp.array[wp.float32], k: wp.int32, part: wp.float32):
    """Number `k` of a pose, a part of the way to that of the next column."""
    here = tables[k]
    return here + part * (tables[k + POSE_NUMBERS] - here)


@wp.func
def place_at(lens: SpinningLens, tables: wp.array[wp.float32], moment: wp.float32, point: wp.vec3f):
    """A world point in the frame that the sensor has at a moment, counted in columns."""
    column = wp.min(wp.int32(moment), wp.int32(lens.period) - 2)
    part = moment - wp.float32(column)
    k = lens.first + 3 * lens.rows + 1 + POSE_NUMBERS * column
    position = wp.vec3f(
        between(tables, k + 9, part), between(tables, k + 10, part), between(tables, k + 11, part)
    )
    # Neighbours differ by the turn of one column: blended linearly they stay rotations.
    rotation = wp.mat33f(
        between(tables, k, part), between(tables, k + 1, part), between(tables, k + 2, part),
        between(tables, k + 3, part), between(tables, k + 4, part), between(tables, k + 5, part),
        between(tables, k + 6, part), between(tables, k + 7, part), between(tables, k + 8, part),
    )  # fmt: skip
    return to_camera(point, rotation, position, wp.vec3f(0.0, 0.0, 0.0))


@wp.func
def within_half(way: wp.float32, period: wp.float32):
    """A way in columns, the shorter one round the turn."""
    half = 0.5 * period
    return wp.where(way > half, way - period, wp.where(way < -half, way + period, way))


# Where the way round the turn leads out of it, the one the other way round may not.
@wp.func
def within_turn(moment: wp.float32, around: wp.float32, period: wp.float32):
    """A moment of the turn: this one, the one a turn `around` it, or else that at the seam."""
    end = period - 0.5
    other = wp.where(moment < -0.5, moment + around, moment - around)
    beyond = moment < -0.5 or moment >= end
    reached = other >= -0.5 and other < end
    return wp.clamp(wp.where(beyond and reached, other, moment), 0.0, period - 1.0)


# The column decides the pose and the pose the column: the secant method, from the middle of the
# turn, on the azimuth, which does not jump from beam to beam as the column does. A point that no
# beam reaches from there still has a column, in which one may; one that is passed at the seam has
# none, and is put on the axis, where no beam looks.
@wp.func
def place_moving(view: View, lens: SpinningLens, tables: wp.array[wp.float32], point: wp.vec3f):
    """A world point in the frame that the sensor has when it meets it."""
    moment = 0.5 * (lens.period - 1.0)
    before = moment
    azimuth_before = float(0.0)
    slope = float(0.0)
    passed = bool(False)
    p = place_at(lens, tables, moment, point)
    for _n in range(MOVING_STEPS):
        level = wp.sqrt(p[0] * p[0] + p[1] * p[1])
        way = level - lens.origin_offset
        if way > 0.0:
            u = column_of(lens, tables, p, level, nearest_beam(lens, tables, p[2] / way))
            if u >= -0.5:  # false for a point that is not finite
                azimuth = lens.fx * angle_of(p[1], p[0])
                moved = moment - before
                if wp.abs(moved) >= 1.0:
                    secant = within_half(azimuth_before - azimuth, lens.period) / moved
                    slope = wp.clamp(secant, -STEEPEST, STEEPEST)
                before = moment
                azimuth_before = azimuth
                passed = wp.abs(u - moment) > 0.5 * lens.period
                less = 1.0 - slope
                step = within_half(u - moment, lens.period) / less
                moment = within_turn(moment + step, lens.period / less, lens.period)
                p = place_at(lens, tables, moment, point)
    if passed:
        return wp.vec3f(0.0, 0.0, 1.0)
    return p


MOVING = LensModel(
    SpinningLens, project_spinning, ahead_only=False, range_of=range_spinning, place=place_moving
)
