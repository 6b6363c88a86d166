"""The joint adjustment: lens, board places, turning axis and laser plane in one least squares.

Every corner and every laser peak of every view is used once. A view's board pose follows from the
place where the board stood and from the motor's angle, so that the known angles also hold the
lens. Peaks are weighed against corners by what each group turns out to scatter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from depthwarp.scanner.calibration.laser_plane import LaserPlane
from depthwarp.scanner.calibration.least_squares import (
    Block,
    Solution,
    shared_error_covariance,
    solve,
)
from depthwarp.scanner.calibration.turning_axis import head_turned
from depthwarp.scanner.calibration.views import BoardView, on_board, pose_matrix, rays_on_board
from depthwarp.scanner.geometry import Lens, ScannerGeometry, TurningAxis
from depthwarp.scanner.lens import undistort
from depthwarp.scanner.uncertainty import (
    LENS_PARAMETERS,
    PARAMETERS,
    GeometryCovariance,
    tangents,
)

__all__ = ["Adjustment", "adjust"]

Float64Array = npt.NDArray[np.float64]

LENS = np.arange(len(LENS_PARAMETERS))
PLANE = np.arange(9, 12)
AXIS = np.arange(12, 16)
MAX_PEAKS = 200
"""Peaks used of each view, evenly spread: the errors of neighbouring rows are not independent."""


SHARED_CORNER_PX = 0.01
"""Error that the corners of a view have in common: one standard deviation of a shift, and of the
root mean square of each linear stretch or shear, in u and in v alike. Measured on the boards of
the twin; noise averages out over a view's corners and would promise less."""


@dataclass(frozen=True, eq=False)
class Adjustment:
    """Result of the joint adjustment.

    Attributes:
        geometry: Lens, plane and axis.
        covariance: How well they are known.
        corner_rms_px: Root mean square of the corners' residuals, one coordinate [px].
        laser_rms_px: Root mean square of the laser peaks' residuals across the line [px].
        laser_rms_m: Root mean square distance of the laser points from the plane [m].
        view_rms_px: Corner residuals of each view [px], shape (V,).
        poses: `optical_from_board` of each view [m], shape (V, 4, 4).
    """

    geometry: ScannerGeometry
    covariance: GeometryCovariance
    corner_rms_px: float
    laser_rms_px: float
    laser_rms_m: float
    view_rms_px: Float64Array
    poses: Float64Array


@dataclass(frozen=True, eq=False)
class _Model:
    """From the parameter vector to geometry; the turning parameters start at 0.

    The vector holds lens (9), plane (toe-in, roll, distance), axis (pitch, roll, forward,
    sideways), then rotation vector and translation for each place where the board stood, as seen
    from the first view of it.
    """

    start: ScannerGeometry

    @cached_property
    def _plane_tangents(self) -> Float64Array:
        return tangents(self.start.plane_normal)

    @cached_property
    def _axis_tangents(self) -> Float64Array:
        return tangents(self.start.axis.direction)

    def lens(self, values: Float64Array) -> Lens:
        fx, fy, cx, cy, k1, k2, p1, p2, k3 = values.tolist()
        return Lens(fx, fy, cx, cy, self.start.lens.size, (k1, k2, p1, p2, k3))

    def plane(self, values: Float64Array) -> tuple[Float64Array, float]:
        normal = np.asarray(self.start.plane_normal) + values[:2] @ self._plane_tangents
        return normal / np.linalg.norm(normal), float(values[2])

    def axis(self, values: Float64Array) -> tuple[Float64Array, Float64Array]:
        start = self.start.axis
        direction = np.asarray(start.direction) + values[:2] @ self._axis_tangents
        point = np.asarray(start.point) + values[2:] @ self._axis_tangents
        return direction / np.linalg.norm(direction), point

    def pose(self, axis: Float64Array, place: Float64Array, turned_deg: float) -> Float64Array:
        return head_turned(*self.axis(axis), turned_deg) @ pose_matrix(place[:3], place[3:])

    def geometry(self, parameters: Float64Array) -> ScannerGeometry:
        normal, distance = self.plane(parameters[PLANE])
        direction, point = self.axis(parameters[AXIS])
        nearest = point - (point @ direction) * direction
        return replace(
            self.start,
            lens=self.lens(parameters[LENS]),
            plane_normal=tuple(normal.tolist()),
            plane_distance=distance,
            axis=TurningAxis(tuple(direction.tolist()), tuple(nearest.tolist())),
        )


