"""From laser peaks to points: the ray of a pixel meets the laser plane, the motor turns it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthwarp.cloud import PointCloud
from depthwarp.errors import InputError
from depthwarp.scanner.geometry import ScannerGeometry
from depthwarp.scanner.lens import undistort
from depthwarp.scanner.uncertainty import GeometryCovariance

__all__ = ["LaserPoints", "TriangulationCounts", "triangulate"]

Float64Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class TriangulationCounts:
    """What became of the peaks; the parts add up to the total.

    Attributes:
        total: Peaks given.
        outside_lens: Not finite, or where the lens has no ray.
        behind: The ray meets the laser plane behind the camera or never: beyond infinity.
        too_far: Farther than the geometry's `max_range`.
        kept: Points returned.
    """

    total: int
    outside_lens: int
    behind: int
    too_far: int
    kept: int


@dataclass(frozen=True, eq=False)
class LaserPoints:
    """Points on the laser line, one row for each peak that was kept.

    Attributes:
        points_world: World frame [m], shape (N, 3): the head frame turned by the motor's angle.
        range_m: Distance from the camera's centre [m], shape (N,).
        sigma_m: Standard deviation of that range along its ray [m], shape (N,).
        rows: Row of the peak [px], shape (N,).
        angle_deg: Motor angle [degrees], shape (N,).
        index: Which of the given peaks it was, shape (N,), ascending.
        counts: What became of the peaks.
    """

    points_world: Float64Array
    range_m: Float64Array
    sigma_m: Float64Array
    rows: Float64Array
    angle_deg: Float64Array
    index: npt.NDArray[np.int64]
    counts: TriangulationCounts

    def to_cloud(self) -> PointCloud:
        """The points with `sigma` [m], `range` [m], `row` [px] and `angle` [degrees], float32."""
        attributes = {
            "sigma": self.sigma_m,
            "range": self.range_m,
            "row": self.rows,
            "angle": self.angle_deg,
        }
        return PointCloud(
            self.points_world.astype(np.float32),
            {name: values.astype(np.float32) for name, values in attributes.items()},
        )


def triangulate(
    geometry: ScannerGeometry,
    rows: npt.ArrayLike,
    columns: npt.ArrayLike,
    sigma_px: npt.ArrayLike,
    angle_deg: npt.ArrayLike,
    covariance: GeometryCovariance | None = None,
) -> LaserPoints:
    """Turn the laser peaks of one frame or of many into world points.

    The undistorted ray x = (x', y', 1) meets the plane n . X = d at X = d / (n . x) x.

    Args:
        geometry: The calibrated scanner.
        rows: Rows of the peaks [px], shape (N,).
        columns: Columns of the peaks [px], shape (N,).
        sigma_px: Standard deviation of the columns [px], a number or shape (N,).
        angle_deg: Motor angle [degrees] as reported, a number or, for many frames, shape (N,).
        covariance: How well the geometry is known; taken as exact when None.

    Raises:
        InputError: Shapes that do not fit, or an angle or a sigma that is not finite.
    """
    row, column, sigma, angle = _same_length(rows, columns, sigma_px, angle_deg)
    rays = undistort(geometry.lens, np.column_stack([column, row]))
    in_lens = np.isfinite(rays).all(axis=1)

    straight = np.column_stack([rays, np.ones(len(rays))])
    with np.errstate(divide="ignore"):
        depth = geometry.plane_distance / (straight @ np.asarray(geometry.plane_normal))
    reach = depth * np.linalg.norm(straight, axis=1)
    ahead = in_lens & (depth > 0) & np.isfinite(depth)
    near = ahead & (reach <= geometry.max_range)
    index = np.flatnonzero(near)

    points_optical = depth[index, None] * straight[index]
    to_head = geometry.head_from_optical
    points_head = points_optical @ to_head[:3, :3].T + to_head[:3, 3]
    known = covariance or GeometryCovariance.from_sigmas({})
    return LaserPoints(
        points_world=_turned(points_head, angle[index]),
        range_m=reach[index],
        sigma_m=known.range_sigma(geometry, rays[index], sigma[index]),
        rows=row[index],
        angle_deg=angle[index],
        index=index,
        counts=TriangulationCounts(
            total=len(row),
            outside_lens=int((~in_lens).sum()),
            behind=int((in_lens & ~ahead).sum()),
            too_far=int((ahead & ~near).sum()),
            kept=len(index),
        ),
    )


def _turned(points_head: Float64Array, angle_deg: Float64Array) -> Float64Array:
    """`Rz(angle) p` for each point with its own angle."""
    cos, sin = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    x, y, z = points_head.T
    return np.column_stack([cos * x - sin * y, sin * x + cos * y, z])


def _same_length(
    rows: npt.ArrayLike, columns: npt.ArrayLike, sigma_px: npt.ArrayLike, angle_deg: npt.ArrayLike
) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """The four as arrays of one length, single numbers spread over it."""
    row = np.asarray(rows, np.float64)
    if row.ndim != 1:
        raise InputError(f"rows must have shape (N,), got {row.shape}")
    column = np.asarray(columns, np.float64)
    if column.shape != row.shape:
        raise InputError(f"columns must have the shape of rows, {row.shape}, got {column.shape}")
    spread = []
    for name, values in (("sigma_px", sigma_px), ("angle_deg", angle_deg)):
        array = np.asarray(values, np.float64)
        if array.shape not in ((), row.shape):
            raise InputError(
                f"{name} must be a number or have shape {row.shape}, got {array.shape}"
            )
        if not np.isfinite(array).all():
            raise InputError(f"{name} must be finite")
        spread.append(np.broadcast_to(array, row.shape))
    if (spread[0] < 0).any():
        raise InputError("sigma_px must be at least 0")
    return row, column, spread[0], spread[1]
