"""Render the scanner's twin: each pixel's first surface, then its light and the sensor's noise.

Everything is in the optical frame; a solid comes with the transform into its own frame. A ray is
(x slope, y slope, 1), so that the distance along it is the depth z. Slopes are known at the
pixels' middles; their differences are how far a ray moves from pixel to pixel.
"""

import warp as wp

from depthwarp_kernels.options import EXACT

wp.set_module_options(EXACT)

NO_SURFACE = wp.constant(-1)
PRINTED_FACE = wp.constant(4)

# Light this many standard deviations beside the line's middle is below any sensor's last bit.
BEAM_REACH = wp.constant(6.0)

# The line is looked for within its beam and this fraction of the depth beside it: a pixel is worth
# that much only on a surface that is seen under less than half a degree.
PLANE_REACH = wp.constant(0.1)

# A shadow needs something this much nearer to the laser than the surface, as a fraction.
SHADOW_GAP = wp.constant(1.0e-4)


# A box: x_local = local_from_optical (x - camera position); half edges along its own axes. One
# without height is a board: its print starts at texel `first`, or `first` is -1.
@wp.struct
class Solid:
    local_from_optical: wp.mat33f
    camera: wp.vec3f
    laser: wp.vec3f
    half: wp.vec3f
    first: wp.int32
    width: wp.int32
    height: wp.int32


# The fan: its plane n . x = d, its origin, and its beam across the plane.
@wp.struct
class Fan:
    normal: wp.vec3f
    distance: wp.float32
    origin: wp.vec3f
    forward: wp.vec3f
    up: wp.vec3f
    tangent: wp.float32
    waist: wp.float32
    divergence: wp.float32


# One exposure. Levels are grey levels of 255: `ambient` of a white surface in the room's light,
# `laser` of the line times metres from the laser and metres across the line.
@wp.struct
class Exposure:
    ambient: wp.float32
    sky: wp.vec3f
    laser: wp.float32
    response: wp.vec3f
    blur: wp.float32
    speckle: wp.float32
    read_variance: wp.float32
    shot_variance: wp.float32
    full_scale: wp.float32
    mosaic: wp.vec4i
    noise_seed: wp.int32
    speckle_seed: wp.int32


@wp.func
def nonzero(x: wp.float32):
    """A divisor: a ray along a face meets its plane far beyond everything."""
    return wp.where(x == 0.0, 1.0e-30, x)


@wp.func
def entry_of(start: wp.vec3f, ray: wp.vec3f, half: wp.vec3f):
    """Where a ray enters the box around the origin, along it on each axis, and where it leaves."""
    inverse = wp.vec3f(1.0 / nonzero(ray[0]), 1.0 / nonzero(ray[1]), 1.0 / nonzero(ray[2]))
    middle = -wp.cw_mul(start, inverse)
    reach = wp.cw_mul(wp.abs(inverse), half)
    return middle - reach, wp.min(middle + reach)


@wp.func
def face_of(entry: wp.vec3f, ray: wp.vec3f):
    """Face of a box, -x +x -y +y -z +z, that a ray with this entry goes through."""
    axis = wp.where(entry[1] > entry[0], 1, 0)
    axis = wp.where(entry[2] > entry[axis], 2, axis)
    return 2 * axis + wp.where(ray[axis] < 0.0, 1, 0)


@wp.func
def face_normal(solid: Solid, face: wp.int32):
    """Outward normal of a face, optical frame."""
    axis = face // 2
    sign = wp.where(face % 2 == 1, 1.0, -1.0)
    m = solid.local_from_optical
    return sign * wp.vec3f(m[axis, 0], m[axis, 1], m[axis, 2])


# Launch over (rows, columns). `surface` is 6 solid + face.
@wp.kernel
def trace(
    # In:
    slopes: wp.array2d[wp.vec2f],
    solids: wp.array[Solid],
    tile_first: wp.array[wp.int32],
    tile_items: wp.array[wp.int32],
    tile_side: wp.int32,
    tiles_across: wp.int32,
    # Out:
    depth_out: wp.array2d[wp.float32],
    surface_out: wp.array2d[wp.int32],
):
    row, column = wp.tid()
    slope = slopes[row, column]
    ray = wp.vec3f(slope[0], slope[1], 1.0)
    tile = row // tile_side * tiles_across + column // tile_side
    nearest = wp.float32(0.0)
    surface = wp.int32(NO_SURFACE)
    for i in range(tile_first[tile], tile_first[tile + 1]):
        index = tile_items[i]
        solid = solids[index]
        local = solid.local_from_optical * ray
        entry, leave = entry_of(solid.camera, local, solid.half)
        entered = wp.max(entry)
        if entered > 0.0 and entered <= leave and (surface < 0 or entered < nearest):
            nearest = entered
            surface = 6 * index + face_of(entry, local)
    depth_out[row, column] = nearest
    surface_out[row, column] = surface


