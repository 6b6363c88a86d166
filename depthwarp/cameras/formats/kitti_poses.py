"""Ground truth of KITTI's odometry benchmark: a 3 x 4 matrix a line, 12 numbers, no times.

Source: Geiger, Lenz, Urtasun 2012, and the readme of the benchmark's development kit.
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
from depthwarp.cameras.formats.optical import check_rotation, optical_of_pose, pose_of_optical
from depthwarp.cameras.trajectory import Trajectory
from depthwarp.errors import FileFormatError

__all__ = ["CONVENTION", "NAME", "matches", "read_trajectory", "write_trajectory"]

NAME = "kitti_poses"

CONVENTION = (
    "Camera to world, 3 x 4, row by row [m]: the world is the frame of the first pose, both have "
    "optical axes (X right, Y down, Z forward); no times, so the line number from 0 stands in for "
    "them; no lens."
)


def matches(path: Path) -> bool:
    """Whether the file's first line is twelve numbers."""
    return begins_with_numbers(path, 12)


def read_trajectory(path: Path) -> Trajectory:
    """Read a trajectory; its times are 0, 1, 2, ..., the numbers of the frames.

    Raises:
        FileFormatError: A line that is not twelve finite numbers or no rotation, or no pose; the
            message names the line.
    """
    poses = []
    for line, text in data_lines(path):
        words = text.split()
        if len(words) != 12:
            raise FileFormatError(
                f"{path}: line {line}: expected 12 numbers, a 3 x 4 matrix, got {len(words)}; the "
                "file is cut short or no list of KITTI poses"
            )
        matrix = np.reshape(finite_numbers(path, line, words, "the matrix"), (3, 4))
        with place_errors(path, f"line {line}"):
            check_rotation("the pose", matrix[:, :3])
        poses.append(pose_of_optical(matrix[:, :3], matrix[:, 3]))
    if not poses:
        raise FileFormatError(f"{path}: no pose in it; copy or write it again")
    return Trajectory(tuple(float(k) for k in range(len(poses))), tuple(poses))


def write_trajectory(trajectory: Trajectory, path: Path) -> None:
    """Write the poses with all digits, without the times, which the format cannot hold.

    The file appears whole or not at all.

    Raises:
        InputError: A path that cannot be written.
    """
    lines = []
    for _, pose in trajectory:
        matrix = np.column_stack(optical_of_pose(pose))
        lines.append(" ".join(map(repr, matrix.ravel().tolist())) + "\n")
    write_text(path, "".join(lines))
