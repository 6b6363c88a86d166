"""Solids that rays meet at exact places: boxes, cylinders and spheres, in any position.

The frame is the world frame: right-handed, Z up, metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError

__all__ = ["Kind", "Solid", "Vector", "box", "box_between", "rod", "sphere", "upright"]

Float64Array = npt.NDArray[np.float64]
Vector = tuple[float, float, float]
Span = tuple[float, float]


class Kind(IntEnum):
    """The shape of a solid, in its own frame, its middle at the origin."""

    BOX = 0
    """Half edges `half`."""
    CYLINDER = 1
    """About the Z axis: radius `half[0]`, half length `half[2]`, flat ends."""
    SPHERE = 2
    """Radius `half[0]`."""


@dataclass(frozen=True)
class Solid:
    """A solid that stops rays.

    Attributes:
        kind: Its shape.
        center: Its middle, world frame [m].
        half: Half extents in its own frame [m], see `Kind`.
        axes: Its own axes in the world frame, the rows of a rotation, shape 3 x 3.

    Raises:
        InputError: A number that is not finite, or an extent that is not above 0.
    """

    kind: Kind
    center: Vector
    half: Vector
    axes: tuple[Vector, Vector, Vector] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

    def __post_init__(self) -> None:
        numbers = np.array([self.center, self.half, *self.axes])
        if not np.isfinite(numbers).all() or min(self.half) <= 0:
            raise InputError(
                "a solid must have finite numbers and extents above 0 m, got center "
                f"{self.center}, half extents {self.half}"
            )

    def moved(self, x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> Solid:
        """The solid turned about the world's Z axis by `yaw` [degrees], then moved [m]."""
        turn = _turn_z(yaw)
        center = turn @ self.center + (x, y, z)
        return replace(self, center=_vector(center), axes=_rows(np.array(self.axes) @ turn.T))

    def reach(self) -> Float64Array:
        """Half edges of the solid's bounding box along the world's axes [m], shape (3,)."""
        radius, _, half_length = self.half
        if self.kind == Kind.SPHERE:
            return np.full(3, radius)
        axes = np.array(self.axes)
        if self.kind == Kind.CYLINDER:
            along = np.abs(axes[2])
            return np.asarray(half_length * along + radius * np.sqrt(1 - np.minimum(along, 1) ** 2))
        return np.asarray(np.abs(axes).T @ np.array(self.half))


def box(center: Vector, size: Vector, yaw: float = 0.0, pitch: float = 0.0) -> Solid:
    """A box by its middle and its full edges [m].

    Args:
        center: Middle, world frame [m].
        size: Full edges along its own axes [m].
        yaw: Turn about Z, counter-clockwise seen from above, after the pitch [degrees].
        pitch: Turn about its own Y axis, positive lets its +x end sink [degrees].
    """
    cos, sin = math.cos(math.radians(pitch)), math.sin(math.radians(pitch))
    pitched = np.array([[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]])
    half = (size[0] / 2, size[1] / 2, size[2] / 2)
    return Solid(Kind.BOX, center, half, _rows((_turn_z(yaw) @ pitched).T))


def box_between(x: Span, y: Span, z: Span) -> Solid:
    """A box between a low and a high coordinate [m] on each axis."""
    low, high = np.array([x, y, z]).T
    return box(_vector((low + high) / 2), _vector(high - low))


def upright(x: float, y: float, z: Span, radius: float) -> Solid:
    """An upright cylinder between two heights [m]."""
    half = (radius, radius, (z[1] - z[0]) / 2)
    return Solid(Kind.CYLINDER, (x, y, (z[0] + z[1]) / 2), half)


def rod(start: Vector, end: Vector, radius: float) -> Solid:
    """A cylinder from one point to another [m]."""
    along = np.subtract(end, start)
    length = float(np.linalg.norm(along))
    if not length > 0:
        raise InputError(f"a rod must have a length above 0 m, got both ends at {start}")
    third = along / length
    first = np.cross(third, np.eye(3)[np.abs(third).argmin()])
    first /= np.linalg.norm(first)
    axes = np.stack([first, np.cross(third, first), third])
    half = (radius, radius, length / 2)
    return Solid(Kind.CYLINDER, _vector(np.add(start, end) / 2), half, _rows(axes))


def sphere(center: Vector, radius: float) -> Solid:
    """A sphere [m]."""
    return Solid(Kind.SPHERE, center, (radius, radius, radius))


def _turn_z(yaw: float) -> Float64Array:
    cos, sin = math.cos(math.radians(yaw)), math.sin(math.radians(yaw))
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def _vector(values: npt.ArrayLike) -> Vector:
    x, y, z = np.asarray(values, dtype=np.float64).tolist()
    return x, y, z


def _rows(matrix: Float64Array) -> tuple[Vector, Vector, Vector]:
    return _vector(matrix[0]), _vector(matrix[1]), _vector(matrix[2])