@wp.func
def slope_step(slopes: wp.array2d[wp.vec2f], row: wp.int32, column: wp.int32, down: wp.int32):
    """How the slopes change from this pixel to the next, to the right or downwards."""
    along = wp.where(down == 1, slopes.shape[0], slopes.shape[1])
    at = wp.where(down == 1, row, column)
    low = wp.max(at - 1, 0) - at
    high = wp.min(at + 1, along - 1) - at
    before = slopes[row + low * down, column + low * (1 - down)]
    after = slopes[row + high * down, column + high * (1 - down)]
    return (after - before) / wp.float32(wp.max(high - low, 1))


@wp.func
def texel(solid: Solid, texels: wp.array[wp.uint8], x: wp.int32, y: wp.int32):
    """Reflectance of a print at a texel, 0 to 1, its rim continued."""
    column = wp.clamp(x, 0, solid.width - 1)
    row = wp.clamp(y, 0, solid.height - 1)
    return wp.float32(texels[solid.first + row * solid.width + column]) / 255.0


@wp.func
def print_at(solid: Solid, texels: wp.array[wp.uint8], ray: wp.vec3f):
    """Reflectance of a board's print where a ray meets it, between the texels by bilinear steps."""
    local = solid.local_from_optical * ray
    point = solid.camera - (solid.camera[2] / nonzero(local[2])) * local
    x = (point[0] / solid.half[0] + 1.0) * 0.5 * wp.float32(solid.width) - 0.5
    y = (point[1] / solid.half[1] + 1.0) * 0.5 * wp.float32(solid.height) - 0.5
    left = wp.int32(wp.floor(wp.clamp(x, -1.0, wp.float32(solid.width))))
    top = wp.int32(wp.floor(wp.clamp(y, -1.0, wp.float32(solid.height))))
    fx = wp.clamp(x - wp.float32(left), 0.0, 1.0)
    fy = wp.clamp(y - wp.float32(top), 0.0, 1.0)
    upper = wp.lerp(texel(solid, texels, left, top), texel(solid, texels, left + 1, top), fx)
    lower = wp.lerp(
        texel(solid, texels, left, top + 1), texel(solid, texels, left + 1, top + 1), fx
    )
    return wp.lerp(upper, lower, fy)


