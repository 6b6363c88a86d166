"""Real clouds as scenes, where the folder of real scans lies beside the project."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np

import depthwarp as dw
from benchmarks.scenes import Float32Array, Scene, Vector
from depthwarp.errors import FileFormatError

__all__ = ["KitchenScene", "KittiScene", "RealScene", "RoomScanScene"]

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"

FARTHEST_MM = 10_000
"""Depth of the Kinect beyond which its files hold no depth but marks."""


@dataclass(frozen=True)
class RealScene(Scene):
    """The points of a file, in its order; those that are not finite are left out.

    Attributes:
        file: Relative to the folder of real scans.
        point_count: Not used: the file has its own.
    """

    point_count: int = 0
    file: str = ""

    made_order: ClassVar[str] = "file"
    usual_counts: ClassVar[tuple[int, ...]] = (0,)

    @property
    def missing(self) -> str | None:
        """That the file is not there."""
        return None if self.path.is_file() else f"there is no file {self.path}"

    @property
    def path(self) -> Path:
        """Where the file is expected."""
        return DATA / self.file

    def make_points(self, generator: np.random.Generator) -> Float32Array:
        """Points of the file."""
        points = dw.read(self.path).points_world
        return points[np.isfinite(points).all(axis=1)]


@dataclass(frozen=True)
class RoomScanScene(RealScene):
    """A laser scan of a whole room, 0.1 million points; the camera stands beside the scanner."""

    name: str = "room_scan"
    file: str = "indoor/room_scan1.pcd"
    position_m: Vector = (0.5, 0.5, 0.0)


@dataclass(frozen=True)
class KittiScene(RealScene):
    """A turn of a car's LiDAR with 64 beams, 0.1 million points, seen from behind and above."""

    name: str = "kitti"
    file: str = "kitti/testing_000000.bin"
    position_m: Vector = (-4.0, 0.0, 2.0)


@dataclass(frozen=True)
class KitchenScene(RealScene):
    """Forty depth images of a Kinect in a kitchen, fused: 11 million points, seen by the Kinect."""

    name: str = "kitchen"
    file: str = "rgbd_kitchen/frames.json"
    image_size: tuple[int, int] = (640, 480)

    made_order: ClassVar[str] = "frame"

    def make_points(self, generator: np.random.Generator) -> Float32Array:
        """Points of all frames."""
        clouds = []
        for camera, file in self._frames():
            depth_mm = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
            if depth_mm is None:
                raise FileFormatError(f"{file} is missing or no image: copy the whole folder again")
            row, column = np.nonzero((depth_mm > 0) & (depth_mm < FARTHEST_MM))
            z = depth_mm[row, column] / 1000.0
            x, y = (column - camera.cx) / camera.fx, (row - camera.cy) / camera.fy
            forward_left_up = np.stack([z, -x * z, -y * z], axis=1)
            clouds.append(camera.pose.to_world(forward_left_up).astype(np.float32))
        return np.concatenate(clouds)

    def camera(self) -> dw.PinholeCamera:
        """The Kinect of the first frame."""
        return self.cameras(1)[0]

    def cameras(self, count: int) -> list[dw.PinholeCamera]:
        """The Kinect's own places, again from the first after the last."""
        frames = self._frames()
        return [frames[view % len(frames)][0] for view in range(count)]

    def _frames(self) -> list[tuple[dw.PinholeCamera, Path]]:
        about = json.loads(self.path.read_text(encoding="utf-8"))
        frames = []
        for frame in about["frames"]:
            world_from_optical = np.array(frame["T_world_from_camera"])
            left, _, right = np.linalg.svd(world_from_optical[:3, :3])
            world_from_optical[:3, :3] = left @ right  # the nearest rotation to the file's
            optical_from_world = np.linalg.inv(world_from_optical)
            camera = dw.PinholeCamera.from_matrix(
                about["K"], self.image_size, optical_from_world=optical_from_world
            )
            frames.append((camera, self.path.parent / frame["depth"]))
        return frames
