"""Scenes as data: which points, seen by which camera. The same fields give the same points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthwarp import PinholeCamera

__all__ = ["RoomScene"]


@dataclass(frozen=True)
class RoomScene:
    """An empty room seen from inside.

    The points are uniform on the floor, the ceiling and the four walls, in random order: the
    hardest order for a Z-buffer, since neighbours in memory are not neighbours in the image.
    """

    point_count: int
    name: str = "room"
    seed: int = 0
    room_m: tuple[float, float, float] = (6.0, 5.0, 2.7)
    image_size: tuple[int, int] = (724, 662)
    fov_deg: tuple[float, float] = (60.0, 56.0)
    position_m: tuple[float, float, float] = (1.79, 3.3, 1.2)
    orientation_deg: tuple[float, float, float] = (0.0, 0.0, -30.0)
    max_range_m: float = 100.0

    def points_world(self) -> npt.NDArray[np.float32]:
        """Points [m], shape (point_count, 3)."""
        generator = np.random.default_rng(self.seed)
        size = np.array(self.room_m, dtype=np.float32)
        areas = np.prod(size) / size  # of a face across each axis
        axis = generator.choice(3, self.point_count, p=areas / areas.sum())
        points = generator.random((self.point_count, 3), dtype=np.float32)
        points[np.arange(self.point_count), axis] = generator.integers(0, 2, self.point_count)
        return points * size

    def camera(self) -> PinholeCamera:
        """The camera, inside the room."""
        return PinholeCamera.from_fov(
            fov=self.fov_deg,
            size=self.image_size,
            position=self.position_m,
            orientation=self.orientation_deg,
        )
