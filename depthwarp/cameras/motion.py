"""Poses on the way from one to another: even motion, without a turn more than needed."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.pose import Pose
from depthwarp.cameras.quaternion import quaternion_from_rotation, rotation_from_quaternion

__all__ = ["poses_between"]

Float64Array = npt.NDArray[np.float64]


def poses_between(
    start: Pose, end: Pose, moments: npt.ArrayLike
) -> tuple[Float64Array, Float64Array]:
    """Poses of an even motion: position linear, rotation about a fixed axis at constant speed.

    Of the two ways to turn it goes the shorter: Shoemake's spherical linear interpolation (slerp).

    Args:
        start: Pose at moment 0.
        end: Pose at moment 1.
        moments: Shape (N,).

    Returns:
        Rotations camera_from_world (N, 3, 3) and centres in the world (N, 3) [m], float64.
    """
    t = np.asarray(moments, dtype=np.float64)
    turn = quaternion_from_rotation(end.rotation @ np.linalg.inv(start.rotation))
    sine = float(np.linalg.norm(turn[1:]))
    half = np.arctan2(sine, turn[0]) * t[:, None]
    axis = turn[1:] / sine if sine > 0 else turn[1:]
    steps = np.concatenate([np.cos(half), np.sin(half) * axis], axis=1)
    centers = start.center_world + t[:, None] * (end.center_world - start.center_world)
    return rotation_from_quaternion(steps) @ start.rotation, centers