class _Peaks:
    """The laser peaks of a view; their rays are computed anew only when the lens has moved."""

    def __init__(self, pixels: Float64Array, sigma_px: float, metres_a_pixel: Float64Array) -> None:
        self.pixels, self.sigma_px, self.metres_a_pixel = pixels, sigma_px, metres_a_pixel
        self._lens: Lens | None = None
        self._rays = pixels

    @classmethod
    def of(cls, view: BoardView, lens: Lens, plane: LaserPlane, pose: Float64Array) -> _Peaks:
        """A view's peaks, with how far each leaves the plane when it moves by one column [m]."""
        count = len(view.laser_pixels)
        spread = np.unique(np.linspace(0, count - 1, min(count, MAX_PEAKS)).astype(int))
        pixels = view.laser_pixels[spread]
        half = np.array([0.5, 0.0])
        moved = on_board(lens, pose, pixels + half) - on_board(lens, pose, pixels - half)
        return cls(pixels, view.laser_sigma_px, np.abs(moved @ plane.normal))

    def error_m(
        self, lens: Lens, pose: Float64Array, plane: tuple[Float64Array, float]
    ) -> Float64Array:
        """Distance of the laser points on the board from the plane [m]."""
        if lens != self._lens:
            self._lens, self._rays = lens, undistort(lens, self.pixels)
        normal, distance = plane
        return rays_on_board(self._rays, pose) @ normal - distance


def adjust(
    views: Sequence[BoardView],
    poses: Float64Array,
    lens: Lens,
    plane: LaserPlane,
    axis: TurningAxis,
    *,
    max_range: float = 15.0,
    lens_is_exact: bool = False,
) -> Adjustment:
    """Refine everything together.

    Args:
        views: All views; laser peaks that belong to no plane must have been taken out.
        poses: First guess of `optical_from_board` of each view [m], shape (V, 4, 4).
        lens: First guess; a k3 of 0 stays 0.
        plane: First guess.
        axis: First guess.
        max_range: Range limit of the scanner [m].
        lens_is_exact: Hold the lens, as for views that are too few to calibrate it.

    Raises:
        InputError: The views do not determine the parameters.
    """
    normal = tuple(plane.normal.tolist())
    model = _Model(ScannerGeometry(lens, normal, plane.distance, axis, max_range))
    start, place_index, turned = _first_guess(model, views, poses)
    free = np.ones(len(start), bool)
    free[LENS] = not lens_is_exact
    free[8] &= lens.distortion[4] != 0.0

    peaks = [_Peaks.of(view, lens, plane, pose) for view, pose in zip(views, poses, strict=True)]
    scatter = (0.1, 1.0)  # of corners [px], of laser peaks [their own sigma]
    solution = solve(_blocks(model, views, place_index, turned, peaks, scatter), start, free)
    # Solved once more, now that it is known what corners and laser peaks scatter.
    scatter = _scatter(solution, len(views), scatter, free)
    blocks = _blocks(model, views, place_index, turned, peaks, scatter)
    solution = solve(blocks, solution.parameters, free)
    shared = [_shared_corner_errors(view) / scatter[0] for view in views]
    added = shared_error_covariance(blocks[: len(views)], shared, solution, free)
    solution = replace(solution, covariance=solution.covariance + added)
    return _result(model, views, place_index, turned, peaks, solution)


def _first_guess(
    model: _Model, views: Sequence[BoardView], poses: Float64Array
) -> tuple[Float64Array, list[npt.NDArray[np.intp]], list[float]]:
    """The parameter vector, where each view's place stands in it, and its turn from there.

    A place starts from that view of it whose pose explains the others best: the tilt of a far
    board may come out mirrored in some of them.
    """
    lens = model.start.lens
    values = [lens.fx, lens.fy, lens.cx, lens.cy, *lens.distortion]
    values += [0.0, 0.0, model.start.plane_distance, 0.0, 0.0, 0.0, 0.0]
    index: list[npt.NDArray[np.intp]] = [np.empty(0, np.intp)] * len(views)
    turned = [0.0] * len(views)
    for slot, placement in enumerate(dict.fromkeys(view.placement for view in views)):
        members = [number for number, view in enumerate(views) if view.placement == placement]
        for number in members:
            index[number] = len(PARAMETERS) + 6 * slot + np.arange(6)
            turned[number] = views[number].angle_deg - views[members[0]].angle_deg
        pose = _best_place(model, views, poses, members, turned)
        values += [*np.ravel(cv2.Rodrigues(pose[:3, :3])[0]).tolist(), *pose[:3, 3].tolist()]
    return np.array(values), index, turned


def _best_place(
    model: _Model,
    views: Sequence[BoardView],
    poses: Float64Array,
    members: Sequence[int],
    turned: Sequence[float],
) -> Float64Array:
    """Where the board of a placement stands in its first view, from the best of its views."""
    axis = np.array(model.start.axis.direction), np.array(model.start.axis.point)
    moves = {number: head_turned(*axis, turned[number]) for number in members}
    places = [np.linalg.inv(moves[number]) @ poses[number] for number in members]

    def misfit(place: Float64Array) -> float:
        errors = (_corner_error(model.start.lens, moves[n] @ place, views[n]) for n in members)
        return float(sum(error @ error for error in errors))

    return min(places, key=misfit)


