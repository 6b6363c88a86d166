"""An analytic furnished room: boxes that a simulated scanner's rays meet at exact distances.

The frame is the world frame: right-handed, Z up, metres, the floor at z = 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError

__all__ = ["Box", "Room", "furnished_room"]

Float64Array = npt.NDArray[np.float64]
Int32Array = npt.NDArray[np.int32]
Vector = tuple[float, float, float]
Color = tuple[int, int, int]
Span = tuple[float, float]

RAYS_A_BLOCK = 8192  # a block's intermediate arrays stay in a core's own cache


@dataclass(frozen=True)
class Box:
    """A solid box with horizontal top and bottom, turned about its own vertical axis.

    Attributes:
        name: What the box is a part of, such as "table".
        center: Middle of the box, world frame [m].
        size: Full edge lengths along the box's own axes [m].
        color: Red, green, blue, 0 to 255.
        yaw: Turn about Z, counter-clockwise seen from above [degrees].
    """

    name: str
    center: Vector
    size: Vector
    color: Color
    yaw: float = 0.0

    def __post_init__(self) -> None:
        values = (*self.center, *self.size, self.yaw)
        if not all(math.isfinite(value) for value in values) or min(self.size) <= 0:
            raise InputError(
                f"box '{self.name}' must have a finite center and yaw and edges longer than 0, "
                f"got center {self.center}, size {self.size}, yaw {self.yaw}"
            )

    def placed(self, x: float, y: float, yaw: float = 0.0) -> Box:
        """The box turned about the world's Z axis by `yaw` [degrees], then moved by (x, y) [m]."""
        cos, sin = math.cos(math.radians(yaw)), math.sin(math.radians(yaw))
        center_x, center_y, center_z = self.center
        moved = (x + cos * center_x - sin * center_y, y + sin * center_x + cos * center_y, center_z)
        return replace(self, center=moved, yaw=self.yaw + yaw)

    def holds(self, position: Vector) -> bool:
        """Whether a position, world frame [m], lies inside the box or on its surface."""
        local = _turn_z(np.subtract(position, self.center)[:, None], -self.yaw)
        return bool(np.all(np.abs(local[:, 0]) <= np.asarray(self.size) / 2))


