"""Splat points into a Z-buffer of packed keys.

A key is `depth bits << 32 | point index`, or the bits of the depth where no index is asked for. The
bits of a positive float order like its value, so the minimum over keys is the nearest point and, on
equal depth, the lowest index, whatever the order of the points, the threads or the device.
"""

import math
from dataclasses import dataclass
from functools import cache

import warp as wp

from depthwarp_kernels.lens import LensModel, range_from_center, z_of
from depthwarp_kernels.options import EXACT
from depthwarp_kernels.point_source import (
    ALL_BEHIND,
    ALL_DRAWN,
    ALL_OUTSIDE,
    BLOCK,
    NONE_IN_VIEW,
    SEEN,
    PointSource,
    camera_sphere,
)
from depthwarp_kernels.view import (
    View,
    in_image,
    in_range_view,
    is_finite,
    pixel_of,
    range_depth,
)

wp.set_module_options(EXACT)

EMPTY_KEY = 0xFFFFFFFFFFFFFFFF
EMPTY_DEPTH = 0xFFFFFFFF

# Why a point is not drawn: the columns of `counts`. A point counts under the first that applies.
NOT_FINITE = wp.constant(0)
BEHIND = wp.constant(1)
OUTSIDE = wp.constant(2)
TOO_FAR = wp.constant(3)
TOO_NEAR = wp.constant(4)
DRAWN = wp.constant(5)
COUNT_COLUMNS = 6

# Of lenses that see beside themselves, z is a depth only up to 85 degrees from the axis: beyond, a
# pixel's width of angle is more than the depth. Blocks are ahead as a whole a degree before that.
LEAST_Z_COSINE = wp.constant(math.cos(math.radians(85.0)))
AHEAD_COSINE = wp.constant(math.cos(math.radians(84.0)))
AHEAD_SINE = wp.constant(math.sin(math.radians(84.0)))

# More than rounding can move a depth by, in parts of it.
DEPTH_ROUNDING = wp.constant(wp.float32(1.0e-6))


@dataclass(frozen=True)
class SplatConfig:
    """What is decided at compile time.

    Attributes:
        source: Kind of cloud.
        lens: Camera model.
        depth: `"range"` or `"z"`.
        range_view: Whether (8)(9) select the points.
        with_index: Whether keys hold the index of the winner.
    """

    source: PointSource
    lens: LensModel
    depth: str
    range_view: bool
    with_index: bool = True

    @property
    def key_type(self):
        """Type of a key."""
        return wp.uint64 if self.with_index else wp.uint32

    @property
    def ahead_only(self):
        """Whether points with X <= 0 are behind the camera."""
        return self.lens.ahead_only or self.depth == "z"

    @property
    def is_wide_z(self):
        """Whether z is measured through a lens that sees beside itself."""
        return self.depth == "z" and not self.lens.ahead_only

    @property
    def depth_of(self):
        """The function (lens, p) that measures the depth of a camera-frame point."""
        return z_of if self.depth == "z" else self.lens.range_of


@wp.func
def count(counts: wp.array2d[wp.int64], view: wp.int32, reason: wp.int32):
    """Count one point of a view under a reason."""
    wp.atomic_add(counts, view, reason, wp.int64(1))


@wp.func
def depth_key(depth: wp.float32):
    """Z-buffer key without an index: the smaller one is nearer."""
    return wp.cast(depth, wp.uint32)


@wp.func
def pack_key(depth: wp.float32, index: wp.int32):
    """Z-buffer key of a point: the smaller one is nearer, or equally near and earlier."""
    return (wp.uint64(wp.cast(depth, wp.uint32)) << wp.uint64(32)) | wp.uint64(index)


# Without branches, so that a CPU can look at several points at once.
@cache
def reason_function(config: SplatConfig):
    """The function (view, p, pixel, depth) that says what becomes of a camera-frame point."""

    @wp.func
    def reason_of(view: View, p: wp.vec3f, pixel: wp.vec3f, depth: wp.float32):
        near = depth < view.min_range or depth == 0.0
        reason = wp.where(near, TOO_NEAR, DRAWN)
        reason = wp.where(depth > view.max_range, TOO_FAR, reason)
        reason = wp.where(in_image(view, pixel), reason, OUTSIDE)
        if wp.static(config.range_view):
            reason = wp.where(in_range_view(p, view.steps, view.line_count), reason, OUTSIDE)
        if wp.static(config.is_wide_z):
            reason = wp.where(p[0] > LEAST_Z_COSINE * range_depth(p), reason, BEHIND)
        elif wp.static(config.ahead_only):
            reason = wp.where(p[0] > 0.0, reason, BEHIND)
        else:
            # A point at the centre has no direction, so no pixel either.
            at_center = p[0] == 0.0 and p[1] == 0.0 and p[2] == 0.0
            reason = wp.where(at_center, TOO_NEAR, reason)
        return wp.where(is_finite(p), reason, NOT_FINITE)

    return reason_of


