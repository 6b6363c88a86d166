"""Checking a calibration later on: the scan of a flat wall, and a distance measured by hand."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthwarp.checks import check_positive
from depthwarp.errors import InputError
from depthwarp.scanner.calibration.verdict import Check, Verdict
from depthwarp.scanner.geometry import ScannerGeometry
from depthwarp.scanner.triangulation import LaserPoints

__all__ = ["verify"]

Float64Array = npt.NDArray[np.float64]

MIN_WALL_POINTS = 200
WALL_STRIPS = 12
"""The wall is cut into upright strips by motor angle; their offsets show whether it is bent."""

TAPE_M = 0.002
"""How well a distance is measured by hand [m]."""


def verify(
    points: LaserPoints, geometry: ScannerGeometry, wall_distance_m: float | None = None
) -> Verdict:
    """Judge a calibration by a scan of a flat wall.

    Args:
        points: The wall and nothing else, over 20 degrees of turn or more, their sigma that of
            the line alone: triangulated without a covariance.
        geometry: The geometry that the points were computed with.
        wall_distance_m: Distance of the wall from the turning axis, measured by hand square to
            the wall [m]; None if it was not measured.

    Raises:
        InputError: Too few points, or points that lie on no plane.
    """
    normal, distance, offset, share = _wall(points)
    reach = float(np.median(points.range_m))
    toe_in_m = 1e-4 * reach**2 / geometry.plane_distance
    # What the line's own noise leaves across the wall, where rays meet it at a slant.
    noise = float(np.sqrt(np.mean((points.sigma_m * share) ** 2)))
    checks = [
        Check(
            f"roughness of the wall at {reach:.2f} m",
            1e3 * _rms(offset - _strip_means(points, offset)),
            " mm",
            1e3 * (2 * noise + 0.0005),
            1e3 * (5 * noise + 0.002),
            "the line is noisier than its sigma says: check focus, exposure and the colour model, "
            "and that the wall is matt and flat",
        ),
        Check(
            "bend of the wall across the turn",
            1e3 * float(np.ptp(_strip_means(points, offset))),
            " mm",
            1e3 * (toe_in_m + noise),
            1e3 * (4 * toe_in_m + 2 * noise),
            "a flat wall comes out bent: the laser plane's angle or the lens is off; repeat the "
            "calibration with boards up to the far end and at the edges of the image",
        ),
    ]
    if wall_distance_m is not None:
        check_positive("wall_distance_m", wall_distance_m, "metres")
        error = distance - wall_distance_m
        alike_mrad = 1e3 * abs(error) * geometry.plane_distance / reach**2
        limit = toe_in_m + TAPE_M
        checks.append(
            Check(
                f"error of the wall's distance, {distance:.3f} m for {wall_distance_m:.3f} m",
                1e3 * abs(error),
                " mm",
                1e3 * limit,
                1e3 * 4 * limit,
                f"the wall comes out too {'far' if error > 0 else 'near'}, like a toe-in error of "
                f"{alike_mrad:.2f} mrad: repeat the laser plane with targets as far as this wall, "
                "and check the size of the board's squares",
            )
        )
    return Verdict(tuple(checks))


def _wall(points: LaserPoints) -> tuple[Float64Array, float, Float64Array, Float64Array]:
    """Weighted robust plane of the wall.

    Returns:
        Normal, distance from the turning axis [m], offset of each point from the plane [m], and
        the share of its error along the ray that goes across the wall.
    """
    if len(points.range_m) < MIN_WALL_POINTS:
        raise InputError(
            f"{len(points.range_m)} points on the wall, at least {MIN_WALL_POINTS} are needed: "
            "scan it over 20 degrees of turn or more"
        )
    where = points.points_world
    weight = 1 / np.maximum(points.sigma_m, 1e-6)
    for _ in range(10):
        normal, distance = _weighted_plane(where, weight)
        offset = where @ normal - distance
        spread = max(1.4826 * float(np.median(np.abs(offset))), 1e-9)
        # Points off the wall lose their weight without a jump (Cauchy's weights).
        weight = 1 / np.maximum(points.sigma_m, 1e-6) / np.hypot(1.0, offset / (3 * spread))
    normal, distance = _weighted_plane(where, weight)
    share = np.abs(_directions(points) @ normal)
    return normal, distance, where @ normal - distance, share


def _weighted_plane(points: Float64Array, weight: Float64Array) -> tuple[Float64Array, float]:
    """Total least squares plane, its normal away from the origin."""
    center = np.average(points, axis=0, weights=weight**2)
    _, extents, axes = np.linalg.svd((points - center) * weight[:, None], full_matrices=False)
    if extents[1] < 3 * extents[2]:
        raise InputError("the points lie on no plane: give the scan of one flat wall alone")
    normal = axes[2] if axes[2] @ center > 0 else -axes[2]
    return normal, float(center @ normal)


def _directions(points: LaserPoints) -> Float64Array:
    """Unit vectors from the turning axis to the points, which stand in for the rays."""
    distance = np.linalg.norm(points.points_world, axis=1)
    return np.asarray(points.points_world / distance[:, None])


def _strip_means(points: LaserPoints, offset: Float64Array) -> Float64Array:
    """Mean offset of the strip that each point lies in."""
    low, high = float(points.angle_deg.min()), float(points.angle_deg.max())
    place = (points.angle_deg - low) / max(high - low, 1e-9) * WALL_STRIPS
    strip = np.minimum(place.astype(int), WALL_STRIPS - 1)
    count = np.maximum(np.bincount(strip, minlength=WALL_STRIPS), 1)
    return np.asarray((np.bincount(strip, offset, WALL_STRIPS) / count)[strip])


def _rms(values: Float64Array) -> float:
    return float(np.sqrt(np.mean(values**2)))