def _blocks(
    model: _Model,
    views: Sequence[BoardView],
    place_index: Sequence[npt.NDArray[np.intp]],
    turned: Sequence[float],
    peaks: Sequence[_Peaks],
    scatter: tuple[float, float],
) -> list[Block]:
    """One block of corners for each view, then one of laser peaks for each view."""

    def corner_block(view: BoardView, place: npt.NDArray[np.intp], turn: float) -> Block:
        def residual(values: Float64Array) -> Float64Array:
            pose = model.pose(values[9:13], values[13:], turn)
            return _corner_error(model.lens(values[:9]), pose, view) / scatter[0]

        return Block(residual, np.concatenate([LENS, AXIS, place]))

    def laser_block(peak: _Peaks, place: npt.NDArray[np.intp], turn: float) -> Block:
        def residual(values: Float64Array) -> Float64Array:
            pose = model.pose(values[12:16], values[16:], turn)
            lens, plane = model.lens(values[:9]), model.plane(values[9:12])
            error_px = peak.error_m(lens, pose, plane) / peak.metres_a_pixel
            return error_px / (scatter[1] * peak.sigma_px)

        return Block(residual, np.concatenate([LENS, PLANE, AXIS, place]))

    corners = [corner_block(*each) for each in zip(views, place_index, turned, strict=True)]
    return corners + [
        laser_block(*each)
        for each in zip(peaks, place_index, turned, strict=True)
        if len(each[0].pixels)
    ]


def _corner_error(lens: Lens, pose: Float64Array, view: BoardView) -> Float64Array:
    """Seen less computed corners [px], u and v in turn."""
    turn, _ = cv2.Rodrigues(pose[:3, :3])
    points = view.corners.points_board
    computed, _ = cv2.projectPoints(points, turn, pose[:3, 3], lens.K, np.array(lens.distortion))
    return np.ravel(np.asarray(computed, np.float64)[:, 0] - view.corners.pixels)


def _shared_corner_errors(view: BoardView) -> Float64Array:
    """Errors that a view's corners have in common, one a column [px], shape (2 N, 6)."""
    pixels = view.corners.pixels
    offset = pixels - pixels.mean(axis=0)
    offset /= np.sqrt(np.mean(offset**2, axis=0))
    shapes = np.column_stack([np.ones(len(pixels)), offset])
    return np.asarray(SHARED_CORNER_PX * np.kron(shapes, np.eye(2)), np.float64)


def _scatter(
    solution: Solution,
    view_count: int,
    scatter: tuple[float, float],
    free: npt.NDArray[np.bool_],
) -> tuple[float, float]:
    """What corners and laser peaks scatter, each group given its share of the redundancy."""
    total = solution.redundancy + int(free.sum())
    groups = solution.residuals[:view_count], solution.residuals[view_count:]
    corner, laser = (
        np.sqrt(np.mean(np.concatenate(group) ** 2) * total / max(solution.redundancy, 1))
        for group in groups
    )
    # Exact measurements leave nothing: keep the weights finite.
    return max(float(corner) * scatter[0], 1e-6), max(float(laser) * scatter[1], 1e-6)


def _result(
    model: _Model,
    views: Sequence[BoardView],
    place_index: Sequence[npt.NDArray[np.intp]],
    turned: Sequence[float],
    peaks: Sequence[_Peaks],
    solution: Solution,
) -> Adjustment:
    parameters = solution.parameters
    geometry = model.geometry(parameters)
    plane = np.asarray(geometry.plane_normal), geometry.plane_distance
    poses = np.stack(
        [
            model.pose(parameters[AXIS], parameters[place], turn)
            for place, turn in zip(place_index, turned, strict=True)
        ]
    )
    corner = [
        _corner_error(geometry.lens, pose, view) for view, pose in zip(views, poses, strict=True)
    ]
    laser = [
        peak.error_m(geometry.lens, pose, plane) for peak, pose in zip(peaks, poses, strict=True)
    ]
    count = len(PARAMETERS)
    return Adjustment(
        geometry=geometry,
        covariance=GeometryCovariance(solution.covariance[:count, :count]),
        corner_rms_px=_rms(np.concatenate(corner)),
        laser_rms_px=_rms(
            np.concatenate(laser) / np.concatenate([p.metres_a_pixel for p in peaks])
        ),
        laser_rms_m=_rms(np.concatenate(laser)),
        view_rms_px=np.array([_rms(error) for error in corner]),
        poses=poses,
    )


def _rms(values: Float64Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
