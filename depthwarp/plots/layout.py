"""What the drawing of a scanner shows, and where: laid out from the geometry, drawn elsewhere."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from depthwarp.errors import InputError
from depthwarp.plots.page import Array

if TYPE_CHECKING:
    from depthwarp.scanner.geometry import ScannerGeometry

__all__ = ["SetUp", "lay_out"]

POINT_SHARE, POINT_HEIGHT = 0.18, 0.3
"""Where the drawn point is seen: away from where infinity is seen, as a share of the frame's width,
and above the frame's middle, as a share of its upper half."""


@dataclass(frozen=True, eq=False)
class SetUp:
    """A scanner before a wall: places in the head frame [m], shape (3,), and numbers.

    Attributes:
        camera: The camera's centre.
        laser: Where the fan starts.
        crossing: Where the camera's own X axis meets the laser plane.
        forward: Unit vector down the middle of the fan.
        point: A measured point on the wall.
        rim: Left and right edge of the camera's view at the wall, shape (2, 3).
        pixel: Column and row that see the point [px].
        view: Angles that the camera sees, across and high [degrees].
        toe_in: How far the laser plane is turned towards the camera [degrees].
    """

    camera: Array
    laser: Array
    crossing: Array
    forward: Array
    point: Array
    rim: Array
    pixel: Array
    view: tuple[float, float]
    toe_in: float

    @property
    def baseline(self) -> float:
        """Distance from the camera to the laser plane along the camera's X axis [m]."""
        return float(np.linalg.norm(self.crossing - self.camera))

    @property
    def range(self) -> float:
        """Distance from the camera to the point [m]."""
        return float(np.linalg.norm(self.point - self.camera))

    @property
    def unit(self) -> float:
        """Distance to the wall [m]: what is an example in the drawing is measured by it."""
        return float(self.point[0] - self.camera[0])

    @property
    def side(self) -> float:
        """1 where the laser stands to the right of the camera, -1 to the left."""
        return math.copysign(1.0, self.above(self.crossing)[0] - self.above(self.camera)[0])

    def above(self, place: Array) -> Array:
        """Places, (..., 3), as seen from above, the camera's viewing direction up, (..., 2)."""
        return np.stack([-place[..., 1], place[..., 0]], axis=-1)

    def aside(self, place: Array) -> Array:
        """Places, (..., 3), square to the laser plane: along the fan's middle and up, (..., 2)."""
        return np.stack([(place - self.laser) @ self.forward, place[..., 2]], axis=-1)


def lay_out(geometry: ScannerGeometry) -> SetUp:
    """Place a wall where the laser line on it is well in the camera's view.

    Raises:
        InputError: The camera cannot see the laser plane, or its lens has no edges.
    """
    from depthwarp.scanner.lens import project, undistort
    from depthwarp.scanner.twin.placement import Placement

    lens, normal, distance = geometry.lens, geometry.plane_normal, geometry.plane_distance
    (width, height), matrix = lens.size, geometry.head_from_optical
    sides = [(0, lens.cy), (width - 1, lens.cy), (lens.cx, 0), (lens.cx, height - 1)]
    left, right, top, bottom = undistort(lens, sides)[range(4), (0, 0, 1, 1)]
    if not math.isfinite(left + right + top + bottom):
        raise InputError("geometry.lens has no ray at an edge of its frame: check the distortion")
    if abs(normal[0]) < 1e-3 or distance == 0.0:
        raise InputError(
            "geometry.plane_normal must not be square to the baseline: check the plane"
        )

    baseline, infinity = distance / normal[0], -normal[2] / normal[0]
    across = infinity + math.copysign(POINT_SHARE, baseline) * (right - left)
    ray = np.array([np.clip(across, 0.95 * left, 0.95 * right), POINT_HEIGHT * top, 1.0])
    depth = distance / float(ray @ normal)
    if not 0 < depth < math.inf:
        raise InputError("the laser plane is nowhere in the camera's view: check the geometry")

    laser = Placement(geometry, (0.0, 0.0, 0.0)).laser
    rim = [(edge * depth, 0.0, depth) for edge in (left, right)]
    places = np.array([(0.0, 0.0, 0.0), laser.origin, (baseline, 0.0, 0.0), depth * ray, *rim])
    camera, origin, crossing, point, *edges = places @ matrix[:3, :3].T + matrix[:3, 3]
    return SetUp(
        camera=camera,
        laser=origin,
        crossing=crossing,
        forward=matrix[:3, :3] @ laser.forward,
        point=point,
        rim=np.array(edges),
        pixel=project(lens, depth * ray[None])[0],
        view=(_angle(left, right), _angle(top, bottom)),
        toe_in=math.degrees(math.atan(-infinity)) * math.copysign(1.0, baseline),
    )


def _angle(first: float, second: float) -> float:
    """Angle between the rays of two tangents [degrees]."""
    return math.degrees(math.atan(second) - math.atan(first))
