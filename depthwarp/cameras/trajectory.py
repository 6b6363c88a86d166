"""Poses by time, as SLAM systems and motion capture write them."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from depthwarp.cameras.motion import poses_between
from depthwarp.cameras.pose import Pose
from depthwarp.errors import InputError

__all__ = ["Trajectory"]


@dataclass(frozen=True)
class Trajectory:
    """Where a camera was, and looked, at some moments; between them it moves evenly.

    It iterates as (time, pose).

    Attributes:
        times: Moments [s], ascending, no two equal, at least one.
        poses: The pose at each.

    Raises:
        InputError: No pose, another number of poses than of times, or times that are not finite or
            do not ascend (the message names the first).

    Example:
        >>> import depthwarp as dw
        >>> from depthwarp.cameras.trajectory import Trajectory
        >>> poses = [dw.Pose.from_orientation((x, 0, 1), (0, 0, 30 * x)) for x in range(3)]
        >>> walk = Trajectory((0.0, 0.5, 1.0), tuple(poses))
        >>> walk.pose_at(0.75).position
        (1.5, 0.0, 1.0)
    """

    times: tuple[float, ...]
    poses: tuple[Pose, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "times", tuple(float(time) for time in self.times))
        object.__setattr__(self, "poses", tuple(self.poses))
        if not self.times or len(self.times) != len(self.poses):
            raise InputError(
                "a trajectory must have at least one pose and a time for each, got "
                f"{len(self.times)} times and {len(self.poses)} poses"
            )
        for k, time in enumerate(self.times):
            if not math.isfinite(time):
                raise InputError(f"times must be finite, got {time} at index {k}")
            if k and not time > self.times[k - 1]:
                raise InputError(
                    f"times must ascend, got {time} after {self.times[k - 1]} at index {k}; sort "
                    "the poses by time and keep one of each time"
                )

    def __len__(self) -> int:
        return len(self.times)

    def __iter__(self) -> Iterator[tuple[float, Pose]]:
        return zip(self.times, self.poses, strict=True)

    @property
    def span(self) -> tuple[float, float]:
        """First and last moment [s]."""
        return self.times[0], self.times[-1]

    def pose_at(self, time: float) -> Pose:
        """The pose at a moment; see `poses_between` for the way between two.

        Args:
            time: Moment [s], within `span`.

        Raises:
            InputError: A moment outside the span, or not a number: nothing is extrapolated.
        """
        first, last = self.span
        if not first <= time <= last:
            raise InputError(f"time must be from {first} to {last} s, got {time}")
        k = bisect_right(self.times, time) - 1
        before = self.times[k]
        if time == before:
            return self.poses[k]
        part = (time - before) / (self.times[k + 1] - before)
        rotations, centers = poses_between(self.poses[k], self.poses[k + 1], np.array([part]))
        first_row, second_row, third_row = rotations[0].tolist()
        rotation = (tuple(first_row), tuple(second_row), tuple(third_row))
        return Pose(rotation, tuple(centers[0].tolist()))
