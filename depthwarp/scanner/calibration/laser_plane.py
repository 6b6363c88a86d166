"""The laser plane from the line on boards of known pose: robust first guess, then least squares."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError
from depthwarp.scanner.calibration.views import BoardView, on_board
from depthwarp.scanner.geometry import Lens

__all__ = ["LaserPlane", "calibrate_laser_plane", "fit_plane"]

Float64Array = npt.NDArray[np.float64]

TRIALS, TRIMS = 500, 5
INLIER_PX = 2.0
"""A point that lies farther from the plane than about this many pixels is a reflection or a gap."""

MIN_POINTS = 30
MIN_SPREAD = 0.02
"""Least extent of the points across the line, as a share of their distance."""


@dataclass(frozen=True, eq=False)
class LaserPlane:
    """A plane n . X = d in the optical frame.

    Attributes:
        normal: Unit normal n, pointing away from the camera, shape (3,).
        distance: d [m].
        inliers: Which points belong to it, shape (N,) bool.
        rms_m: Root mean square distance of these points from it [m].
        nearest_m: Distance of the nearest of them from the camera [m].
        farthest_m: Of the farthest [m].
    """

    normal: Float64Array
    distance: float
    inliers: npt.NDArray[np.bool_]
    rms_m: float
    nearest_m: float
    farthest_m: float

    @property
    def baseline_m(self) -> float:
        """Where the plane cuts the camera's X axis [m]; below 0 for a laser on the left."""
        return self.distance / float(self.normal[0])

    @property
    def toe_in_deg(self) -> float:
        """Turn of the plane towards the camera's viewing direction [degrees]."""
        return math.degrees(math.atan(float(self.normal[2] / self.normal[0])))


def calibrate_laser_plane(
    views: Sequence[BoardView], lens: Lens, poses: Float64Array, *, seed: int = 0
) -> LaserPlane:
    """Lay the plane through the laser's peaks on boards of known pose.

    Args:
        views: Views of boards; those without laser peaks are passed over.
        lens: The lens.
        poses: `optical_from_board` of each view [m], shape (V, 4, 4).
        seed: Of the random samples.

    Returns:
        The plane; its inliers in the order of the views' peaks.

    Raises:
        InputError: Too few peaks, no plane through half of them, or peaks of a single line in
            space, because all boards stood in the same plane.
    """
    points = [
        on_board(lens, pose, view.laser_pixels) for view, pose in zip(views, poses, strict=True)
    ]
    return fit_plane(np.concatenate([np.empty((0, 3)), *points]), lens.fx, seed=seed)


def fit_plane(points: Float64Array, focal_px: float, *, seed: int = 0) -> LaserPlane:
    """Robust plane through points whose error grows with their distance from the camera.

    RANSAC finds the points that agree, total least squares with weight 1 / distance^2 lays the
    plane through them, and points beyond three robust standard deviations leave.

    Args:
        points: Points [m], shape (N, 3), optical frame; rows with NaN belong to no plane.
        focal_px: Focal length [px], which turns distances into pixels.
        seed: Of the random samples.

    Raises:
        InputError: See `calibrate_laser_plane`.
    """
    finite = np.isfinite(points).all(axis=1)
    if finite.sum() < MIN_POINTS:
        raise InputError(
            f"{int(finite.sum())} laser peaks on the boards, at least {MIN_POINTS} are needed: "
            "let the line cross the board between its outer corners, and check the laser's colour "
            "model and exposure"
        )
    usable = points[finite]
    pixel_m = np.linalg.norm(usable, axis=1) / focal_px
    agree = _ransac(usable, pixel_m, np.random.default_rng(seed))
    if agree.mean() < 0.5:
        raise InputError(
            f"only {100 * agree.mean():.0f} % of the laser peaks lie in one plane: the board or "
            "the laser moved between frames, or the line finder follows something else"
        )
    for _ in range(TRIMS):
        normal, distance = _weighted_plane(usable[agree], pixel_m[agree])
        error_px = np.abs(usable @ normal - distance) / pixel_m
        spread = 1.4826 * float(np.median(error_px[agree]))
        agree = error_px <= min(INLIER_PX, max(3 * spread, 1e-6))

    normal, distance = _weighted_plane(usable[agree], pixel_m[agree])
    inliers = np.zeros(len(points), bool)
    inliers[np.flatnonzero(finite)[agree]] = True
    residual = usable[agree] @ normal - distance
    reach = np.linalg.norm(usable[agree], axis=1)
    return LaserPlane(
        normal=normal,
        distance=distance,
        inliers=inliers,
        rms_m=float(np.sqrt(np.mean(residual**2))),
        nearest_m=float(reach.min()),
        farthest_m=float(reach.max()),
    )


def _ransac(
    points: Float64Array, pixel_m: Float64Array, rng: np.random.Generator
) -> npt.NDArray[np.bool_]:
    """The points within `INLIER_PX` of the best of many planes through three points."""
    best = np.zeros(len(points), bool)
    for _ in range(TRIALS):
        a, b, c = points[rng.choice(len(points), 3, replace=False)]
        normal = np.cross(b - a, c - a)
        length = float(np.linalg.norm(normal))
        if length < 1e-12:
            continue
        agree = np.abs((points - a) @ (normal / length)) <= INLIER_PX * pixel_m
        if agree.sum() > best.sum():
            best = agree
    return best


def _weighted_plane(points: Float64Array, pixel_m: Float64Array) -> tuple[Float64Array, float]:
    weight = 1 / pixel_m
    center = np.average(points, axis=0, weights=weight**2)
    _, extents, axes = np.linalg.svd((points - center) * weight[:, None], full_matrices=False)
    across = extents[1] / math.sqrt(len(points)) * float(np.median(pixel_m))
    if across < MIN_SPREAD * float(np.linalg.norm(center)):
        raise InputError(
            "the laser lines on all boards are one line in space, which leaves the plane open: "
            "hold the board at different distances, from the nearest to the farthest"
        )
    normal = axes[2]
    distance = float(normal @ center)
    return (-normal, -distance) if distance < 0 else (normal, distance)
