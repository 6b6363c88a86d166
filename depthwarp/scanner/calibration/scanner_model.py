"""The adjustment's parameters: from one vector to lens, laser plane, axis and board poses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
import numpy.typing as npt

from depthwarp.scanner.calibration.turning_axis import head_turned
from depthwarp.scanner.calibration.view_residuals import corner_error
from depthwarp.scanner.calibration.views import BoardView, pose_matrix
from depthwarp.scanner.geometry import Lens, ScannerGeometry, TurningAxis
from depthwarp.scanner.uncertainty import LENS_PARAMETERS, PARAMETERS, tangents

__all__ = ["AXIS", "LENS", "PLANE", "ScannerModel", "first_guess"]

Float64Array = npt.NDArray[np.float64]

LENS = np.arange(len(LENS_PARAMETERS))
PLANE = np.arange(9, 12)
AXIS = np.arange(12, 16)
"""Where lens, laser plane and turning axis stand in the vector, in the order of `PARAMETERS`."""


@dataclass(frozen=True, eq=False)
class ScannerModel:
    """From the parameter vector to geometry; the turning parameters start at 0.

    The vector holds lens (9), plane (toe-in, roll, distance), axis (pitch, roll, forward,
    sideways), then rotation vector and translation for each place where the board stood, as seen
    from the first view of it.

    Attributes:
        start: What plane and axis are turned and moved from, and what is not adjusted.
    """

    start: ScannerGeometry

    @cached_property
    def _plane_tangents(self) -> Float64Array:
        return tangents(self.start.plane_normal)

    @cached_property
    def _axis_tangents(self) -> Float64Array:
        return tangents(self.start.axis.direction)

    def lens(self, values: Float64Array) -> Lens:
        """The lens of the parameters `LENS`."""
        fx, fy, cx, cy, k1, k2, p1, p2, k3 = values.tolist()
        return Lens(fx, fy, cx, cy, self.start.lens.size, (k1, k2, p1, p2, k3))

    def plane(self, values: Float64Array) -> tuple[Float64Array, float]:
        """Normal and distance [m] of the laser plane of the parameters `PLANE`."""
        normal = np.asarray(self.start.plane_normal) + values[:2] @ self._plane_tangents
        return normal / np.linalg.norm(normal), float(values[2])

    def axis(self, values: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Direction and a point [m] of the turning axis of the parameters `AXIS`."""
        start = self.start.axis
        direction = np.asarray(start.direction) + values[:2] @ self._axis_tangents
        point = np.asarray(start.point) + values[2:] @ self._axis_tangents
        return direction / np.linalg.norm(direction), point

    def pose(self, axis: Float64Array, place: Float64Array, turned_deg: float) -> Float64Array:
        """`optical_from_board` after a turn from where the place was seen first, shape (4, 4)."""
        return head_turned(*self.axis(axis), turned_deg) @ pose_matrix(place[:3], place[3:])

    def geometry(self, parameters: Float64Array) -> ScannerGeometry:
        """The scanner of a whole vector; its axis by the point nearest to the camera."""
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


def first_guess(
    model: ScannerModel, views: Sequence[BoardView], poses: Float64Array
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
    model: ScannerModel,
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
        errors = (corner_error(model.start.lens, moves[n] @ place, views[n]) for n in members)
        return float(sum(error @ error for error in errors))

    return min(places, key=misfit)
