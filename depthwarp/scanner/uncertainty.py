"""How well the scanner's geometry is known, and what that does to a measured range."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError
from depthwarp.scanner.geometry import ScannerGeometry
from depthwarp.scanner.lens import distort, distortion_jacobian

__all__ = ["LENS_PARAMETERS", "PARAMETERS", "GeometryCovariance", "range_gradient", "tangents"]

Float64Array = npt.NDArray[np.float64]

LENS_PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
"""Parameters of the lens, in the order of every matrix here; the first four in px."""

PARAMETERS = (
    *LENS_PARAMETERS,
    "plane_toe_in",  # rad, plane_normal turned towards the viewing direction
    "plane_roll",  # rad, plane_normal turned across it
    "plane_distance",  # m
    "axis_pitch",  # rad, axis.direction turned towards the viewing direction
    "axis_roll",  # rad, axis.direction turned across it
    "axis_forward",  # m, axis moved along its first tangent
    "axis_sideways",  # m, axis moved along its second tangent
)
"""Parameters of the geometry in the order of a covariance; see `tangents` for the directions."""

RANGE_PARAMETERS = 12
"""The first parameters are those that a range along its ray depends on: lens and plane."""


def tangents(direction: npt.ArrayLike) -> Float64Array:
    """The two unit vectors along which a unit vector is turned, shape (2, 3).

    The first points towards the camera's viewing direction Z as far as it can, the second is
    `direction` x first. For the laser plane's normal they mean toe-in and roll.
    """
    unit = np.asarray(direction, np.float64)
    target = np.array([0.0, 0.0, 1.0]) if abs(unit[2]) < 0.999 else np.array([1.0, 0.0, 0.0])
    first = target - (target @ unit) * unit
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(unit, first)])


@dataclass(frozen=True, eq=False)
class GeometryCovariance:
    """Covariance of a scanner's geometry, in the order and units of `PARAMETERS`.

    Attributes:
        matrix: Shape (16, 16), symmetric; zero rows for parameters taken as exact.

    Raises:
        InputError: Wrong shape, numbers that are not finite, or a negative variance.
    """

    matrix: Float64Array

    def __post_init__(self) -> None:
        matrix = np.array(self.matrix, np.float64)
        count = len(PARAMETERS)
        if matrix.shape != (count, count) or not np.isfinite(matrix).all():
            raise InputError(
                f"the covariance must be a finite {count} x {count} matrix, got {matrix.shape}"
            )
        if not np.allclose(matrix, matrix.T, rtol=1e-6, atol=0) or (np.diag(matrix) < 0).any():
            raise InputError("the covariance must be symmetric with variances of at least 0")
        object.__setattr__(self, "matrix", (matrix + matrix.T) / 2)

    @classmethod
    def from_sigmas(cls, sigmas: Mapping[str, float]) -> GeometryCovariance:
        """Independent errors by name; parameters that are not named are taken as exact.

        Raises:
            InputError: A name that is not one of `PARAMETERS`.
        """
        unknown = sorted(set(sigmas) - set(PARAMETERS))
        if unknown:
            raise InputError(
                f"unknown geometry parameters {', '.join(unknown)}; there are "
                f"{', '.join(PARAMETERS)}"
            )
        return cls(np.diag([sigmas.get(name, 0.0) ** 2 for name in PARAMETERS]))

    @property
    def sigmas(self) -> dict[str, float]:
        """Standard deviation of every parameter, by name."""
        return dict(zip(PARAMETERS, np.sqrt(np.diag(self.matrix)).tolist(), strict=True))

    def range_sigma(
        self, geometry: ScannerGeometry, rays: Float64Array, sigma_px: npt.ArrayLike = 0.0
    ) -> Float64Array:
        """Standard deviation of measured ranges along their rays [m], shape (N,).

        Args:
            geometry: The scanner that measured.
            rays: Undistorted peaks (x', y'), shape (N, 2).
            sigma_px: Standard deviation of the peaks across the line [px], a number or shape (N,).
        """
        by_column, by_geometry = range_gradient(geometry, rays)
        known = self.matrix[:RANGE_PARAMETERS, :RANGE_PARAMETERS]
        variance = np.einsum("ni,ij,nj->n", by_geometry, known, by_geometry)
        by_peak = (by_column * np.asarray(sigma_px, np.float64)) ** 2
        return np.asarray(np.sqrt(np.maximum(variance, 0.0) + by_peak))


def range_gradient(
    geometry: ScannerGeometry, rays: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """How a range r = d |x| / (n . x) moves with the peak's column and with the geometry.

    Args:
        geometry: The scanner.
        rays: Undistorted peaks (x', y'), shape (N, 2).

    Returns:
        dr / du [m/px], shape (N,), and dr / d(lens and plane), shape (N, 12), in the order of
        `PARAMETERS`, with the peak's pixel held.
    """
    lens = geometry.lens
    x = np.column_stack([rays, np.ones(len(rays))])
    length = np.linalg.norm(x, axis=1)
    normal, distance = np.asarray(geometry.plane_normal), geometry.plane_distance
    along = x @ normal
    by_ray = distance * (x / (length * along)[:, None] - (length / along**2)[:, None] * normal)

    # The pixel fixes the bent ray, so the straight one moves with the inverse of the bending.
    bending, by_coefficient = distortion_jacobian(lens, rays)
    by_bent = np.linalg.solve(np.swapaxes(bending, 1, 2), by_ray[:, :2, None])[:, :, 0]
    bent = (distort(lens, rays) - (lens.cx, lens.cy)) / (lens.fx, lens.fy)
    gradient = np.empty((len(rays), RANGE_PARAMETERS))
    gradient[:, 0] = -by_bent[:, 0] * bent[:, 0] / lens.fx
    gradient[:, 1] = -by_bent[:, 1] * bent[:, 1] / lens.fy
    gradient[:, 2] = -by_bent[:, 0] / lens.fx
    gradient[:, 3] = -by_bent[:, 1] / lens.fy
    gradient[:, 4:9] = -np.einsum("ni,nij->nj", by_bent, by_coefficient)
    by_normal = -(distance * length / along**2)[:, None] * x
    gradient[:, 9:11] = by_normal @ tangents(normal).T
    gradient[:, 11] = length / along
    return by_bent[:, 0] / lens.fx, gradient
