"""A scene: what stands in it, where it is scanned from, and where it is looked at from."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from benchmarks.quality.solids import Solid, Vector
from depthwarp import PinholeCamera, Pose

__all__ = ["FOCAL_PX", "IMAGE_SIZE", "Look", "Scene"]

IMAGE_SIZE = (724, 662)
FOCAL_PX = 600.0


@dataclass(frozen=True)
class Look:
    """Where a camera stands, and what its middle points at; world frame [m]."""

    position: Vector
    target: Vector

    def camera(self, size: tuple[int, int] = IMAGE_SIZE, focal: float = FOCAL_PX) -> PinholeCamera:
        """The camera, its columns level; focal length [px]."""
        forward = np.subtract(self.target, self.position)
        forward /= np.linalg.norm(forward)
        yaw = math.degrees(math.atan2(forward[1], forward[0]))
        pitch = -math.degrees(math.asin(forward[2]))  # positive looks down
        width, height = size
        pose = Pose.from_orientation(self.position, (0.0, pitch, yaw))
        middle = (width - 1) / 2, (height - 1) / 2
        return PinholeCamera(focal, focal, *middle, width, height, pose)


@dataclass(frozen=True)
class Scene:
    """A scene as data; the same name is always the same scene.

    Attributes:
        name: Its name.
        solids: What stands there.
        scanners: Where it is scanned from [m].
        looks: Where it is looked at from, at least 0.5 m from every scanner.
        scanner_reach: Farthest return [m].
    """

    name: str
    solids: tuple[Solid, ...]
    scanners: tuple[Vector, ...]
    looks: tuple[Look, ...]
    scanner_reach: float
