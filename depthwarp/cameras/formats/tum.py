"""Trajectories of the TUM RGB-D benchmark: `timestamp tx ty tz qx qy qz qw` a line.

Source: Sturm et al. 2012, "A benchmark for the evaluation of RGB-D SLAM systems".
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from depthwarp.cameras.formats.content import write_text
from depthwarp.cameras.formats.lines import (
    begins_with_numbers,
    data_lines,
    finite_numbers,
    place_errors,
)
from depthwarp.cameras.formats.optical import optical_of_pose, pose_of_optical
from depthwarp.cameras.pose import Pose
from depthwarp.cameras.quaternion import quaternion_from_rotation, rotation_from_quaternion
from depthwarp.cameras.trajectory import Trajectory
from depthwarp.errors import FileFormatError

__all__ = ["CONVENTION", "NAME", "matches", "read_trajectory", "write_trajectory"]

NAME = "tum"

CONVENTION = (
    "Pose of the camera in the world, so camera to world: position [m] and quaternion with the "
    "scalar last (qx, qy, qz, qw), optical axes (X right, Y down, Z forward), times in seconds; "
    "no lens."
)

COLUMNS = "timestamp tx ty tz qx qy qz qw"


def matches(path: Path) -> bool:
    """Whether the file's first line without a comment is eight numbers."""
    return begins_with_numbers(path, 8)


def read_trajectory(path: Path) -> Trajectory:
    """Read a trajectory; lines that begin with `#` are comments.

    Raises:
        FileFormatError: A line that is not eight finite numbers, a quaternion that is not of length
            1 within 0.001, times that do not ascend, or no pose; the message names the line.
    """
    poses: list[Pose] = []
    rows: list[list[float]] = []
    for line, text in data_lines(path):
        words = text.split()
        if len(words) != 8:
            raise FileFormatError(
                f"{path}: line {line}: expected 8 numbers ({COLUMNS}), got {len(words)}; the file "
                "is cut short or no TUM trajectory"
            )
        numbers = finite_numbers(path, line, words, COLUMNS)
        if rows and not numbers[0] > rows[-1][0]:
            raise FileFormatError(
                f"{path}: line {line}: times must ascend, got {words[0]} after {rows[-1][0]}; sort "
                "the lines and keep one of each time"
            )
        with place_errors(path, f"line {line}"):
            rotation = rotation_from_quaternion([numbers[7], *numbers[4:7]])
        poses.append(pose_of_optical(rotation, np.array(numbers[1:4])))
        rows.append(numbers)
    if not rows:
        raise FileFormatError(f"{path}: a TUM trajectory without a pose; copy or write it again")
    return Trajectory(tuple(row[0] for row in rows), tuple(poses))


def write_trajectory(trajectory: Trajectory, path: Path) -> None:
    """Write a trajectory with all digits; the file appears whole or not at all.

    Raises:
        InputError: A path that cannot be written.
    """
    lines = [f"# {CONVENTION}", f"# {COLUMNS}"]
    for time, pose in trajectory:
        rotation, center = optical_of_pose(pose)
        w, x, y, z = quaternion_from_rotation(rotation).tolist()
        lines.append(" ".join(map(repr, (time, *center.tolist(), x, y, z, w))))
    write_text(path, "\n".join(lines) + "\n")