@dataclass(frozen=True)
class Room:
    """Boxes that stop rays. Surface `6 * i + f` is face f (-x, +x, -y, +y, -z, +z) of box i."""

    boxes: tuple[Box, ...]

    def cast(
        self, origins: npt.ArrayLike, directions: npt.ArrayLike
    ) -> tuple[Float64Array, Int32Array]:
        """Find the first surface along each ray.

        A ray that starts inside a box does not see that box.

        Args:
            origins: Ray starts, world frame [m], shape (N, 3), or (3,) for one that all share.
            directions: Unit vectors, world frame, shape (N, 3).

        Returns:
            Distance [m], shape (N,), inf where nothing is hit, and surface index, shape (N,),
            -1 where nothing is hit.

        Raises:
            InputError: Wrong shapes, an origin that is not finite, or a direction that is not of
                unit length.
        """
        starts, units = _checked_rays(origins, directions)
        distance = np.full(len(units), np.inf)
        surface = np.full(len(units), -1, dtype=np.int32)
        for first in range(0, len(units), RAYS_A_BLOCK):
            rays = slice(first, first + RAYS_A_BLOCK)
            block_starts = starts[rays] if len(starts) == len(units) else starts
            self._cast_block(block_starts, units[rays], distance[rays], surface[rays])
        return distance, surface

    def _cast_block(
        self, starts: Float64Array, units: Float64Array, distance: Float64Array, surface: Int32Array
    ) -> None:
        """Cast one block of rays, lowering `distance` and setting `surface` in place."""
        for yaw in sorted({box.yaw for box in self.boxes}):
            # Boxes that are turned alike share the turned rays.
            origin, direction = _turn_z(starts.T, -yaw), _turn_z(units.T, -yaw)
            # A ray parallel to a slab meets its planes "at 1e300 m", with no 0 * inf to care for.
            inverse = 1.0 / np.where(direction == 0.0, 1e-300, direction)
            steepness = np.abs(inverse)
            for index, box in enumerate(self.boxes):
                if box.yaw != yaw:
                    continue
                to_center = _turn_z(np.array(box.center)[:, None], -yaw) - origin
                reach = steepness * (np.asarray(box.size)[:, None] / 2)
                middle = to_center * inverse
                entry = middle - reach
                entered = entry.max(axis=0)
                left = (middle + reach).min(axis=0)
                hit = np.flatnonzero((entered <= left) & (entered > 0) & (entered < distance))
                axis = entry[:, hit].argmax(axis=0)
                distance[hit] = entered[hit]
                surface[hit] = 6 * index + 2 * axis + (direction[axis, hit] < 0)

    def normals(self, surface: Int32Array) -> Float64Array:
        """Outward unit normals, world frame, shape (N, 3), of surface indices >= 0, shape (N,)."""
        faces = np.stack([-np.eye(3), np.eye(3)], axis=1).reshape(6, 3)
        table = np.array([_turn_z(faces.T, box.yaw).T for box in self.boxes])
        return table.reshape(-1, 3)[surface]

    def colors(self, surface: Int32Array) -> npt.NDArray[np.uint8]:
        """Colours, shape (N, 3), uint8, of surface indices >= 0, shape (N,)."""
        table = np.array([box.color for box in self.boxes], dtype=np.uint8)
        return table.reshape(-1, 3)[surface // 6]

    def solid_at(self, position: Vector) -> str | None:
        """Name of a box that holds the position, world frame [m], or None in free air."""
        return next((box.name for box in self.boxes if box.holds(position)), None)


def _turn_z(vectors: Float64Array, yaw: float) -> Float64Array:
    """Vectors, shape (3, N), turned about Z by `yaw` [degrees], counter-clockwise from above."""
    cos, sin = math.cos(math.radians(yaw)), math.sin(math.radians(yaw))
    x, y, z = vectors  # not as a matrix product, whose last bit depends on N
    return np.stack([cos * x - sin * y, sin * x + cos * y, z])


def _checked_rays(
    origins: npt.ArrayLike, directions: npt.ArrayLike
) -> tuple[Float64Array, Float64Array]:
    """Origins, shape (1 or N, 3), and directions, shape (N, 3), float64, after the checks."""
    units = np.asarray(directions, dtype=np.float64)
    if units.ndim != 2 or units.shape[1] != 3:
        raise InputError(f"directions must have shape (N, 3), got {units.shape}")
    starts = np.atleast_2d(np.asarray(origins, dtype=np.float64))
    if starts.shape not in ((1, 3), units.shape):
        raise InputError(f"origins must have shape (3,) or {units.shape}, got {starts.shape}")
    if not np.all(np.isfinite(starts)):
        raise InputError("origins must be finite, got NaN or infinity")
    if not np.all(np.abs(np.linalg.norm(units, axis=1) - 1.0) <= 1e-6):  # refuses NaN, too
        raise InputError("directions must be unit vectors: divide each by its length")
    return starts, units


# The room. From the paper's camera position, y = 3.3, the far wall gives its 724 columns.

FAR_WALL_Y = 9.5555
LEFT_X, RIGHT_X, HEIGHT, THICK, LEG = -1.5, 5.1, 2.8, 0.1, 0.06
DOOR_X, DOOR_TOP, CUPBOARD_X, TABLE = (0.15, 1.05), 2.05, (2.6, 4.1), (1.85, 7.05)
WINDOW_Y, WINDOW_Z = (4.4, 6.4), (0.95, 2.25)

WALL, CEILING, FLOOR = (226, 220, 206), (240, 240, 236), (150, 122, 96)
OAK, WALNUT, WHITE = (190, 140, 84), (122, 80, 52), (236, 236, 230)
RED, BLUE, GREEN = (186, 62, 52), (66, 104, 158), (96, 138, 92)

CHAIRS = (
    (-1.15, 0.0, -80.0, RED),
    (1.15, 0.05, 95.0, RED),
    (0.0, 0.72, 180.0, RED),
    (2.05, -0.7, 120.0, GREEN),
)
"""Position from the table's middle [m], yaw [degrees] and colour of each chair."""


def _span(name: str, color: Color, x: Span, y: Span, z: Span) -> Box:
    """A box between a low and a high coordinate [m] on each axis."""
    center = ((x[0] + x[1]) / 2, (y[0] + y[1]) / 2, (z[0] + z[1]) / 2)
    return Box(name, center, (x[1] - x[0], y[1] - y[0], z[1] - z[0]), color)


def _legs(name: str, color: Color, reach_x: float, reach_y: float, height: float) -> Iterator[Box]:
    """Four square legs [m] under a piece that stands around the origin."""
    for x in (-reach_x, reach_x):
        for y in (-reach_y, reach_y):
            yield Box(name, (x, y, height / 2), (LEG, LEG, height), color)


def _shell() -> Iterator[Box]:
    """Floor, ceiling and walls, with a doorway in the far wall and a window in the left one."""
    x, y, z = (LEFT_X, RIGHT_X), (0.0, FAR_WALL_Y), (0.0, HEIGHT)
    yield _span("floor", FLOOR, x, y, (-THICK, 0.0))
    yield _span("ceiling", CEILING, x, y, (HEIGHT, HEIGHT + THICK))
    yield _span("near wall", WALL, x, (-THICK, 0.0), z)
    yield _span("right wall", WALL, (RIGHT_X, RIGHT_X + THICK), y, z)
    # Thin, so that no ray through the doorway finds a point beyond the face of the wall.
    behind = (FAR_WALL_Y, FAR_WALL_Y + 0.001)
    yield _span("far wall", WALL, (LEFT_X, DOOR_X[0]), behind, z)
    yield _span("far wall", WALL, (DOOR_X[1], RIGHT_X), behind, z)
    yield _span("far wall", WALL, DOOR_X, behind, (DOOR_TOP, HEIGHT))
    left = (LEFT_X - THICK, LEFT_X)
    yield _span("left wall", WALL, left, (0.0, WINDOW_Y[0]), z)
    yield _span("left wall", WALL, left, (WINDOW_Y[1], FAR_WALL_Y), z)
    yield _span("left wall", WALL, left, WINDOW_Y, (0.0, WINDOW_Z[0]))
    yield _span("left wall", WALL, left, WINDOW_Y, (WINDOW_Z[1], HEIGHT))


def _openings() -> Iterator[Box]:
    """The door, ajar in its frame, and the window's bar and sill; open air returns nothing."""
    front = (FAR_WALL_Y - 0.06, FAR_WALL_Y)
    yield _span("door frame", WHITE, (DOOR_X[0] - 0.1, DOOR_X[0]), front, (0.0, DOOR_TOP + 0.1))
    yield _span("door frame", WHITE, (DOOR_X[1], DOOR_X[1] + 0.1), front, (0.0, DOOR_TOP + 0.1))
    yield _span("door frame", WHITE, DOOR_X, front, (DOOR_TOP, DOOR_TOP + 0.1))
    width = DOOR_X[1] - DOOR_X[0]
    leaf = _span("door", OAK, (0.0, width - 0.02), (-0.04, 0.0), (0.01, DOOR_TOP - 0.01))
    yield leaf.placed(DOOR_X[0], FAR_WALL_Y - 0.07, yaw=-45.0)
    frame_x, middle = (LEFT_X - 0.06, LEFT_X - 0.02), sum(WINDOW_Y) / 2
    yield _span("window", WHITE, frame_x, (middle - 0.04, middle + 0.04), WINDOW_Z)
    sill_x, sill_z = (LEFT_X, LEFT_X + 0.18), (WINDOW_Z[0] - 0.04, WINDOW_Z[0])
    yield _span("window", WHITE, sill_x, (WINDOW_Y[0] - 0.1, WINDOW_Y[1] + 0.1), sill_z)


def _table() -> Iterator[Box]:
    """A dining table around the origin: top, apron and four legs."""
    yield _span("table", OAK, (-0.8, 0.8), (-0.45, 0.45), (0.71, 0.75))
    yield _span("table", OAK, (-0.72, 0.72), (-0.38, 0.38), (0.63, 0.71))
    yield from _legs("table", OAK, 0.73, 0.38, 0.71)


def _chair(color: Color) -> Iterator[Box]:
    """A chair around the origin that looks along +y: seat, legs, back rest on two posts."""
    yield _span("chair", color, (-0.22, 0.22), (-0.22, 0.22), (0.43, 0.48))
    yield from _legs("chair", WALNUT, 0.19, 0.19, 0.43)
    for x in (-0.2, 0.2):
        yield Box("chair", (x, -0.2, 0.72), (0.04, 0.04, 0.48), WALNUT)
    yield _span("chair", color, (-0.22, 0.22), (-0.22, -0.18), (0.66, 0.96))


def _cupboard() -> Iterator[Box]:
    """A cupboard at the far wall: two doors below, open shelves above, a plinth and a cornice."""
    (low, high), back = CUPBOARD_X, FAR_WALL_Y
    middle, face, counter, top = (low + high) / 2, FAR_WALL_Y - 0.56, 0.92, 2.06
    yield _span("cupboard", WALNUT, (low + 0.04, high - 0.04), (face + 0.06, back), (0.0, 0.1))
    yield _span("cupboard", WALNUT, (low, high), (face, back), (0.1, counter))
    for start, end in ((low + 0.03, middle - 0.015), (middle + 0.015, high - 0.03)):
        yield _span("cupboard", OAK, (start, end), (face - 0.03, face), (0.14, counter - 0.04))
    yield _span("cupboard", OAK, (low, high), (back - 0.15, back), (counter, top))
    for x in (low + 0.03, middle, high - 0.03):
        yield _span("cupboard", WALNUT, (x - 0.03, x + 0.03), (face, back - 0.15), (counter, top))
    for z in (1.3, 1.68):
        yield _span("cupboard", WALNUT, (low, high), (face, back - 0.15), (z, z + 0.04))
    wider = (low - 0.05, high + 0.05)
    yield _span("cupboard", WALNUT, wider, (face - 0.08, back), (top, top + 0.08))


def _shelf() -> Iterator[Box]:
    """A book shelf at the left wall, behind the camera: back, sides, boards and rows of books."""
    x, y = (LEFT_X, LEFT_X + 0.3), (0.8, 2.6)
    yield _span("shelf", OAK, (x[0], x[0] + 0.02), y, (0.0, 2.0))
    for low in (y[0], y[1] - 0.03):
        yield _span("shelf", OAK, x, (low, low + 0.03), (0.0, 2.0))
    for z in (0.0, 0.4, 0.8, 1.2, 1.6, 1.97):
        yield _span("shelf", OAK, x, y, (z, z + 0.03))
    for z, color, end in ((0.43, RED, 2.1), (0.83, BLUE, 1.6), (1.23, GREEN, 2.4)):
        yield _span("shelf", color, (x[0] + 0.02, x[1] - 0.06), (y[0] + 0.05, end), (z, z + 0.26))


def _sofa() -> Iterator[Box]:
    """A sofa at the near wall, behind the camera."""
    yield _span("sofa", BLUE, (0.6, 2.8), (0.05, 0.95), (0.1, 0.42))
    yield _span("sofa", BLUE, (0.6, 2.8), (0.05, 0.3), (0.42, 0.85))
    yield _span("sofa", BLUE, (0.4, 0.6), (0.05, 0.95), (0.1, 0.6))
    yield _span("sofa", BLUE, (2.8, 3.0), (0.05, 0.95), (0.1, 0.6))


def _sideboard() -> Iterator[Box]:
    """A sideboard at the right wall with two doors."""
    front = RIGHT_X - 0.45
    yield _span("sideboard", WHITE, (front, RIGHT_X), (5.6, 7.4), (0.0, 0.75))
    for low in (5.63, 6.52):
        yield _span("sideboard", OAK, (front - 0.02, front), (low, low + 0.85), (0.15, 0.72))


def furnished_room() -> Room:
    """The demo's room: table, chairs, cupboard and a door ahead of the paper's camera position."""
    table_x, table_y = TABLE
    boxes = [*_shell(), *_openings(), *_cupboard(), *_shelf(), *_sofa(), *_sideboard()]
    boxes += [part.placed(table_x, table_y) for part in _table()]
    for x, y, yaw, color in CHAIRS:
        boxes += [part.placed(table_x + x, table_y + y, yaw) for part in _chair(color)]
    return Room(tuple(boxes))
