"""Trajectories for the tests of the formats that hold them."""

from __future__ import annotations

import numpy as np

import depthwarp as dw
from depthwarp.cameras.trajectory import Trajectory


def random_trajectory(count: int) -> Trajectory:
    """Poses of both readings of P_C, turned in any way, within 50 m."""
    rng = np.random.default_rng(count)
    poses = [
        dw.Pose.from_orientation(rng.uniform(-50, 50, 3), rng.uniform(-180, 180, 3), frame)
        for frame in ("world", "rotated") * (count // 2)
    ]
    return Trajectory(tuple(np.cumsum(rng.uniform(0.01, 1, count)).tolist()), tuple(poses))


def assert_same_poses(found: Trajectory, expected: Trajectory) -> None:
    """The same poses to 1e-12, whatever the times."""
    assert len(found) == len(expected)
    for (_, one), (_, other) in zip(found, expected, strict=True):
        np.testing.assert_allclose(one.rotation, other.rotation, rtol=0, atol=1e-12)
        np.testing.assert_allclose(one.center_world, other.center_world, rtol=0, atol=1e-12)
