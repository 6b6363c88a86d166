"""Every camera model's projection, range and Z-buffer, in float32 and one rounding an operation.

X, Y, Z are points in the camera frame (X forward, Y left, Z up), float32 arrays of shape (N,); the
numbers of a lens are rounded to float32 first. A point outside a lens's domain gets NaN.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .precision import rounded
from .projection import inside, pixel
from .rotation import to_camera

F = np.float32
PI, HALF_PI, QUARTER_PI = F(np.pi), F(np.pi / 2), F(np.pi / 4)
TAN_EIGHTH_PI = F(np.tan(np.pi / 8))
SERIES = tuple(
    map(F, (-0.33332955837249756, 0.19977925717830658, -0.13879846036434174, 0.0806029811501503))
)

Columns = tuple[np.ndarray, np.ndarray]


def numbers(*values: float) -> list[np.float32]:
    """Each value rounded once to float32."""
    return [rounded(value, F) for value in values]


def angle_of(y: np.ndarray, x: np.ndarray) -> np.ndarray:
    """The angle of (x, y) from the x axis: z + z (z^2 series), z = small / large or turned."""
    y, x = np.asarray(y, F), np.asarray(x, F)
    with np.errstate(all="ignore"):
        small, large = np.minimum(abs(x), abs(y)), np.maximum(abs(x), abs(y))
        turned = small > TAN_EIGHTH_PI * large
        z = np.where(turned, (small - large) / (small + large), small / large)
        square = z * z
        a0, a1, a2, a3 = SERIES
        angle = z + z * (square * (a0 + square * (a1 + square * (a2 + square * a3))))
        angle = np.where(turned, QUARTER_PI + angle, angle)
        angle = np.where(abs(y) > abs(x), HALF_PI - angle, angle)
        angle = np.where(x < 0, PI - angle, angle)
        angle = np.where(y < 0, -angle, angle)
    return np.where(large == 0, F(0), angle)


def level_of(X: np.ndarray, Y: np.ndarray) -> np.ndarray:
    """sqrt(X*X + Y*Y)."""
    return np.sqrt(X * X + Y * Y)


# --- onto a plane ---


def project_brown(
    X: np.ndarray,
    Y: np.ndarray,
    Z: np.ndarray,
    intrinsics: Sequence[float],
    coefficients: Sequence[float],
    max_radius: float,
) -> Columns:
    """Brown-Conrady: `coefficients` are k1, k2, p1, p2, k3; nothing beyond `max_radius`."""
    fx, fy, cx, cy = numbers(*intrinsics)
    k1, k2, p1, p2, k3 = numbers(*coefficients)
    with np.errstate(all="ignore"):
        a, b = -(Y / X), -(Z / X)
        square = a * a + b * b
        radial = F(1) + square * (k1 + square * (k2 + square * k3))
        x, y = tangential(a, b, square, p1, p2)
        u, v = cx + fx * (a * radial + x), cy + fy * (b * radial + y)
    return within(square <= rounded(max_radius**2, F), u, v)


def project_rational(
    X: np.ndarray,
    Y: np.ndarray,
    Z: np.ndarray,
    intrinsics: Sequence[float],
    coefficients: Sequence[float],
    tilt: np.ndarray,
    max_radius: float,
) -> Columns:
    """OpenCV's full model: 14 coefficients, of which `tilt` (3, 3) stands for the last two."""
    fx, fy, cx, cy = numbers(*intrinsics)
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = numbers(*coefficients[:12])
    t = rounded(tilt, F)
    with np.errstate(all="ignore"):
        a, b = -(Y / X), -(Z / X)
        square = a * a + b * b
        above = F(1) + square * (k1 + square * (k2 + square * k3))
        below = F(1) + square * (k4 + square * (k5 + square * k6))
        radial = above / below
        x, y = tangential(a, b, square, p1, p2)
        x = (a * radial + x) + square * (s1 + square * s2)
        y = (b * radial + y) + square * (s3 + square * s4)
        scale = (t[2, 0] * x + t[2, 1] * y) + t[2, 2]
        u = cx + fx * (((t[0, 0] * x + t[0, 1] * y) + t[0, 2]) / scale)
        v = cy + fy * (((t[1, 0] * x + t[1, 1] * y) + t[1, 2]) / scale)
    return within((square <= rounded(max_radius**2, F)) & (scale > 0), u, v)


