"""The rotating measuring head of the paper's Section 2, simulated: a room in, a point cloud out."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthwarp.checks import check_finite_vector, check_positive
from depthwarp.cloud import PointCloud
from depthwarp.errors import InputError
from depthwarp.scanner.room import Room

__all__ = ["RotatingHead"]

MAX_RAYS = 10**8
"""Most rays of one scan: its working arrays then still fit an ordinary machine's memory."""

FRAMES_A_STEP = 200
"""Frames scanned between two reports of progress."""


@dataclass(frozen=True)
class RotatingHead:
    """A head that turns a vertical laser fan through 360 degrees and measures one frame a step.

    Frame k stands at angle `360 k / frames`, counter-clockwise from the world's X axis. Its rays
    are spread evenly over the fan, which is centred on the horizon.

    Attributes:
        position: Where the fan starts, world frame [m].
        frames: Frames in one turn.
        points_a_frame: Rays of the fan, lowest first.
        fan: Opening angle of the fan [degrees].
        max_range: Farthest distance that is measured [m].
        range_noise: Standard deviation of the measured distance [m].
        min_incidence: A ray that meets a surface at a smaller angle returns nothing [degrees].
    """

    position: tuple[float, float, float]
    frames: int = 4000
    points_a_frame: int = 80
    fan: float = 90.0
    max_range: float = 15.0
    range_noise: float = 0.003
    min_incidence: float = 3.0

    def __post_init__(self) -> None:
        check_finite_vector("position", self.position, 3)
        check_positive("max_range", self.max_range, "m")
        if self.frames < 1 or self.points_a_frame < 1:
            raise InputError(
                "frames and points_a_frame must be at least 1, "
                f"got {self.frames} and {self.points_a_frame}"
            )
        if self.frames * self.points_a_frame > MAX_RAYS:
            raise InputError(
                f"{self.frames} frames of {self.points_a_frame} points are more than {MAX_RAYS} "
                "rays: use fewer frames"
            )
        # Written so that NaN fails each of them.
        if not 0 < self.fan < 180:
            raise InputError(f"fan must be between 0 and 180 degrees, got {self.fan}")
        if not 0 <= self.range_noise < math.inf:
            raise InputError(f"range_noise must be finite, at least 0, got {self.range_noise}")
        if not 0 <= self.min_incidence < 90:
            raise InputError(
                f"min_incidence must be 0 or more and below 90 degrees, got {self.min_incidence}"
            )

    def angles(self) -> npt.NDArray[np.float64]:
        """Turning angle of each frame [degrees], shape (frames,)."""
        return np.linspace(0.0, 360.0, self.frames, endpoint=False)

    def directions(self, angles: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Unit directions, world frame, shape (len(angles) * points_a_frame, 3), frame by frame."""
        half = self.fan / 2 if self.points_a_frame > 1 else 0.0
        elevation = np.radians(np.linspace(-half, half, self.points_a_frame))
        azimuth = np.radians(angles)[:, None]
        x = np.cos(elevation) * np.cos(azimuth)
        y = np.cos(elevation) * np.sin(azimuth)
        z = np.broadcast_to(np.sin(elevation), x.shape)
        return np.stack([x, y, z], axis=-1).reshape(-1, 3)

    def scan(
        self, room: Room, *, seed: int, progress: Callable[[int, int], None] | None = None
    ) -> PointCloud:
        """Measure a room in one full turn.

        Args:
            room: What the rays meet.
            seed: Seed of the range noise; the same seed gives the same cloud.
            progress: Called with the frames done and the frames in all.

        Returns:
            The measured points in the world frame, frame by frame, with the attributes `color`
            (N, 3) uint8, `frame` (N,) int32 and `angle` (N,) float32 [degrees].

        Raises:
            InputError: The head stands inside a solid part of the room.
        """
        solid = room.solid_at(self.position)
        if solid is not None:
            raise InputError(
                f"the head's position {self.position} lies inside the {solid}: move it"
            )
        random = np.random.default_rng(seed)
        parts = []
        for first in range(0, self.frames, FRAMES_A_STEP):
            frames = np.arange(first, min(first + FRAMES_A_STEP, self.frames), dtype=np.int32)
            parts.append(self._measure(room, frames, random))
            if progress is not None:
                progress(int(frames[-1]) + 1, self.frames)
        points, color, frame = (np.concatenate(column) for column in zip(*parts, strict=True))
        angle = self.angles()[frame].astype(np.float32)
        return PointCloud(points, {"color": color, "frame": frame, "angle": angle})

    def _measure(
        self, room: Room, frames: npt.NDArray[np.int32], random: np.random.Generator
    ) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.uint8], npt.NDArray[np.int32]]:
        """Points [m], colours and frame numbers of the rays of some frames that return."""
        rays = self.directions(self.angles()[frames])
        distance, surface = room.cast(self.position, rays)
        # Drawn for every ray, so that one ray's noise does not depend on what the others meet.
        measured = distance + random.normal(0.0, self.range_noise, len(rays))
        met = np.flatnonzero(surface >= 0)
        sine = np.abs(np.einsum("ij,ij->i", rays[met], room.normals(surface[met])))
        seen = (sine >= math.sin(math.radians(self.min_incidence))) & (
            (measured[met] > 0) & (measured[met] <= self.max_range)
        )
        kept, brightness = met[seen], 0.6 + 0.4 * sine[seen]
        points = np.asarray(self.position) + measured[kept, None] * rays[kept]
        color = room.colors(surface[kept]) * brightness[:, None]
        frame = np.repeat(frames, self.points_a_frame)[kept]
        return points.astype(np.float32), color.astype(np.uint8), frame
