"""Many worlds of one size: the empty room, each world with a camera and points of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
import numpy.typing as npt

import depthwarp as dw
from benchmarks.scenes import RoomScene

__all__ = ["SimScene"]

Float32Array = npt.NDArray[np.float32]

POINT_BYTES, PIXEL_BYTES = 100, 64
"""What all peers together hold at most of a point and of a pixel."""

WALL_M = 1.0
"""Cameras stay so far away from the walls."""


@dataclass(frozen=True)
class SimScene:
    """One camera in each of many worlds.

    Attributes:
        worlds: Number of worlds.
        side: Width and height of an image [px].
        points: Points of a world.
        room: Whose faces they lie on.
        fov_deg: Horizontal and vertical.
    """

    worlds: int
    side: int
    points: int
    room: RoomScene = RoomScene(0, max_range_m=15.0)
    fov_deg: float = 90.0

    def __str__(self) -> str:
        world = "world" if self.worlds == 1 else "worlds"
        return f"{self.worlds:,} {world} x {self.side} x {self.side} px x {self.points:,} points"

    @property
    def work(self) -> int:
        """Points and pixels of all worlds."""
        return self.worlds * (self.points + self.side**2)

    @property
    def memory_bytes(self) -> int:
        """What all peers together may need."""
        return self.worlds * (POINT_BYTES * self.points + PIXEL_BYTES * self.side**2)

    @property
    def lens(self) -> dw.PinholeCamera:
        """The camera of all worlds; its pose does not matter."""
        return dw.PinholeCamera.from_fov((self.fov_deg,) * 2, (self.side, self.side))

    def points_world(self) -> Float32Array:
        """Points [m], other ones in every world, shape (worlds, points, 3)."""
        return _points_in(self.room, self.worlds, self.points)

    def poses(self) -> Float32Array:
        """World to optical axes, somewhere in the room and level, shape (worlds, 1, 4, 4)."""
        rng = np.random.default_rng(self.room.seed)
        size = np.array(self.room.room_m)
        places = rng.uniform(WALL_M, size - WALL_M, (self.worlds, 3))
        yaws = rng.uniform(-180, 180, self.worlds)
        matrices = [
            dw.Pose.from_orientation(place, (0, 0, yaw)).optical_from_world
            for place, yaw in zip(places, yaws, strict=True)
        ]
        return np.array(matrices, np.float32)[:, None]


@lru_cache(maxsize=1)
def _points_in(room: RoomScene, worlds: int, points: int) -> Float32Array:
    """Kept, so that all peers of a scene share them."""
    made = replace(room, point_count=worlds * points).points_world()
    return made.reshape(worlds, points, 3)