def tangential(
    a: np.ndarray, b: np.ndarray, square: np.ndarray, p1: np.float32, p2: np.float32
) -> Columns:
    """p1 (2 a b) + p2 (r^2 + 2 a^2), p1 (r^2 + 2 b^2) + p2 (2 a b)."""
    twice = F(2) * (a * b)
    return (
        p1 * twice + p2 * (square + F(2) * (a * a)),
        p1 * (square + F(2) * (b * b)) + p2 * twice,
    )


def project_orthographic(
    X: np.ndarray, Y: np.ndarray, Z: np.ndarray, pixel_size: float, cx: float, cy: float
) -> Columns:
    """Parallel rays: u = cx - f Y, v = cy - f Z, f = 1 / pixel_size."""
    f, cx, cy = numbers(1 / pixel_size, cx, cy)
    with np.errstate(all="ignore"):
        return cx - f * Y, cy - f * Z


# --- wide angles onto a plane ---


def project_fisheye(
    X: np.ndarray,
    Y: np.ndarray,
    Z: np.ndarray,
    intrinsics: Sequence[float],
    coefficients: Sequence[float],
    max_angle: float,
) -> Columns:
    """Kannala-Brandt: theta (1 + theta^2 series) from the principal point, up to `max_angle`."""
    fx, fy, cx, cy = numbers(*intrinsics)
    k1, k2, k3, k4 = numbers(*coefficients)
    with np.errstate(all="ignore"):
        aside = level_of(Y, Z)
        theta = angle_of(aside, X)
        square = theta * theta
        series = k1 + square * (k2 + square * (k3 + square * k4))
        scale = (theta * (F(1) + square * series)) / aside
        u = np.where(aside == 0, cx, cx - fx * (Y * scale))
        v = np.where(aside == 0, cy, cy - fy * (Z * scale))
    seen = (theta <= rounded(max_angle, F)) & ~((aside == 0) & (X < 0))
    return within(seen, u, v)


def project_double_sphere(
    X: np.ndarray,
    Y: np.ndarray,
    Z: np.ndarray,
    intrinsics: Sequence[float],
    xi: float,
    alpha: float,
    least_cosine: float,
) -> Columns:
    """Double sphere: u = cx - fx (Y / below), below = alpha d2 + (1 - alpha) (xi d1 + X)."""
    fx, fy, cx, cy = numbers(*intrinsics)
    xi, alpha, least_cosine = numbers(xi, alpha, least_cosine)
    with np.errstate(all="ignore"):
        aside = Y * Y + Z * Z
        distance = np.sqrt(aside + X * X)
        forward = xi * distance + X
        second = np.sqrt(aside + forward * forward)
        below = alpha * second + (F(1) - alpha) * forward
        u, v = cx - fx * (Y / below), cy - fy * (Z / below)
        return within(X > least_cosine * distance, u, v)


# --- panoramas ---


def azimuth_column(X: np.ndarray, Y: np.ndarray, fx: float, cx: float, period: float) -> np.ndarray:
    """u = cx - fx azimuth, brought into a full turn of `period` columns if that is not 0."""
    fx, cx, period = numbers(fx, cx, period)
    return wrapped(cx - fx * angle_of(Y, X), period) if period else cx - fx * angle_of(Y, X)


def wrapped(u: np.ndarray, period: np.float32) -> np.ndarray:
    """u, one turn more below -0.5, then one turn less where u + 0.5 reaches the period."""
    u = np.where(u < F(-0.5), u + period, u)
    return np.where(u + F(0.5) >= period, u - period, u)


def project_equirectangular(
    X: np.ndarray,
    Y: np.ndarray,
    Z: np.ndarray,
    intrinsics: Sequence[float],
    period: float,
    row_limits: Sequence[float],
) -> Columns:
    """v = cy - fy elevation, between the row limits."""
    fx, fy, cx, cy = intrinsics
    low, high = numbers(*row_limits)
    with np.errstate(all="ignore"):
        elevation = angle_of(Z, level_of(X, Y))
        fy, cy = numbers(fy, cy)
        v = np.minimum(np.maximum(cy - fy * elevation, low), high)
        return azimuth_column(X, Y, fx, cx, period), v


