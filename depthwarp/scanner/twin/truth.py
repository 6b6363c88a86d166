"""Where the laser line truly is: solved in float64 from the scene, row by row, with no picture."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthwarp.scanner.lens import project
from depthwarp.scanner.twin.optics import Laser
from depthwarp.scanner.twin.placement import Placement
from depthwarp.scanner.twin.scene import Scene

__all__ = ["LineTruth", "line_truth"]

Float64Array = npt.NDArray[np.float64]

RAYS_A_ROW = 4
"""Laser rays that look for surfaces, for each row of the frame."""

STEPS = 12
"""Newton steps to a row's middle; four are enough but at grazing surfaces."""

SAME_PLACE = 1e-6
"""Two ways to one surface agree to this fraction of its distance."""

ON_ROW = 1e-6
"""A point is on its row, and two points are one, when they agree this well [px]."""


@dataclass(frozen=True, eq=False)
class LineTruth:
    """The laser line in one frame: for each row, where its middle crosses the row's middle.

    A row that the line crosses several times has the visible crossing nearest to the laser.

    Attributes:
        column: Sub-pixel column, pixel middles at whole numbers, shape (H,); NaN for no line.
        points_world: Where the line meets the surface, world frame [m], shape (H, 3).
        range: Distance of that point from the camera's centre [m], shape (H,).
        visible: Whether the camera sees the point, in the frame and within the scanner's greatest
            range, shape (H,).
        crossings: Visible crossings of the row, shape (H,).
        surface: Surface of the scene that is met, -1 for none, shape (H,).
    """

    column: Float64Array
    points_world: Float64Array
    range: Float64Array
    visible: npt.NDArray[np.bool_]
    crossings: npt.NDArray[np.int64]
    surface: npt.NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class _Crossings:
    """Candidates: a row, the surface that is tried, and a point of the line, optical frame."""

    row: npt.NDArray[np.int64]
    surface: npt.NDArray[np.int32]
    point: Float64Array

    def __getitem__(self, kept: npt.NDArray[np.bool_] | npt.NDArray[np.int64]) -> _Crossings:
        return _Crossings(self.row[kept], self.surface[kept], self.point[kept])


def line_truth(scene: Scene, placement: Placement, laser: Laser, angle: float) -> LineTruth:
    """Solve for the line's middle in every row at an angle [degrees].

    Rays of the fan find the surfaces that the line runs over. For each row and surface the point
    is solved for in which surface, laser plane and row meet; then casts from the laser and from
    the camera say whether it is lit and seen.
    """
    rotation, camera = placement.world_from_optical(angle)
    source = placement.laser.origin
    met = _surfaces_by_row(scene, placement, laser, rotation, camera)
    found = _on_their_rows(scene, placement, rotation, met)
    found = found[_in_fan(placement, laser, found.point)]
    to_point = (found.point - source) @ rotation.T
    lit = found[_reached(scene, camera + rotation @ source, to_point)]
    seen = _reached(scene, camera, lit.point @ rotation.T)
    return _by_row(placement, rotation, camera, lit, seen)


def _in_fan(placement: Placement, laser: Laser, points: Float64Array) -> npt.NDArray[np.bool_]:
    """Which points of the laser plane, optical frame, lie within the fan's opening."""
    reach = points - placement.laser.origin
    limit = math.tan(math.radians(laser.fan / 2)) * (reach @ placement.laser.forward)
    return np.asarray(np.abs(reach @ placement.laser.up) <= limit)


