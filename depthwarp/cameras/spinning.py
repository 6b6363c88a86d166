"""A spinning LiDAR of many beams: one row a beam, one column a moment of the turn."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.camera import Camera, DepthKind, DeviceLens
from depthwarp.cameras.motion import poses_between
from depthwarp.cameras.pose import OPTICAL_FROM_CAMERA, Pose, check_pose
from depthwarp.checks import check_finite_vector, check_size
from depthwarp.errors import InputError

__all__ = ["SpinningLidar"]

Float64Array = npt.NDArray[np.float64]

MOST_OFFSET = 30.0
"""Greatest azimuth offset of a beam [degrees]: real sensors stay below 10."""

MOVING_STEPS, STEEPEST = 5, 0.5
"""How the column is found in which a moving sensor meets a point, as in the kernel."""


@dataclass(frozen=True)
class SpinningLidar(Camera):
    """A LiDAR whose beams turn clockwise, seen from above, about the camera's Z axis.

    A point belongs to the row of the beam that is nearest in elevation and to the column in which
    that beam meets it; elevations farther outside the outermost beams than half their distance to
    the next one are outside the domain. Depth is the range that the sensor reports. Source of the
    beams' geometry: Ouster's sensor manual (origin offset, azimuth offsets); to the first order in
    the offsets, which for real sensors is exact to 0.1 mm.

    Attributes:
        width: Columns of a full turn.
        beam_elevations: Elevation of each row's beam [degrees], in any order, all different.
        pose: Where the sensor stands and looks; if it moves, at the moment of column 0.
        azimuth_zero: Column of azimuth 0, along the camera's X axis [px]; the middle when None.
        beam_azimuths: Azimuth of each beam less that of the head, leftwards [degrees]; zeros when
            None, as for range images that were already set straight ("destaggered").
        origin_offset: Distance of the beams' origins from the axis [m].
        pose_end: If the sensor moves: its pose one full turn after `pose`, moving evenly (position
            linear, rotation about a fixed axis). Every column then has its own pose (rolling
            shutter). `project` and `unproject` are each other's inverse, to 0.01 px up to 2 m and
            60 degrees a turn for points farther than 2 m, but at the seam: a sensor that turns on
            with its spin sees a part of the world twice, of which `project` gives one column; of
            one that turns against it a part is never seen, and not drawn. None: it stands still.

    Raises:
        InputError: Fewer than two beams, equal ones, numbers that are not finite or out of range.

    Example:
        >>> import numpy as np, depthwarp as dw
        >>> pose = dw.Pose.from_orientation((0, 0, 1.8), (0, 0, 0))
        >>> lidar = dw.SpinningLidar(1024, tuple(np.linspace(15, -25, 64)), pose)
        >>> lidar.size
        (1024, 64)
    """

    width: int
    beam_elevations: tuple[float, ...]
    pose: Pose
    azimuth_zero: float | None = None
    beam_azimuths: tuple[float, ...] | None = None
    origin_offset: float = 0.0
    pose_end: Pose | None = None

    depth_kinds: ClassVar[tuple[DepthKind, ...]] = ("range",)
    ahead_only: ClassVar[bool] = False

    def __post_init__(self) -> None:
        beams = np.ravel(np.asarray(self.beam_elevations, dtype=np.float64))
        if beams.size < 2:
            raise InputError(f"beam_elevations must be at least two angles, got {beams.size}")
        elevations = check_finite_vector("beam_elevations", beams.tolist(), beams.size)
        if min(elevations) <= -90 or max(elevations) >= 90:
            raise InputError("beam_elevations must be above -90 and below 90 degrees")
        if len(set(elevations)) < len(elevations):
            raise InputError("beam_elevations must all be different: a row is one beam")
        check_pose("pose", self.pose)
        if self.pose_end is not None:
            check_pose("pose_end", self.pose_end)
        width, _ = check_size((self.width, beams.size))
        if width < 2:
            raise InputError(f"width must be at least 2 columns a turn, got {width}")
        object.__setattr__(self, "width", width)
        object.__setattr__(self, "beam_elevations", elevations)
        if self.azimuth_zero is not None:
            check_finite_vector("azimuth_zero", (self.azimuth_zero,), 1)
        if self.beam_azimuths is not None:
            object.__setattr__(self, "beam_azimuths", self._checked_azimuths(self.beam_azimuths))
        if not (math.isfinite(self.origin_offset) and self.origin_offset >= 0):
            raise InputError(
                f"origin_offset must be a finite number from 0 metres, got {self.origin_offset}"
            )

    def with_pose(self, pose: Pose) -> SpinningLidar:
        """The same sensor at another place; if it moves, it moves in the same way from there.

        Raises:
            InputError: Not a `Pose`.
        """
        check_pose("pose", pose)
        if self.pose_end is None:
            return dataclasses.replace(self, pose=pose)
        start, end = self.pose, self.pose_end
        turn = end.rotation @ np.linalg.inv(start.rotation)
        way = start.rotation @ (end.center_world - start.center_world)
        moved = np.eye(4)
        moved[:3, :3] = OPTICAL_FROM_CAMERA @ turn @ pose.rotation
        moved[:3, 3] = -moved[:3, :3] @ (pose.center_world + pose.rotation.T @ way)
        return dataclasses.replace(self, pose=pose, pose_end=Pose.from_optical(moved))

    @property
    def height(self) -> int:  # type: ignore[override]
        """Rows: one a beam."""
        return len(self.beam_elevations)

    @property
    def wraps(self) -> bool:
        """A full turn, always."""
        return True

    @property
    def fx(self) -> float:
        """Columns a radian."""
        return self.width / (2 * math.pi)

    @property
    def cx(self) -> float:
        """Column of azimuth 0 of a beam without offset [px]."""
        if self.azimuth_zero is None:
            return (self.width - 1) / 2
        return float(self.azimuth_zero) % self.width

    @cached_property
    def offsets(self) -> Float64Array:
        """Azimuth offset of each row's beam [columns], shape (rows,)."""
        degrees = np.zeros(self.height) if self.beam_azimuths is None else self.beam_azimuths
        return np.radians(np.asarray(degrees, dtype=np.float64)) * self.fx

    @cached_property
    def order(self) -> npt.NDArray[np.int64]:
        """Rows by descending elevation, shape (rows,)."""
        return np.argsort(-np.asarray(self.beam_elevations), kind="stable")

    @cached_property
    def limits(self) -> Float64Array:
        """Tangents of the elevations between the beams, descending, shape (rows + 1,)."""
        angles = np.asarray(self.beam_elevations)[self.order]
        between = 0.5 * (angles[1:] + angles[:-1])
        first, last = 2 * angles[0] - between[0], 2 * angles[-1] - between[-1]
        return np.asarray(np.tan(np.radians(np.clip([first, *between, last], -89.999, 89.999))))

    @cached_property
    def column_poses(self) -> tuple[Float64Array, Float64Array]:
        """Rotations camera_from_world (columns, 3, 3) and centres in the world (columns, 3) [m]."""
        end = self.pose if self.pose_end is None else self.pose_end
        return poses_between(self.pose, end, np.arange(self.width) / self.width)

    def to_camera(self, points_world: npt.NDArray[np.floating]) -> Float64Array:
        """World points, shape (N, 3), in the frame that the sensor has when it meets them."""
        if self.pose_end is None:
            return self.pose.to_camera(points_world)
        points = points_world.astype(np.float64)
        moments = np.full(len(points), 0.5 * (self.width - 1))
        before, azimuth_before, slope = moments, np.zeros(len(points)), np.zeros(len(points))
        passed = np.zeros(len(points), dtype=bool)
        placed = self._placed(points, moments)
        for _ in range(MOVING_STEPS):
            u, _, _ = self._nearest(placed)
            met = np.isfinite(u)
            azimuth = self.fx * np.arctan2(placed[:, 1], placed[:, 0])
            moved = np.where(met & (np.abs(moments - before) >= 1), moments - before, np.nan)
            secant = self._within_half(azimuth_before - azimuth) / moved
            slope = np.where(np.isnan(moved), slope, np.clip(secant, -STEEPEST, STEEPEST))
            before, azimuth_before = moments, azimuth
            passed = np.where(met, np.abs(u - moments) > 0.5 * self.width, passed)
            step = self._within_half(u - moments) / (1 - slope)
            after = self._within_turn(moments + step, self.width / (1 - slope))
            moments = np.where(met, after, moments)
            placed = self._placed(points, moments)
        placed[passed] = np.nan
        return placed

    def _within_half(self, way: Float64Array) -> Float64Array:
        """Ways in columns, the shorter ones round the turn."""
        return np.asarray(way - self.width * np.round(way / self.width))

    def _within_turn(self, moments: Float64Array, around: Float64Array) -> Float64Array:
        """Moments of the turn: these, those a turn around them, or else those at the seam."""
        end = self.width - 0.5
        other = np.where(moments < -0.5, moments + around, moments - around)
        beyond = (moments < -0.5) | (moments >= end)
        reached = (other >= -0.5) & (other < end)
        return np.clip(np.where(beyond & reached, other, moments), 0, self.width - 1)

    def to_world(self, points_camera: Float64Array, u: Float64Array) -> Float64Array:
        """Points that the sensor met in columns u, shape (..., 3), in the world frame."""
        if self.pose_end is None:
            return self.pose.to_world(points_camera)
        rotations, centers = self.column_poses
        column = np.clip(np.floor(u + 0.5), 0, self.width - 1).astype(np.int64)
        turned = np.einsum("...ji,...j->...i", rotations[column], points_camera)
        return np.asarray(turned + centers[column])

    def image_of(self, points_camera: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Columns u and rows v of points in the sensor's frame; see `Camera.image_of`."""
        u, row, slope = self._nearest(points_camera)
        seen = (slope <= self.limits[0]) & (slope >= self.limits[-1])
        return np.where(seen, u, np.nan), np.where(seen, row, np.nan)

    def directions(self, u: npt.ArrayLike, v: npt.ArrayLike) -> Float64Array:
        """Unit vectors along the beams of pixels; see `Camera.directions`.

        A beam starts `origin_offset` from the axis, in the direction of the head.
        """
        row = np.asarray(np.floor(np.asarray(v, dtype=np.float64) + 0.5), dtype=np.int64)
        elevation = np.radians(np.asarray(self.beam_elevations))[row]
        azimuth = (self.cx + self.offsets[row] - np.asarray(u, dtype=np.float64)) / self.fx
        azimuth, elevation = np.broadcast_arrays(azimuth, elevation)
        level = np.cos(elevation)
        return np.stack(
            [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1
        )

    def depth_of(self, points_camera: Float64Array, kind: DepthKind) -> Float64Array:
        """What the sensor reports: the way along the beam, and its origin's from the axis [m]."""
        level = np.hypot(points_camera[..., 0], points_camera[..., 1])
        way = level - self.origin_offset
        return np.asarray(np.hypot(way, points_camera[..., 2]) + self.origin_offset)

    def points_of(
        self, u: Float64Array, v: Float64Array, depth: Float64Array, kind: DepthKind
    ) -> Float64Array:
        """Points that pixels report at a depth, in the sensor's frame; see `Camera.points_of`."""
        row = np.asarray(np.floor(v + 0.5), dtype=np.int64)
        elevation = np.radians(np.asarray(self.beam_elevations))[row]
        way = np.where(depth > self.origin_offset, depth - self.origin_offset, np.nan)
        level = way * np.cos(elevation) + self.origin_offset
        offset = self.offsets[row]
        offset = offset - offset * (self.origin_offset / level)
        azimuth = (self.cx + offset - u) / self.fx
        return np.stack(
            [level * np.cos(azimuth), level * np.sin(azimuth), way * np.sin(elevation)], axis=-1
        )

    def device_lens(self, first: int = 0) -> DeviceLens:
        """The lens as kernels take it; see `Camera.device_lens`."""
        from depthwarp_kernels import lens_spinning

        numbers: Any = lens_spinning.SpinningLens()
        numbers.fx, numbers.cx, numbers.period = self.fx, self.cx, self.width
        numbers.rows, numbers.origin_offset, numbers.first = (
            self.height,
            self.origin_offset,
            first,
        )
        parts = [self.limits, self.order.astype(np.float64), self.offsets[self.order]]
        if self.pose_end is None:
            return DeviceLens(lens_spinning.SPINNING, numbers, _table(parts))
        rotations, centers = self.column_poses
        poses = np.concatenate([rotations.reshape(-1, 9), centers], axis=1)
        return DeviceLens(lens_spinning.MOVING, numbers, _table([*parts, poses.ravel()]))

    def _nearest(
        self, points_camera: Float64Array
    ) -> tuple[Float64Array, npt.NDArray[np.int64], Float64Array]:
        """Column and row of the beam nearest to each point, and the tangent of its elevation."""
        x, y, z = np.moveaxis(points_camera, -1, 0)
        level = np.hypot(x, y)
        way = np.where(level > self.origin_offset, level - self.origin_offset, np.nan)
        slope = z / way
        below = np.searchsorted(-self.limits, -slope, side="right")
        row = self.order[np.clip(below - 1, 0, self.height - 1)]
        offset = self.offsets[row]
        offset = offset - offset * (self.origin_offset / level)
        u = self.cx - (self.fx * np.arctan2(y, x) - offset)
        u = np.where(u < -0.5, u + self.width, u)
        u = np.where(u >= self.width - 0.5, u - self.width, u)
        return np.where(np.isnan(slope), np.nan, u), row, slope

    def _placed(self, points_world: Float64Array, moments: Float64Array) -> Float64Array:
        """Each point in the frame of its own moment, counted in columns."""
        rotations, centers = self.column_poses
        column = np.minimum(moments.astype(np.int64), self.width - 2)
        part = (moments - column)[:, None]
        center = centers[column] + part * (centers[column + 1] - centers[column])
        turn = rotations[column + 1] - rotations[column]
        rotation = rotations[column] + part[:, None] * turn
        return np.asarray(np.einsum("nij,nj->ni", rotation, points_world - center))

    def _checked_azimuths(self, azimuths: Sequence[float]) -> tuple[float, ...]:
        checked = check_finite_vector("beam_azimuths", azimuths, self.height)
        if max(map(abs, checked)) > MOST_OFFSET:
            raise InputError(
                f"beam_azimuths must be within {MOST_OFFSET:g} degrees of the head, got "
                f"{max(checked, key=abs)}"
            )
        return checked


def _table(parts: Sequence[Float64Array]) -> npt.NDArray[np.float32]:
    return np.concatenate(parts).astype(np.float32)
