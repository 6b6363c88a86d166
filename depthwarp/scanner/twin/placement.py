"""The head placed in the world: where the camera and the laser stand at a turning angle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthwarp.checks import check_finite_vector
from depthwarp.errors import InputError
from depthwarp.scanner.geometry import ScannerGeometry, Vector3

__all__ = ["LaserFrame", "Placement"]

Float64Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LaserFrame:
    """The laser in the optical frame.

    Attributes:
        origin: Where its fan starts [m]: the laser plane's point nearest to the head's origin.
        forward: Unit vector down the middle of the fan, square to the turning axis.
        up: Unit vector in the plane, square to `forward`.
    """

    origin: Float64Array
    forward: Float64Array
    up: Float64Array


class Placement:
    """The frames of a head that stands in the world, as `depthwarp.scanner.geometry` defines them.

    Args:
        geometry: Lens, laser plane and axis.
        position: Where the origin of the head frame stands, world frame [m].

    Raises:
        InputError: A position that is not finite, an axis along the camera's viewing direction, or
            a laser plane square to the axis.
    """

    def __init__(self, geometry: ScannerGeometry, position: Vector3) -> None:
        self.geometry = geometry
        self.position = np.array(check_finite_vector("position", position, 3))
        self._head_from_optical = geometry.head_from_optical
        self.laser = self._laser_frame()

    def _laser_frame(self) -> LaserFrame:
        normal, axis = np.array(self.geometry.plane_normal), np.array(self.geometry.axis.direction)
        matrix = self._head_from_optical
        head_origin = -matrix[:3, :3].T @ matrix[:3, 3]
        origin = head_origin + (self.geometry.plane_distance - normal @ head_origin) * normal
        forward = np.cross(normal, axis)
        if np.linalg.norm(forward) < 1e-3:
            raise InputError("plane_normal must not run along the turning axis")
        forward *= math.copysign(1.0, forward[2]) / np.linalg.norm(forward)
        return LaserFrame(origin, forward, np.cross(normal, forward))

    def world_from_optical(self, angle: float) -> tuple[Float64Array, Float64Array]:
        """Rotation, shape (3, 3), and camera centre, world frame [m], at an angle [degrees]."""
        cos, sin = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        matrix = self._head_from_optical
        return turn @ matrix[:3, :3], self.position + turn @ matrix[:3, 3]
