"""TUM trajectories: the convention by hand, round trips, bad files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import depthwarp as dw
from depthwarp.cameras.formats import tum
from depthwarp.cameras.trajectory import Trajectory
from depthwarp.errors import FileFormatError, InputError
from tests.cameras.formats.trajectories import assert_same_poses, random_trajectory

LINE = "1305031102.1758 1.3405 0.6266 1.6575 0.6574 0.6126 -0.2949 -0.3248"


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "trajectory.txt"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_axes_and_direction_of_tum(tmp_path: Path) -> None:
    """Camera to world, optical axes: turned a quarter about its own Y, it looks along world X."""
    half = np.sqrt(0.5)
    path = written(tmp_path, f"# a comment\n\n12.5 1 2 3 0 {half} 0 {half}\n")
    (time, pose), *_ = tum.read_trajectory(path)
    assert time == 12.5
    # Without the quaternion the optical axes are the world's: Z forward, Y down.
    points = np.array([[1.0, 2, 3], [3.0, 2, 3], [1.0, 2, 4], [1.0, 3, 3]])
    expected = [(0, 0, 0), (2, 0, 0), (0, 1, 0), (0, 0, -1)]  # X forward, Y left, Z up
    np.testing.assert_allclose(pose.to_camera(points), expected, atol=1e-15)


def test_a_line_of_the_benchmark(tmp_path: Path) -> None:
    """A line as the benchmark publishes it, four decimals, is the literal quaternion formula."""
    _, pose = next(iter(tum.read_trajectory(written(tmp_path, LINE + "\n"))))
    x, y, z, w = np.array([0.6574, 0.6126, -0.2949, -0.3248]) / np.linalg.norm(
        [0.6574, 0.6126, -0.2949, -0.3248]
    )
    forward = [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]
    np.testing.assert_allclose(pose.rotation[0], forward, atol=1e-15)
    assert pose.position == (1.3405, 0.6266, 1.6575)


def test_tum_comes_back(tmp_path: Path) -> None:
    """Written and read: the same times, the same poses to 1e-12."""
    trajectory = random_trajectory(20)
    tum.write_trajectory(trajectory, tmp_path / "t.txt")
    found = tum.read_trajectory(tmp_path / "t.txt")
    assert found.times == trajectory.times
    assert_same_poses(found, trajectory)
    assert tum.matches(tmp_path / "t.txt")
    assert [entry.name for entry in tmp_path.iterdir()] == ["t.txt"]


def test_poses_rounded_in_the_source_come_back_to_their_rounding(tmp_path: Path) -> None:
    """A rotation that is one to 1e-5 only is written as the nearest rotation, in its place."""
    rotation = dw.Pose.from_orientation((0, 0, 0), (10, 20, 30)).rotation.round(5)
    pose = dw.Pose(tuple(map(tuple, rotation.tolist())), (100.0, -200.0, 300.0))
    tum.write_trajectory(Trajectory((0.0,), (pose,)), tmp_path / "t.txt")
    _, found = next(iter(tum.read_trajectory(tmp_path / "t.txt")))
    np.testing.assert_allclose(found.rotation, rotation, rtol=0, atol=1e-5)
    np.testing.assert_allclose(found.center_world, pose.center_world, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (LINE[:-8], "line 1: expected 8 numbers .* got 7; the file is cut short"),
        (LINE + " 5", "line 1: expected 8 numbers .* got 9"),
        (f"# c\n{LINE}\n{LINE}", "line 3: times must ascend, got 1305031102.1758 after"),
        (
            LINE.replace("0.6574", "0.9574"),
            "line 1: quaternion must have length 1 within 0.001, got w = -0.3248, x = 0.9574",
        ),
        (LINE.replace("0.6266", "nan"), "line 1: .* must be finite numbers, got 'nan'"),
        (LINE.replace("0.6266", "1e999"), "line 1: .* must be finite numbers, got '1e999'"),
        (LINE.replace("0.6266", "0_6"), "line 1: .* must be finite numbers, got '0_6'"),
        (LINE.replace("0.6266", "here"), "line 1: .* must be finite numbers, got 'here'"),
        ("# timestamp tx ty tz\n", "without a pose"),
        ("", "the file is empty"),
        (" \n\n", "the file is empty"),
        (b"\x00\x01\x02\x03", "not a text file"),
        (b"\xff\xd8\xff\xe0", "not a text file"),
    ],
)
def test_bad_tum_files_are_refused(tmp_path: Path, text: str | bytes, message: str) -> None:
    """Cut short, out of order, not numbers, not text, empty: an error that names file and line."""
    path = written(tmp_path, text)
    with pytest.raises(FileFormatError, match=message) as caught:
        tum.read_trajectory(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize("text", ["1 2 3\n", "# only\n", "", "a b c d e f g h\n", b"\0" * 64])
def test_other_files_are_not_taken(tmp_path: Path, text: str | bytes) -> None:
    """Text of another kind, and what is no text, is not taken for a trajectory."""
    path = written(tmp_path, text)
    assert not tum.matches(path)
    assert not tum.matches(tmp_path)


def test_a_missing_folder_is_named(tmp_path: Path) -> None:
    """Writing into a folder that is not there fails before anything is written."""
    with pytest.raises(InputError, match="does not exist"):
        tum.write_trajectory(random_trajectory(2), tmp_path / "no" / "t.txt")