def project_cylindrical(
    X: np.ndarray, Y: np.ndarray, Z: np.ndarray, intrinsics: Sequence[float], period: float
) -> Columns:
    """v = cy - fy (Z / level)."""
    fx, fy, cx, cy = intrinsics
    with np.errstate(all="ignore"):
        u = azimuth_column(X, Y, fx, cx, period)
        fy, cy = numbers(fy, cy)
        return u, cy - fy * (Z / level_of(X, Y))


# --- spinning LiDAR ---


def meet_spinning(
    X: np.ndarray,
    Y: np.ndarray,
    Z: np.ndarray,
    intrinsics: tuple[float, float, int],
    origin_offset: float,
    beams: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Column in which the nearest beam meets a point, that beam, and the tangent of its elevation.

    `intrinsics`: columns a radian, column of azimuth 0, columns of a turn. `beams`: the tangents of
    the elevations between the beams, descending (rows + 1), each beam's row and its azimuth offset
    [columns], from above. Nearer to the axis than the beams' origins everything is NaN.
    """
    fx, cx, period = numbers(*intrinsics)
    (origin,) = numbers(origin_offset)
    limits, _, offsets = (rounded(values, F) for values in beams)
    with np.errstate(all="ignore"):
        level = level_of(X, Y)
        way = level - origin
        way = np.where(way > 0, way, F(np.nan))
        slope = Z / way
        beam = np.zeros(X.shape, np.int64)
        for limit in limits[1:-1]:
            beam += slope <= limit
        offset = offsets[beam]
        seen_from_axis = offset - offset * (origin / level)
        u = wrapped(cx - (fx * angle_of(Y, X) - seen_from_axis), period)
    return np.where(np.isnan(slope), F(np.nan), u), beam, slope


def project_spinning(
    X: np.ndarray,
    Y: np.ndarray,
    Z: np.ndarray,
    intrinsics: tuple[float, float, int],
    origin_offset: float,
    beams: tuple[np.ndarray, np.ndarray, np.ndarray],
) -> Columns:
    """Column and row of the beam that meets a point; the arguments are those of `meet_spinning`."""
    u, beam, slope = meet_spinning(X, Y, Z, intrinsics, origin_offset, beams)
    limits, rows, _ = (rounded(values, F) for values in beams)
    with np.errstate(all="ignore"):
        seen = (slope <= limits[0]) & (slope >= limits[-1])
    return within(seen, u, rows[beam])


def range_spinning(X: np.ndarray, Y: np.ndarray, Z: np.ndarray, origin_offset: float) -> np.ndarray:
    """The way along the beam, and that of its origin from the axis."""
    (origin,) = numbers(origin_offset)
    with np.errstate(all="ignore"):
        way = level_of(X, Y) - origin
        return np.sqrt(way * way + Z * Z) + origin


def to_camera_moving(
    points: np.ndarray,
    rotations: np.ndarray,
    centers: np.ndarray,
    column_of: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray],
    steps: int = 5,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (N, 3) in the frame of the moment in which it meets them: `column_of(X, Y, Z)`.

    `rotations` (columns, 3, 3) and `centers` (columns, 3): the poses of the columns, blended
    linearly between two of them. The search begins in the middle of the turn and goes on by the
    secant of the azimuth; what it leads to beyond the seam, no column meets: it is put on the axis.
    """
    poses = np.concatenate([rounded(rotations, F).reshape(-1, 9), rounded(centers, F)], axis=1)
    columns, points = len(poses), rounded(points, F).reshape(-1, 3)
    period, last, half = F(columns), F(columns - 1), F(0.5) * F(columns)
    (fx,) = numbers(columns / (2 * np.pi))

    def within_half(way: np.ndarray) -> np.ndarray:
        return np.where(way > half, way - period, np.where(way < -half, way + period, way))

    moments = np.full(len(points), F(0.5) * last)
    slope, turned = np.zeros_like(moments), np.zeros_like(moments)
    before, seam = moments, np.zeros(len(points), bool)
    placed = _placed(points, poses, moments)
    for _ in range(steps):
        u, azimuth = column_of(*placed), fx * angle_of(placed[1], placed[0])
        met = u >= F(-0.5)
        with np.errstate(all="ignore"):
            moved = moments - before
            secant = within_half(turned - azimuth) / moved
        far = met & (abs(moved) >= 1)
        slope = np.where(far, np.clip(secant, F(-0.5), F(0.5)), slope)
        before, turned = np.where(met, moments, before), np.where(met, azimuth, turned)
        seam = np.where(met, abs(u - moments) > half, seam)
        less = F(1) - slope
        after = moments + within_half(u - moments) / less
        around = period / less
        other = np.where(after < F(-0.5), after + around, after - around)
        beyond = (after < F(-0.5)) | (after >= period - F(0.5))
        reached = (other >= F(-0.5)) & (other < period - F(0.5))
        after = np.clip(np.where(beyond & reached, other, after), F(0), last)
        moments = np.where(met, after, moments)
        placed = _placed(points, poses, moments)
    axis = F(0), F(0), F(1)
    return tuple(np.where(seam, on, p) for on, p in zip(axis, placed, strict=True))


def _placed(
    points: np.ndarray, poses: np.ndarray, moments: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Each point in the frame of its own moment, counted in columns."""
    placed = np.empty((len(points), 3), F)
    for i, (point, moment) in enumerate(zip(points, moments, strict=True)):
        column = min(int(moment), len(poses) - 2)
        part = moment - F(column)
        with np.errstate(all="ignore"):
            pose = poses[column] + part * (poses[column + 1] - poses[column])
        axes = to_camera(point, pose[:9].reshape(3, 3), pose[9:], (0.0, 0.0, 0.0), F)
        placed[i] = [axis[0] for axis in axes]
    return placed[:, 0], placed[:, 1], placed[:, 2]


# --- the picture ---


def within(domain: np.ndarray, u: np.ndarray, v: np.ndarray) -> Columns:
    """u and v, NaN outside the domain."""
    return np.where(domain, u, F(np.nan)), np.where(domain, v, F(np.nan))


def render_sorted(
    xyz: tuple[np.ndarray, np.ndarray, np.ndarray],
    u: np.ndarray,
    v: np.ndarray,
    depths: np.ndarray,
    *,
    size: tuple[int, int],
    ahead_only: bool,
    min_range: float,
    max_range: float,
    least_cosine: float = 0.0,
) -> tuple[np.ndarray, np.ndarray, dict[str, int]]:
    """The Z-buffer of `zbuffer.render_loop` for any model, as a sort by (pixel, depth, index).

    Each point is counted in the first category that fits: not_finite; behind (of models that only
    see ahead, X <= 0, or X <= least_cosine * range); at the centre, which is too_near; outside;
    too_far; too_near; drawn or hidden. Depth (H, W) float32, index (H, W) int32, the counts.
    """
    width, height = size
    near, far = numbers(min_range, max_range)
    stacked = np.stack(xyz)
    with np.errstate(all="ignore"):
        X, Y, Z = stacked
        (least,) = numbers(least_cosine)
        limit = least * np.sqrt((X * X + Y * Y) + Z * Z) if least else F(0)
        reasons = {
            "not_finite": ~np.isfinite(stacked).all(axis=0),
            "behind": ~(X > limit) & ahead_only,
            "center": (stacked == 0).all(axis=0),
            "outside": ~inside(u, v, width, height),
            "too_far": depths > far,
            "too_near": (depths < near) | (depths == 0),
        }
    reason = np.select(list(reasons.values()), list(reasons), default="kept")
    counts = {name: int((reason == name).sum()) for name in reasons}
    counts["too_near"] += counts.pop("center")
    kept = np.flatnonzero(reason == "kept")
    column, row = (axis[kept].astype(np.int64) for axis in pixel(u, v))
    place = row * width + column
    order = np.lexsort((kept, depths[kept], place))
    places, first = np.unique(place[order], return_index=True)
    winners = kept[order][first]
    depth = np.zeros(height * width, F)
    index = np.full(height * width, -1, np.int32)
    depth[places], index[places] = depths[winners], winners
    counts |= {"total": len(u), "drawn": len(winners), "hidden": len(kept) - len(winners)}
    return depth.reshape(height, width), index.reshape(height, width), counts
