"""What stands around the twin: the boxes of a room and printed boards, and how they are lit."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError
from depthwarp.scanner.room import Box, Room
from depthwarp.scanner.twin.boards import PAPER, Board

__all__ = ["Scene", "Solids", "wall_scene"]

Float64Array = npt.NDArray[np.float64]
Int32Array = npt.NDArray[np.int32]

LAMP = np.array([0.36, -0.48, 0.8])
"""Where most of the room's light comes from, a unit vector, world frame."""

FRONT = 4
"""Face of a board that carries the print; face 5 is its back."""


@dataclass(frozen=True, eq=False)
class Solids:
    """A scene's boxes and boards alike, as the renderer takes them; a board is a flat box.

    Surface `6 * i + f` is face f (-x, +x, -y, +y, -z, +z) of solid i.

    Attributes:
        world_from_local: Rotations, shape (N, 3, 3).
        centers: Middles, world frame [m], shape (N, 3).
        halves: Half edge lengths [m], shape (N, 3).
        ambient: Red, green, blue of each surface under the room's light, 0 to 1, shape (6 N, 3).
        reflectance: What each surface returns of the laser's green light, 0 to 1, shape (6 N,).
    """

    world_from_local: Float64Array
    centers: Float64Array
    halves: Float64Array
    ambient: Float64Array
    reflectance: Float64Array


@dataclass(frozen=True)
class Scene:
    """A room, boards in it, and the room's light.

    Surfaces scatter evenly. The room's light shades each surface by its direction and casts no
    shadows; the colours of a room are taken as linear reflectances.

    Attributes:
        room: The boxes.
        boards: Printed boards; their surfaces count on after those of the boxes.
        ambient: Grey levels (of 255) a microsecond of a white surface that faces the lamp.
    """

    room: Room
    boards: tuple[Board, ...] = ()
    ambient: float = 0.01
    solids: Solids = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not 0 <= self.ambient < math.inf:
            raise InputError(f"ambient must be a finite number, at least 0, got {self.ambient}")
        if not self.room.boxes and not self.boards:
            raise InputError("a scene needs at least one box or board")
        object.__setattr__(self, "solids", _solids(self.room, self.boards))

    def cast(
        self, origin: Float64Array, directions: Float64Array
    ) -> tuple[Float64Array, Int32Array]:
        """First surface along rays from one point, in float64: distance [m] and surface.

        Args:
            origin: Where the rays start, world frame [m], shape (3,).
            directions: Unit vectors, world frame, shape (N, 3).

        Returns:
            Distances, shape (N,), inf where nothing is hit, and surfaces, shape (N,), -1 there.
        """
        distance, surface = self.room.cast(origin, directions)
        for index in range(len(self.room.boxes), len(self.solids.halves)):
            turn, half = self.solids.world_from_local[index], self.solids.halves[index]
            start, ray = (origin - self.solids.centers[index]) @ turn, directions @ turn
            along = -start[2] / np.where(ray[:, 2] == 0.0, 1e-300, ray[:, 2])
            meets = start[:2] + along[:, None] * ray[:, :2]
            inside = np.all(np.abs(meets) <= half[:2], axis=1)
            hit = np.flatnonzero(inside & (along > 0) & (along < distance))
            distance[hit] = along[hit]
            surface[hit] = 6 * index + FRONT + (ray[hit, 2] < 0)
        return distance, surface

    def normals(self, surface: Int32Array) -> Float64Array:
        """Outward unit normals, world frame, shape (N, 3), of surfaces >= 0, shape (N,)."""
        return _face_normals(self.solids.world_from_local)[surface]


def wall_scene(distance: float, color: tuple[int, int, int] = (255, 255, 255)) -> Scene:
    """One wide, high wall that stands square to the world's X axis.

    Args:
        distance: From the world's origin to the wall's face [m].
        color: Red, green, blue, 0 to 255.
    """
    wall = Box("wall", (distance + 0.5, 0.0, 0.0), (1.0, 400.0, 400.0), color)
    return Scene(Room((wall,)))


def _solids(room: Room, boards: tuple[Board, ...]) -> Solids:
    turns, centers, halves, colors = [], [], [], []
    for box in room.boxes:
        cos, sin = math.cos(math.radians(box.yaw)), math.sin(math.radians(box.yaw))
        turns.append([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        centers.append(box.center)
        halves.append(np.array(box.size) / 2)
        colors.append(box.color)
    for board in boards:
        turns.append(np.asarray(board.world_from_board)[:3, :3].tolist())
        centers.append(tuple(board.center_world))
        halves.append(np.array([*board.size, 0.0]) / 2)
        colors.append((PAPER, PAPER, PAPER))
    rotations = np.array(turns, dtype=np.float64)
    color = np.repeat(np.array(colors, dtype=np.float64) / 255, 6, axis=0)
    color[6 * len(room.boxes) + FRONT :: 6] = 1.0  # the print says the rest
    shade = 0.75 + 0.25 * (_face_normals(rotations) @ LAMP)
    reflectance = color[:, 1].copy()
    return Solids(
        rotations, np.array(centers), np.array(halves), color * shade[:, None], reflectance
    )


def _face_normals(rotations: Float64Array) -> Float64Array:
    faces = np.stack([-np.eye(3), np.eye(3)], axis=1).reshape(6, 3)
    return np.asarray(np.einsum("nij,fj->nfi", rotations, faces).reshape(-1, 3))
