"""The lens: from pixels to straight rays and back, peak by peak.

Brown-Conrady's model as OpenCV defines it bends the image back on itself beyond some radius; a
pixel or a ray out there has no partner and becomes NaN instead of a wrong number.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError
from depthwarp.scanner.geometry import Lens

__all__ = ["distort", "distortion_jacobian", "lens_radius", "project", "undistort"]

Float64Array = npt.NDArray[np.float64]

ITERATIONS, TOLERANCE = 40, 1e-12
"""OpenCV stops after 5 iterations by itself, which leaves up to 5 px in the reference lens."""

MAX_ROUND_TRIP_PX = 1e-6
"""A pixel that comes back farther than this from where it started is outside the lens's domain."""


def undistort(lens: Lens, pixels: npt.ArrayLike) -> Float64Array:
    """Undo the lens for single pixels.

    Args:
        lens: The lens.
        pixels: (u, v) [px], shape (N, 2); pixel centres are at whole numbers.

    Returns:
        (x', y') on the plane z = 1 of the optical frame, shape (N, 2); NaN where the lens has no
        such pixel. `distort` leads back to within 1e-9 px.

    Raises:
        InputError: Wrong shape.
    """
    image = _pairs("pixels", pixels)
    if len(image) == 0:
        return image
    finite = np.isfinite(image[:, 0]) & np.isfinite(image[:, 1])
    start = np.where(finite[:, None], image, (lens.cx, lens.cy))
    rays = _cv2_undistort(start, lens)
    # OpenCV's fixed point closes in linearly; near the edge of a wide lens 40 rounds leave 1e-8 px.
    rays = _newton_step(lens, start, _newton_step(lens, start, rays))
    good = finite & _in_domain(lens, rays)
    with np.errstate(invalid="ignore", over="ignore"):
        good &= np.abs(_bend(lens, rays) - start).max(axis=1) < MAX_ROUND_TRIP_PX
    return np.where(good[:, None], rays, np.nan)


def distort(lens: Lens, rays: npt.ArrayLike) -> Float64Array:
    """Where rays are seen: the forward direction of `undistort`.

    Args:
        lens: The lens.
        rays: (x', y') on the plane z = 1 of the optical frame, shape (N, 2).

    Returns:
        (u, v) [px], shape (N, 2), inside or outside the frame; NaN beyond the radius where the
        distortion folds back.

    Raises:
        InputError: Wrong shape.
    """
    normalized = _pairs("rays", rays)
    good = _in_domain(lens, normalized)
    with np.errstate(invalid="ignore", over="ignore"):
        return np.where(good[:, None], _bend(lens, normalized), np.nan)


def project(lens: Lens, points_optical: npt.ArrayLike) -> Float64Array:
    """Where points are seen.

    Args:
        lens: The lens.
        points_optical: Points in the optical frame [m], shape (N, 3).

    Returns:
        (u, v) [px], shape (N, 2); NaN for points that are not in front of the camera and for
        those outside the lens's domain.

    Raises:
        InputError: Wrong shape.
    """
    points = np.asarray(points_optical, np.float64)
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"points_optical must have shape (N, 3), got {points.shape}")
    depth = np.where(points[:, 2] > 0, points[:, 2], np.nan)
    return distort(lens, points[:, :2] / depth[:, None])


def lens_radius(lens: Lens) -> float:
    """Radius on the plane z = 1 up to which the distortion is one-to-one; infinite if everywhere.

    It is the first root of the radial derivative 1 + 3 k1 r^2 + 5 k2 r^4 + 7 k3 r^6.
    """
    k1, k2, _, _, k3 = lens.distortion
    inverse_squares = np.roots([1.0, 3 * k1, 5 * k2, 7 * k3])  # in 1/r^2: monic for every lens
    real = inverse_squares.real[inverse_squares.imag == 0]
    largest = float(real.max(initial=0.0))
    return 1 / math.sqrt(largest) if largest > 0 else math.inf


