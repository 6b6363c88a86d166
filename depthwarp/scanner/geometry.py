"""The scanner's geometry: lens, laser plane and turning axis, and how a pixel becomes a point.

Frames: `optical` is the camera's (X right, Y down, Z forward, origin at its centre). `head` stands
still relative to the camera: Z is the turning axis upwards, the origin is the axis point nearest
to the camera's centre, X points from the axis in the camera's viewing direction. `world` is the
head frame at angle 0, moved to where the head stands; at angle a, `p_world = Rz(a) p_head`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError

__all__ = ["Lens", "ScannerGeometry", "TurningAxis", "reference_geometry"]

Float64Array = npt.NDArray[np.float64]
Vector3 = tuple[float, float, float]


@dataclass(frozen=True)
class Lens:
    """Pinhole with Brown-Conrady distortion, as OpenCV defines it, for upright frames.

    Attributes:
        fx: Focal length along columns [px].
        fy: Focal length along rows [px].
        cx: Principal point, column [px].
        cy: Principal point, row [px].
        size: (width, height) of the upright frame [px].
        distortion: k1, k2, p1, p2, k3.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    size: tuple[int, int]
    distortion: tuple[float, float, float, float, float] = (0.0, 0.0, 0.0, 0.0, 0.0)

    @property
    def K(self) -> Float64Array:
        """Intrinsic matrix [px], shape (3, 3)."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], np.float64)


@dataclass(frozen=True)
class TurningAxis:
    """The axis that the head turns about, a line in the optical frame.

    Attributes:
        direction: Unit vector upwards, counter-clockwise turns positive.
        point: A point of the axis [m].
    """

    direction: Vector3
    point: Vector3


@dataclass(frozen=True)
class ScannerGeometry:
    """Everything between a pixel on the laser line and a point in the world.

    Attributes:
        lens: The camera's lens.
        plane_normal: Unit normal n of the laser plane, optical frame: n . x = d.
        plane_distance: d [m].
        axis: The turning axis.
        max_range: Farther points are not kept [m].
    """

    lens: Lens
    plane_normal: Vector3
    plane_distance: float
    axis: TurningAxis
    max_range: float = 15.0

    def __post_init__(self) -> None:
        for name, vector in (
            ("plane_normal", self.plane_normal),
            ("axis.direction", self.axis.direction),
        ):
            length = float(np.linalg.norm(vector))
            if not abs(length - 1.0) < 1e-6:
                raise InputError(f"{name} must be a unit vector, its length is {length:.6g}")

    @property
    def head_from_optical(self) -> Float64Array:
        """Optical frame to head frame, shape (4, 4), column vectors [m].

        Raises:
            InputError: The camera looks along the axis, so that the head has no forward direction.
        """
        up = np.asarray(self.axis.direction, np.float64)
        point = np.asarray(self.axis.point, np.float64)
        viewing = np.array([0.0, 0.0, 1.0])
        forward = viewing - (viewing @ up) * up
        if np.linalg.norm(forward) < 1e-6:
            raise InputError("axis.direction must not be the camera's viewing direction")
        forward /= np.linalg.norm(forward)
        matrix = np.eye(4)
        matrix[:3, :3] = [forward, np.cross(up, forward), up]
        matrix[:3, 3] = -matrix[:3, :3] @ (point - (point @ up) * up)
        return matrix


def reference_geometry(scale: float = 1.0) -> ScannerGeometry:
    """The reference scanner: an upright 1942 x 2590 sensor beside a vertical laser fan.

    Focal length 1295 px, baseline 0.5 m, the laser toed in so that infinity lies 40 px inside the
    frame's left edge, and 0.35 m is well within the frame; the turning axis runs vertically
    through the laser.

    Args:
        scale: Size of the sensor relative to the full one, 0.05 to 1; the angles stay.

    Raises:
        InputError: Another scale.
    """
    if not 0.05 <= scale <= 1:
        raise InputError(f"scale of the sensor must be from 0.05 to 1, got {scale}")
    focal, baseline = 1295.0 * scale, 0.5
    width, height = round(1942 * scale), round(2590 * scale)
    lens = Lens(
        fx=focal,
        fy=focal,
        cx=(width - 1) / 2,
        cy=(height - 1) / 2,
        size=(width, height),
        distortion=(-0.25, 0.05, 0.0, 0.0, 0.0),  # k2 keeps the corners inside the lens's domain
    )
    # x = b - z tan(toe_in): infinity is seen at u' = -0.85, which the lens bends to column 40.
    toe_in = math.atan(0.85)
    return ScannerGeometry(
        lens=lens,
        plane_normal=(math.cos(toe_in), 0.0, math.sin(toe_in)),
        plane_distance=math.cos(toe_in) * baseline,
        axis=TurningAxis(direction=(0.0, -1.0, 0.0), point=(baseline, 0.0, 0.0)),
    )