def _surfaces_by_row(
    scene: Scene, placement: Placement, laser: Laser, rotation: Float64Array, camera: Float64Array
) -> _Crossings:
    """The rows near which a ray of the fan meets a surface, each pair once."""
    fan, height = placement.laser, placement.geometry.lens.size[1]
    half = math.radians(laser.fan / 2)
    turn = np.linspace(-half, half, RAYS_A_ROW * height)[:, None]
    rays = np.cos(turn) * fan.forward + np.sin(turn) * fan.up
    distance, surface = scene.cast(camera + rotation @ fan.origin, rays @ rotation.T)
    hit = np.isfinite(distance)
    points = fan.origin + distance[hit, None] * rays[hit]
    rows = project(placement.geometry.lens, points)[:, 1]
    near = (rows > -1) & (rows < height)  # refuses NaN: out of the lens's domain
    points, surface = points[near], surface[hit][near]
    above = np.floor(rows[near]).astype(np.int64)
    row = np.concatenate([above, above + 1])
    every = _Crossings(row, np.tile(surface, 2), np.tile(points, (2, 1)))
    every = every[(row >= 0) & (row < height)]
    pairs = np.stack([every.row, every.surface], axis=1)
    return every[np.unique(pairs, axis=0, return_index=True)[1]]


def _on_their_rows(
    scene: Scene, placement: Placement, rotation: Float64Array, start: _Crossings
) -> _Crossings:
    """Slide each point along the line on its surface until it lies on its row's middle."""
    normals = scene.normals(start.surface) @ rotation  # optical frame
    along = np.cross(np.array(placement.geometry.plane_normal), normals)
    length = np.linalg.norm(along, axis=1, keepdims=True)
    along /= np.where(length > 1e-9, length, np.nan)  # a surface in the laser plane has no line
    point, off = start.point, np.full(len(start.row), np.nan)
    for _ in range(STEPS):
        probe = 1e-6 * point[:, 2]
        row = project(placement.geometry.lens, point)[:, 1]
        slope = project(placement.geometry.lens, point + probe[:, None] * along)[:, 1] - row
        off = start.row - row
        steps = np.clip(off / np.where(slope == 0.0, np.nan, slope), -1e5, 1e5)
        point = point + (steps * probe)[:, None] * along
    solved = np.abs(off) < ON_ROW
    return _Crossings(start.row, start.surface, point)[solved]


def _reached(scene: Scene, origin: Float64Array, reach: Float64Array) -> npt.NDArray[np.bool_]:
    """Whether rays from a place end at points, given from there, world frame [m].

    A point may lie on the plane of a surface but beyond its edges: a ray to it goes farther.
    """
    distance = np.linalg.norm(reach, axis=1)
    met, _ = scene.cast(origin, reach / distance[:, None])
    return np.asarray(np.abs(met - distance) <= SAME_PLACE * distance)


def _by_row(
    placement: Placement,
    rotation: Float64Array,
    camera: Float64Array,
    lit: _Crossings,
    seen: npt.NDArray[np.bool_],
) -> LineTruth:
    """One crossing for each row: a visible one before others, then the nearest to the laser."""
    width, height = placement.geometry.lens.size
    column = project(placement.geometry.lens, lit.point)[:, 0]
    distance = np.linalg.norm(lit.point, axis=1)
    visible = seen & (column >= -0.5) & (column < width - 0.5)
    visible &= distance <= placement.geometry.max_range
    from_laser = np.linalg.norm(lit.point - placement.laser.origin, axis=1)
    # Surfaces in one plane that touch give the same crossing twice.
    order = np.lexsort([from_laser, ~visible, lit.row])
    same = np.zeros(len(order), dtype=bool)
    same[1:] = (np.diff(lit.row[order]) == 0) & (np.abs(np.diff(column[order])) < ON_ROW)
    order = order[~same]
    crossings = np.bincount(lit.row[order], weights=visible[order], minlength=height)
    row, best = np.unique(lit.row[order], return_index=True)
    best = order[best]
    truth = LineTruth(
        column=np.full(height, np.nan),
        points_world=np.full((height, 3), np.nan),
        range=np.full(height, np.nan),
        visible=np.zeros(height, dtype=bool),
        crossings=crossings.astype(np.int64),
        surface=np.full(height, -1, dtype=np.int32),
    )
    truth.column[row] = column[best]
    truth.points_world[row] = camera + lit.point[best] @ rotation.T
    truth.range[row] = distance[best]
    truth.visible[row] = visible[best]
    truth.surface[row] = lit.surface[best]
    return truth
