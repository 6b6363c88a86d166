"""The first surface along a ray, among solids in a tree of bounding boxes; float64."""

import warp as wp

wp.set_module_options({"enable_backward": False, "fuse_fp": False})

BOX = wp.constant(0)
CYLINDER = wp.constant(1)
NOTHING = wp.constant(wp.float64(1.0e300))
"""Distance of a ray that meets nothing."""

CUT_SLACK = wp.constant(1.001)
"""The tree works in float32: boxes a little beyond the best distance are looked at, too."""


@wp.struct
class Solids:
    """Solids as arrays; see `solids.Solid`."""

    kind: wp.array[wp.int32]
    center: wp.array[wp.vec3d]
    half: wp.array[wp.vec3d]
    axes: wp.array[wp.mat33d]


@wp.struct
class Meeting:
    """Where a ray enters a solid: distance, or NOTHING, and the normal in the solid's frame."""

    distance: wp.float64
    normal: wp.vec3d


@wp.func
def steep(component: wp.float64):
    """One over a component; a ray parallel to a slab meets its planes "at 1e300 m"."""
    if component == wp.float64(0.0):
        return NOTHING
    return wp.float64(1.0) / component


@wp.func
def toward(component: wp.float64):
    """The sign of the face that a ray with this component enters by."""
    return wp.where(component > wp.float64(0.0), wp.float64(-1.0), wp.float64(1.0))


@wp.func
def meet_box(start: wp.vec3d, ray: wp.vec3d, half: wp.vec3d):
    """Slabs: the ray is inside from the last entry to the first exit."""
    met = Meeting()
    met.distance = NOTHING
    entered = -NOTHING
    left = NOTHING
    for axis in range(3):
        inverse = steep(ray[axis])
        middle = -start[axis] * inverse
        reach = half[axis] * wp.abs(inverse)
        if middle - reach > entered:
            entered = middle - reach
            met.normal = wp.vec3d()
            met.normal[axis] = toward(ray[axis])
        left = wp.min(left, middle + reach)
    if entered <= left and entered > wp.float64(0.0):
        met.distance = entered
    return met


@wp.func
def meet_round(start: wp.vec3d, ray: wp.vec3d, radius: wp.float64):
    """Distances at which a ray is `radius` from the origin, (entry, exit); the exit is the lower
    one where it never is. Of a cylinder, start and ray without their z."""
    square = wp.dot(ray, ray)
    if square == wp.float64(0.0):
        if wp.dot(start, start) > radius * radius:
            return wp.vec2d(NOTHING, -NOTHING)
        return wp.vec2d(-NOTHING, NOTHING)
    middle = -wp.dot(start, ray) / square
    nearest = start + middle * ray
    left = radius * radius - wp.dot(nearest, nearest)
    if left < wp.float64(0.0):
        return wp.vec2d(NOTHING, -NOTHING)
    reach = wp.sqrt(left / square)
    return wp.vec2d(middle - reach, middle + reach)


@wp.func
def meet_cylinder(start: wp.vec3d, ray: wp.vec3d, half: wp.vec3d):
    """Inside the round wall and between the two ends."""
    met = Meeting()
    met.distance = NOTHING
    flat_start = wp.vec3d(start[0], start[1], wp.float64(0.0))
    flat_ray = wp.vec3d(ray[0], ray[1], wp.float64(0.0))
    wall = meet_round(flat_start, flat_ray, half[0])
    inverse = steep(ray[2])
    middle = -start[2] * inverse
    reach = half[2] * wp.abs(inverse)
    entered = wp.max(wall[0], middle - reach)
    if entered <= wp.min(wall[1], middle + reach) and entered > wp.float64(0.0):
        met.distance = entered
        if wall[0] > middle - reach:
            met.normal = (flat_start + entered * flat_ray) / half[0]
        else:
            met.normal = wp.vec3d(wp.float64(0.0), wp.float64(0.0), toward(ray[2]))
    return met


@wp.func
def meet_sphere(start: wp.vec3d, ray: wp.vec3d, radius: wp.float64):
    """The nearer of the two places."""
    met = Meeting()
    met.distance = NOTHING
    ball = meet_round(start, ray, radius)
    if ball[0] <= ball[1] and ball[0] > wp.float64(0.0):
        met.distance = ball[0]
        met.normal = (start + ball[0] * ray) / radius
    return met


@wp.func
def meet(solids: Solids, index: wp.int32, origin: wp.vec3d, direction: wp.vec3d):
    """Where a ray enters a solid; a ray that starts inside does not see it."""
    axes = solids.axes[index]
    start = axes * (origin - solids.center[index])
    ray = axes * direction
    half = solids.half[index]
    kind = solids.kind[index]
    if kind == BOX:
        met = meet_box(start, ray, half)
    elif kind == CYLINDER:
        met = meet_cylinder(start, ray, half)
    else:
        met = meet_sphere(start, ray, half[0])
    met.normal = wp.transpose(axes) * met.normal
    return met


# Launch over rays; `origins` holds one for all rays or one a ray, `first` is the first ray.
@wp.kernel
def cast_rays(
    # In:
    tree: wp.uint64,
    solids: Solids,
    origins: wp.array[wp.vec3d],
    directions: wp.array[wp.vec3d],
    first: wp.int32,
    # Out:
    distance_out: wp.array[wp.float64],
    solid_out: wp.array[wp.int32],
    normal_out: wp.array[wp.vec3d],
):
    ray = first + wp.tid()
    origin = origins[wp.min(ray, origins.shape[0] - 1)]
    direction = directions[ray]
    nearest = NOTHING
    cut = float(wp.inf)
    solid = wp.int32(-1)
    normal = wp.vec3d()
    query = wp.bvh_query_ray(tree, wp.vec3f(origin), wp.vec3f(direction))
    index = wp.int32(0)
    while wp.bvh_query_next(query, index, cut):
        met = meet(solids, index, origin, direction)
        if met.distance < nearest or (met.distance == nearest and index < solid):
            nearest = met.distance
            cut = float(nearest) * CUT_SLACK
            solid = index
            normal = met.normal
    distance_out[ray] = wp.where(solid < 0, wp.float64(wp.inf), nearest)
    solid_out[ray] = solid
    normal_out[ray] = normal
