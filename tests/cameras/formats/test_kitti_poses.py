"""Poses of KITTI's odometry benchmark: the convention by hand, round trips, bad files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from depthwarp.cameras.formats import kitti_poses, tum
from depthwarp.errors import FileFormatError, InputError
from tests.cameras.formats.trajectories import assert_same_poses, random_trajectory


def written(folder: Path, text: str) -> Path:
    path = folder / "00.txt"
    path.write_text(text)
    return path


def test_axes_and_direction(tmp_path: Path) -> None:
    """A 3 x 4 matrix from camera to world, row by row; times count the lines."""
    path = written(tmp_path, "1 0 0 0 0 1 0 0 0 0 1 0\n0 0 1 1 0 1 0 2 -1 0 0 3\n")
    assert kitti_poses.matches(path)
    assert not tum.matches(path)
    trajectory = kitti_poses.read_trajectory(path)
    assert trajectory.times == (0.0, 1.0)
    points = np.array([[1.0, 2, 3], [3.0, 2, 3], [1.0, 2, 4], [1.0, 3, 3]])
    expected = [(0, 0, 0), (2, 0, 0), (0, 1, 0), (0, 0, -1)]  # X forward, Y left, Z up
    np.testing.assert_allclose(trajectory.poses[1].to_camera(points), expected, atol=1e-15)


def test_poses_come_back(tmp_path: Path) -> None:
    """Written and read: the same poses to 1e-12; the times are the lines' numbers."""
    trajectory = random_trajectory(10)
    kitti_poses.write_trajectory(trajectory, tmp_path / "00.txt")
    found = kitti_poses.read_trajectory(tmp_path / "00.txt")
    assert found.times == tuple(map(float, range(10)))
    assert_same_poses(found, trajectory)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 0 0 0 0 1 0 0 0 0 1\n", "line 1: expected 12 numbers, a 3 x 4 matrix, got 11"),
        ("1 0 0 0 0 1 0 0 0 0 2 0\n", "line 1: the pose: .* identity by 3, determinant 2"),
        ("1 0 0 0 0 1 0 0 0 0 -1 0\n", "line 1: the pose: .* determinant -1"),
        ("1 0 0 0 0 1 0 inf 0 0 1 0\n", "line 1: the matrix must be finite numbers, got 'inf'"),
        ("# nothing\n", "no pose in it"),
        ("", "the file is empty"),
    ],
)
def test_bad_files_are_refused(tmp_path: Path, text: str, message: str) -> None:
    """Cut short, no rotation, not finite, empty: an error that names the line."""
    with pytest.raises(FileFormatError, match=message):
        kitti_poses.read_trajectory(written(tmp_path, text))


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    """Writing into a folder that is not there fails before anything is written."""
    with pytest.raises(InputError, match="does not exist"):
        kitti_poses.write_trajectory(random_trajectory(2), tmp_path / "no" / "00.txt")


def test_other_files_are_not_taken(tmp_path: Path) -> None:
    """Other text and folders are left to other formats."""
    for text in ("1 2 3\n", "# only\n", "", "P0: 1 2 3 4 5 6 7 8 9 10 11\n"):
        assert not kitti_poses.matches(written(tmp_path, text))
    assert not kitti_poses.matches(tmp_path)
