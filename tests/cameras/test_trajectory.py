"""Trajectories: exact at their poses, even between them, and nothing beyond."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.cameras.motion import poses_between
from depthwarp.cameras.quaternion import quaternion_from_rotation, rotation_from_quaternion
from depthwarp.cameras.trajectory import Trajectory
from depthwarp.errors import InputError

angles = st.floats(-180, 180)
orientations = st.tuples(angles, angles, angles)
positions = st.tuples(*[st.floats(-100, 100)] * 3)
poses = st.builds(dw.Pose.from_orientation, positions, orientations)


def pose(x: float, yaw: float) -> dw.Pose:
    return dw.Pose.from_orientation((x, 0, 1), (0, 0, yaw))


def angle_between(first: np.ndarray, second: np.ndarray) -> float:
    """Angle of the turn between two rotations [rad], exact also when small."""
    turn = second @ first.T
    sine = np.linalg.norm(
        [turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]
    )
    return math.atan2(sine, np.trace(turn) - 1)


WALK = Trajectory((10.0, 10.5, 12.0), (pose(0, 0), pose(1, 30), pose(2, -20)))


def test_it_has_a_length_a_span_and_iterates() -> None:
    """len, span and the pairs of time and pose, in order."""
    assert len(WALK) == 3
    assert WALK.span == (10.0, 12.0)
    assert list(WALK) == list(zip(WALK.times, WALK.poses, strict=True))


def test_its_own_moments_give_its_own_poses() -> None:
    """At a time of the trajectory the very pose comes back, at the ends too."""
    for time, expected in WALK:
        assert WALK.pose_at(time) is expected


def test_between_two_poses_it_moves_evenly() -> None:
    """A third of the way: a third of the distance and a third of the turn."""
    third = WALK.pose_at(11.0)
    np.testing.assert_allclose(third.position, (1 + 1 / 3, 0, 1), atol=1e-12)
    expected = dw.Pose.from_orientation((0, 0, 0), (0, 0, 30 - 50 / 3)).rotation
    np.testing.assert_allclose(third.rotation, expected, atol=1e-15)


def test_one_pose_is_a_trajectory() -> None:
    """A single pose can be asked for at its own time, and at no other."""
    still = Trajectory((5.0,), (pose(0, 0),))
    assert still.pose_at(5) == pose(0, 0)
    with pytest.raises(InputError, match=r"from 5\.0 to 5\.0 s"):
        still.pose_at(5.1)


@given(poses, poses, st.floats(0, 1))
def test_the_turn_has_constant_speed(start: dw.Pose, end: dw.Pose, part: float) -> None:
    """The angle from the start is that part of the whole angle, which is at most a half turn."""
    rotations, centers = poses_between(start, end, [part])
    whole = angle_between(start.rotation, end.rotation)
    assert angle_between(start.rotation, rotations[0]) == pytest.approx(part * whole, abs=1e-13)
    expected = (1 - part) * start.center_world + part * end.center_world
    np.testing.assert_allclose(centers[0], expected, rtol=0, atol=1e-12)


@given(poses, poses)
def test_the_ends_are_the_poses(start: dw.Pose, end: dw.Pose) -> None:
    """At moment 0 the start exactly, at moment 1 the end to rounding."""
    rotations, centers = poses_between(start, end, [0.0, 1.0])
    np.testing.assert_array_equal(rotations[0], start.rotation)
    np.testing.assert_array_equal(centers[0], start.center_world)
    np.testing.assert_allclose(rotations[1], end.rotation, rtol=0, atol=5e-15)
    np.testing.assert_allclose(centers[1], end.center_world, rtol=0, atol=1e-12)


@given(poses, poses, st.floats(0, 1))
def test_it_is_the_spherical_linear_interpolation(
    start: dw.Pose, end: dw.Pose, part: float
) -> None:
    """Shoemake's formula on the two quaternions gives the same rotation."""
    p = quaternion_from_rotation(start.rotation)
    q = quaternion_from_rotation(end.rotation)
    q = q if p @ q >= 0 else -q
    omega = math.atan2(np.linalg.norm(p - q), np.linalg.norm(p + q)) * 2
    # The formula divides by sin(omega); at a half turn both ways are as short.
    assume(1e-3 < omega < math.pi / 2 - 1e-6)
    mixed = (math.sin((1 - part) * omega) * p + math.sin(part * omega) * q) / math.sin(omega)
    rotations, _ = poses_between(start, end, [part])
    np.testing.assert_allclose(rotations[0], rotation_from_quaternion(mixed), rtol=0, atol=1e-11)


@pytest.mark.parametrize("angle", [1e-12, 1e-7, 1e-3, 3.1, math.pi - 1e-7])
def test_tiny_turns_and_near_half_turns_keep_their_digits(angle: float) -> None:
    """Half of a turn of any size is half of it."""
    axis = np.array([0.6, -0.48, 0.64])
    start = pose(0, 0)
    rotation = cv2.Rodrigues(axis * angle)[0] @ start.rotation
    end = dw.Pose(tuple(map(tuple, rotation.tolist())), (0, 0, 0))
    rotations, _ = poses_between(start, end, [0.5])
    measured = angle_between(start.rotation, rotations[0])
    assert measured == pytest.approx(angle / 2, rel=1e-9, abs=2e-16)


def test_a_turn_goes_the_shorter_way() -> None:
    """From 170 to -170 degrees it passes 180, not 0."""
    turn = Trajectory((0.0, 1.0), (pose(0, 170), pose(0, -170)))
    expected = dw.Pose.from_orientation((0, 0, 0), (0, 0, 180)).rotation
    np.testing.assert_allclose(turn.pose_at(0.5).rotation, expected, atol=1e-15)


def test_a_shift_after_the_rotation_is_a_place_too() -> None:
    """Poses of the paper's reading move by their centres in the world."""
    shifted = dw.Pose.from_orientation((1, 2, 3), (0, 0, 90), "rotated")
    move = Trajectory((0.0, 1.0), (shifted, pose(5, 90)))
    expected = 0.5 * (shifted.center_world + np.array([5, 0, 1]))
    np.testing.assert_allclose(move.pose_at(0.5).center_world, expected, atol=1e-14)


@pytest.mark.parametrize("time", [9.999, 12.001, math.nan, math.inf])
def test_nothing_is_extrapolated(time: float) -> None:
    """Outside, the error names the span and what was asked for."""
    with pytest.raises(InputError, match=rf"time must be from 10\.0 to 12\.0 s, got {time}"):
        WALK.pose_at(time)


@pytest.mark.parametrize(
    ("times", "count", "message"),
    [
        ((), 0, "0 times and 0 poses"),
        ((1.0, 2.0), 1, "2 times and 1 poses"),
        ((1.0, 1.0), 2, "times must ascend, got 1.0 after 1.0 at index 1"),
        ((1.0, 0.5), 2, "times must ascend, got 0.5 after 1.0 at index 1"),
        ((1.0, math.nan), 2, "times must be finite, got nan at index 1"),
        ((-math.inf, 0.0), 2, "times must be finite, got -inf at index 0"),
    ],
)
def test_bad_times_are_refused(times: tuple[float, ...], count: int, message: str) -> None:
    """No poses, other numbers of them, and times that do not ascend: an error that says where."""
    with pytest.raises(InputError, match=message):
        Trajectory(times, (pose(0, 0),) * count)
