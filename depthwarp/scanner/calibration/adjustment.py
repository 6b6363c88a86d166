"""The joint adjustment: lens, board places, turning axis and laser plane in one least squares.

Every corner and every laser peak of every view is used once. A view's board pose follows from the
place where the board stood and from the motor's angle, so that the known angles also hold the
lens. Peaks are weighed against corners by what each group turns out to scatter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from depthwarp.scanner.calibration.laser_plane import LaserPlane
from depthwarp.scanner.calibration.least_squares import (
    Block,
    Solution,
    shared_error_covariance,
    solve,
)
from depthwarp.scanner.calibration.scanner_model import AXIS, LENS, PLANE, ScannerModel, first_guess
from depthwarp.scanner.calibration.view_residuals import (
    ViewPeaks,
    corner_error,
    shared_corner_errors,
)
from depthwarp.scanner.calibration.views import BoardView
from depthwarp.scanner.geometry import Lens, ScannerGeometry, TurningAxis
from depthwarp.scanner.uncertainty import PARAMETERS, GeometryCovariance

__all__ = ["Adjustment", "adjust"]

Float64Array = npt.NDArray[np.float64]


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
    model = ScannerModel(ScannerGeometry(lens, normal, plane.distance, axis, max_range))
    start, place_index, turned = first_guess(model, views, poses)
    free = np.ones(len(start), bool)
    free[LENS] = not lens_is_exact
    free[8] &= lens.distortion[4] != 0.0

    peaks = [ViewPeaks.of(view, lens, plane, pose) for view, pose in zip(views, poses, strict=True)]
    scatter = (0.1, 1.0)  # of corners [px], of laser peaks [their own sigma]
    solution = solve(_blocks(model, views, place_index, turned, peaks, scatter), start, free)
    # Solved once more, now that it is known what corners and laser peaks scatter.
    scatter = _scatter(solution, len(views), scatter, free)
    blocks = _blocks(model, views, place_index, turned, peaks, scatter)
    solution = solve(blocks, solution.parameters, free)
    shared = [shared_corner_errors(view) / scatter[0] for view in views]
    added = shared_error_covariance(blocks[: len(views)], shared, solution, free)
    solution = replace(solution, covariance=solution.covariance + added)
    return _result(model, views, place_index, turned, peaks, solution)


def _blocks(
    model: ScannerModel,
    views: Sequence[BoardView],
    place_index: Sequence[npt.NDArray[np.intp]],
    turned: Sequence[float],
    peaks: Sequence[ViewPeaks],
    scatter: tuple[float, float],
) -> list[Block]:
    """One block of corners for each view, then one of laser peaks for each view."""

    def corner_block(view: BoardView, place: npt.NDArray[np.intp], turn: float) -> Block:
        def residual(values: Float64Array) -> Float64Array:
            pose = model.pose(values[9:13], values[13:], turn)
            return corner_error(model.lens(values[:9]), pose, view) / scatter[0]

        return Block(residual, np.concatenate([LENS, AXIS, place]))

    def laser_block(peak: ViewPeaks, place: npt.NDArray[np.intp], turn: float) -> Block:
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
    model: ScannerModel,
    views: Sequence[BoardView],
    place_index: Sequence[npt.NDArray[np.intp]],
    turned: Sequence[float],
    peaks: Sequence[ViewPeaks],
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
        corner_error(geometry.lens, pose, view) for view, pose in zip(views, poses, strict=True)
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