# 4 x 4 samples turned by atan(1/4), so that an edge along the rows or the columns meets sixteen
# different offsets; the grid is as wide as pixel and blur together. It is symmetric about the
# pixel's middle: corners do not move.
@wp.func
def print_of_pixel(
    solid: Solid,
    texels: wp.array[wp.uint8],
    ray: wp.vec3f,
    across: wp.vec3f,
    down: wp.vec3f,
    blur: wp.float32,
):
    """Reflectance of a board's print, averaged over a pixel and the lens's blur."""
    step = wp.sqrt(1.0 + 12.0 * blur * blur) / 4.0
    total = wp.float32(0.0)
    for i in range(16):
        a = (wp.float32(i % 4) - 1.5) * step
        b = (wp.float32(i // 4) - 1.5) * step
        du = (4.0 * a - b) * 0.24253563
        dv = (a + 4.0 * b) * 0.24253563
        total += print_at(solid, texels, ray + du * across + dv * down)
    return total / 16.0


@wp.func
def in_shadow(solids: wp.array[Solid], from_laser: wp.vec3f):
    """Whether a solid stands between the laser and the point that far from it."""
    for i in range(solids.shape[0]):
        local = solids[i].local_from_optical * from_laser
        entry, leave = entry_of(solids[i].laser, local, solids[i].half)
        entered = wp.max(entry)
        if entered > 0.0 and entered <= leave and entered < 1.0 - SHADOW_GAP:
            return True
    return False


@wp.func
def normal_cdf(x: wp.float32):
    """Integral of the normal distribution up to x."""
    return 0.5 * (1.0 + wp.erf(x * 0.70710678))


# Along the pixel's row the beam is integrated over the surface's tangent plane; across the rows
# the width of the pixel, and the blur both ways, widen the Gaussian.
@wp.func
def line_density(
    fan: Fan,
    normal: wp.vec3f,
    point: wp.vec3f,
    ray: wp.vec3f,
    across: wp.vec3f,
    down: wp.vec3f,
    blur: wp.float32,
):
    """Mean of the beam's Gaussian over a pixel [1 / m]."""
    plane = wp.dot(normal, point)
    facing = wp.dot(normal, ray)
    if facing > -1.0e-6:
        return 0.0
    beside = wp.dot(fan.normal, point) - fan.distance
    # Derivative of plane (n . ray) / (normal . ray), the distance from the laser plane.
    rise = plane / (facing * facing)
    side = wp.dot(fan.normal, ray)
    step = rise * (wp.dot(fan.normal, across) * facing - side * wp.dot(normal, across))
    step_down = rise * (wp.dot(fan.normal, down) * facing - side * wp.dot(normal, down))
    width = fan.divergence * wp.length(point - fan.origin)
    softness = blur * blur * (step * step + step_down * step_down) + step_down * step_down / 12.0
    sigma = wp.sqrt(fan.waist * fan.waist + width * width + softness)
    if wp.abs(beside) > BEAM_REACH * sigma + 0.5 * wp.abs(step):
        return 0.0
    left = (beside - 0.5 * step) / sigma
    right = (beside + 0.5 * step) / sigma
    if wp.abs(right - left) < 0.02:
        return 0.39894228 * wp.exp(-0.5 * left * right) / sigma
    return (normal_cdf(right) - normal_cdf(left)) / ((right - left) * sigma)


@wp.func
def laser_light(
    fan: Fan,
    solids: wp.array[Solid],
    normal: wp.vec3f,
    point: wp.vec3f,
    ray: wp.vec3f,
    across: wp.vec3f,
    down: wp.vec3f,
    blur: wp.float32,
):
    """Light of the line on a pixel's surface: cosine / distance x density [1 / m^2]."""
    from_laser = point - fan.origin
    distance = wp.length(from_laser)
    cosine = -wp.dot(normal, from_laser) / distance
    ahead = wp.dot(from_laser, fan.forward)
    if cosine <= 0.0 or wp.abs(wp.dot(from_laser, fan.up)) > fan.tangent * ahead:
        return 0.0
    density = line_density(fan, normal, point, ray, across, down, blur)
    if density == 0.0:
        return 0.0
    if in_shadow(solids, from_laser):
        return 0.0
    return density * cosine / distance


@wp.func
def developed(exposure: Exposure, level: wp.float32, draw: wp.float32):
    """A pixel's number: noise from a normal draw, saturation and rounding of a grey level."""
    sigma = wp.sqrt(exposure.read_variance + exposure.shot_variance * level)
    share = wp.clamp((level + sigma * draw) / 255.0, 0.0, 1.0)
    return wp.uint16(wp.floor(share * exposure.full_scale + 0.5))


# Launch over (rows, columns). `pixels_out` has three channels for BGR or one for a mosaic.
@wp.kernel
def expose(
    # In:
    exposure: Exposure,
    fan: Fan,
    slopes: wp.array2d[wp.vec2f],
    solids: wp.array[Solid],
    depth: wp.array2d[wp.float32],
    surface: wp.array2d[wp.int32],
    surface_ambient: wp.array[wp.vec3f],
    surface_reflectance: wp.array[wp.float32],
    texels: wp.array[wp.uint8],
    # Out:
    pixels_out: wp.array3d[wp.uint16],
):
    row, column = wp.tid()
    face = surface[row, column]
    color = exposure.ambient * exposure.sky
    if face >= 0:
        index = face // 6
        slope = slopes[row, column]
        ray = wp.vec3f(slope[0], slope[1], 1.0)
        point = depth[row, column] * ray
        printed = solids[index].first >= 0 and face % 6 == PRINTED_FACE
        beside = wp.abs(wp.dot(fan.normal, point) - fan.distance)
        beam = fan.waist + fan.divergence * wp.length(point - fan.origin)
        reach = BEAM_REACH * beam + PLANE_REACH * depth[row, column]
        near_line = exposure.laser > 0.0 and beside < reach
        paint = wp.float32(1.0)
        laser = wp.float32(0.0)
        if printed or near_line:
            step = slope_step(slopes, row, column, 0)
            across = wp.vec3f(step[0], step[1], 0.0)
            step = slope_step(slopes, row, column, 1)
            down = wp.vec3f(step[0], step[1], 0.0)
            if printed:
                paint = print_of_pixel(solids[index], texels, ray, across, down, exposure.blur)
            if near_line:
                normal = face_normal(solids[index], face % 6)
                laser = laser_light(fan, solids, normal, point, ray, across, down, exposure.blur)
        if laser > 0.0 and exposure.speckle > 0.0:
            grain = wp.rand_init(exposure.speckle_seed, row * depth.shape[1] + column)
            laser *= wp.exp(
                exposure.speckle * wp.randn(grain) - 0.5 * exposure.speckle * exposure.speckle
            )
        light = exposure.laser * surface_reflectance[face] * laser
        color = paint * (exposure.ambient * surface_ambient[face] + light * exposure.response)
    state = wp.rand_init(exposure.noise_seed, row * depth.shape[1] + column)
    if pixels_out.shape[2] == 3:
        for c in range(3):
            pixels_out[row, column, c] = developed(exposure, color[2 - c], wp.randn(state))
    else:
        c = exposure.mosaic[2 * (row % 2) + column % 2]
        pixels_out[row, column, 0] = developed(exposure, color[c], wp.randn(state))