@cache
def center_depth_function(config: SplatConfig):
    """The function (center) that measures the depth of a sphere's centre."""

    @wp.func
    def center_depth(center: wp.vec3f):
        if wp.static(config.depth_of is range_from_center):
            return wp.length(center)
        else:
            return center[0]

    return center_depth


# A block that cannot be in view is counted as its points would be one by one: behind if all of it
# is, outside if all of it is ahead, and else each by its side of the camera's plane.
@cache
def verdict_function(config: SplatConfig):
    """The function (view, sphere) that says what is to be done with the points in a sphere."""
    may_meet, inside = config.lens.may_meet, config.lens.inside
    center_depth = center_depth_function(config)

    @wp.func
    def in_bounds(view: View, center: wp.vec3f, radius: wp.float32):
        """Whether all depths in a sphere lie between min_range and max_range."""
        depth = center_depth(center)
        margin = radius + DEPTH_ROUNDING * depth
        return depth - margin > view.min_range and depth + margin < view.max_range

    @wp.func
    def verdict_of(view: View, sphere_world: wp.vec4f):
        sphere = camera_sphere(view, sphere_world)
        center = wp.vec3f(sphere[0], sphere[1], sphere[2])
        radius = sphere[3]
        if not is_finite(center):
            return SEEN
        if wp.static(config.ahead_only):
            if center[0] <= -radius:
                return ALL_BEHIND
        if wp.static(config.is_wide_z):
            aside = wp.sqrt(center[1] * center[1] + center[2] * center[2])
            if center[0] * AHEAD_SINE - aside * AHEAD_COSINE <= radius:
                return SEEN
        if wp.static(inside is not None and not config.range_view):
            if inside(view, center, radius) and in_bounds(view, center, radius):
                return ALL_DRAWN
        if may_meet(view, center, radius):
            return SEEN
        if wp.static(config.ahead_only):
            if center[0] <= radius:
                return NONE_IN_VIEW
        return ALL_OUTSIDE

    return verdict_of


@cache
def splat_kernel(config: SplatConfig):
    """Kernel that draws points from `first` on into the keys of views; launch over both."""
    depth_of = config.depth_of
    Lens, Source = config.lens.struct, config.source.struct
    place, project = config.lens.place, config.lens.project
    point_at, index_at = config.source.point_at, config.source.index_at
    sphere_of = config.source.sphere_of
    Key = config.key_type
    reason_of = reason_function(config)
    verdict_of = verdict_function(config)

    @wp.kernel(module="unique", module_options=EXACT, enable_backward=False)
    def splat(
        # In:
        views: wp.array[View],
        lenses: wp.array[Lens],
        tables: wp.array[wp.float32],
        source: Source,
        first: wp.int32,
        # Out:
        keys_out: wp.array2d[Key],
        counts_out: wp.array2d[wp.int64],
    ):
        v, i = wp.tid()
        i += first
        view = views[v]
        if wp.static(sphere_of is not None):
            verdict = verdict_of(view, sphere_of(source, i / wp.static(BLOCK)))
            if verdict == ALL_BEHIND or verdict == ALL_OUTSIDE:
                count(counts_out, v, wp.where(verdict == ALL_BEHIND, BEHIND, OUTSIDE))
                return
        lens = lenses[v]
        p = place(view, lens, tables, point_at(source, i))
        pixel = pixel_of(project(lens, tables, p))
        depth = depth_of(lens, p)
        reason = reason_of(view, p, pixel, depth)
        if reason != DRAWN:
            count(counts_out, v, reason)
            return
        if wp.static(config.with_index):
            key = pack_key(depth, index_at(source, i))
        else:
            key = depth_key(depth)
        cell = wp.int32(pixel[1]) * view.width + wp.int32(pixel[0])
        # A key only ever falls, so a stale read can cost an atomic but never a point.
        if key < keys_out[v, cell]:
            wp.atomic_min(keys_out, v, cell, key)

    return splat