def distortion_jacobian(lens: Lens, rays: Float64Array) -> tuple[Float64Array, Float64Array]:
    """How bent rays move with the straight ones and with the lens's coefficients.

    Args:
        lens: The lens.
        rays: (x', y'), shape (N, 2).

    Returns:
        d(x'', y'') / d(x', y'), shape (N, 2, 2), and d(x'', y'') / d(k1, k2, p1, p2, k3),
        shape (N, 2, 5), where u = fx x'' + cx and v = fy y'' + cy.
    """
    k1, k2, p1, p2, k3 = lens.distortion
    x, y = rays[:, 0], rays[:, 1]
    s = x * x + y * y
    radial = 1 + s * (k1 + s * (k2 + s * k3))
    slope = 2 * (k1 + s * (2 * k2 + s * 3 * k3))  # d radial / d x = slope * x
    by_ray = np.empty((len(rays), 2, 2))
    by_ray[:, 0, 0] = radial + slope * x * x + 2 * p1 * y + 6 * p2 * x
    by_ray[:, 1, 1] = radial + slope * y * y + 6 * p1 * y + 2 * p2 * x
    by_ray[:, 0, 1] = by_ray[:, 1, 0] = slope * x * y + 2 * p1 * x + 2 * p2 * y
    by_coefficient = np.stack(
        [
            np.stack([x * s, x * s**2, 2 * x * y, s + 2 * x * x, x * s**3], axis=1),
            np.stack([y * s, y * s**2, s + 2 * y * y, 2 * x * y, y * s**3], axis=1),
        ],
        axis=1,
    )
    return by_ray, by_coefficient


def _pairs(name: str, values: npt.ArrayLike) -> Float64Array:
    pairs = np.asarray(values, np.float64)
    if pairs.ndim != 2 or pairs.shape[1] != 2:
        raise InputError(f"{name} must have shape (N, 2), got {pairs.shape}")
    return pairs


def _cv2_undistort(pixels: Float64Array, lens: Lens) -> Float64Array:
    """OpenCV's inverse with criteria; 4.x has a function of its own for it."""
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, ITERATIONS, TOLERANCE)
    source, K, distortion = pixels[:, None, :], lens.K, np.array(lens.distortion)
    iterate: Callable[..., Any] | None = getattr(cv2, "undistortPointsIter", None)
    if iterate is not None:
        rays = iterate(source, K, distortion, np.eye(3), np.eye(3), criteria)
    else:
        rays = cv2.undistortPoints(source, K, distortion, criteria=criteria)
    return np.asarray(rays, np.float64)[:, 0]


def _bend(lens: Lens, rays: Float64Array) -> Float64Array:
    """The forward model without a look at its domain."""
    k1, k2, p1, p2, k3 = lens.distortion
    x, y = rays[:, 0], rays[:, 1]
    s = x * x + y * y
    radial = 1 + s * (k1 + s * (k2 + s * k3))
    bent_x = x * radial + 2 * p1 * x * y + p2 * (s + 2 * x * x)
    bent_y = y * radial + p1 * (s + 2 * y * y) + 2 * p2 * x * y
    return np.stack([lens.fx * bent_x + lens.cx, lens.fy * bent_y + lens.cy], axis=1)


def _newton_step(lens: Lens, pixels: Float64Array, rays: Float64Array) -> Float64Array:
    """One Newton step towards the ray that is seen at a pixel."""
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        missing = (pixels - _bend(lens, rays)) / (lens.fx, lens.fy)
        jacobian, _ = distortion_jacobian(lens, rays)
        a, b, d = jacobian[:, 0, 0], jacobian[:, 0, 1], jacobian[:, 1, 1]
        x, y = missing[:, 0], missing[:, 1]
        step = np.stack([d * x - b * y, a * y - b * x], axis=1) / (a * d - b * b)[:, None]
        return np.asarray(rays + step)


def _in_domain(lens: Lens, rays: Float64Array) -> npt.NDArray[np.bool_]:
    """Rays on the near side of the fold: inside the radius, and orientation kept."""
    with np.errstate(invalid="ignore", over="ignore"):
        jacobian, _ = distortion_jacobian(lens, rays)
        determinant = jacobian[:, 0, 0] * jacobian[:, 1, 1] - jacobian[:, 0, 1] ** 2
        return np.asarray(
            (np.hypot(rays[:, 0], rays[:, 1]) < lens_radius(lens)) & (determinant > 0)
        )
