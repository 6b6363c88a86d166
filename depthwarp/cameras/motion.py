"""Poses on the way from one to another, and rotations as axis and angle or quaternion."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.pose import Pose

__all__ = ["poses_between"]

Float64Array = npt.NDArray[np.float64]


def poses_between(
    start: Pose, end: Pose, moments: npt.ArrayLike
) -> tuple[Float64Array, Float64Array]:
    """Poses of an even motion: position linear, rotation about a fixed axis.

    Args:
        start: Pose at moment 0.
        end: Pose at moment 1.
        moments: Shape (N,).

    Returns:
        Rotations camera_from_world (N, 3, 3) and centres in the world (N, 3) [m], float64.
    """
    import cv2

    t = np.asarray(moments, dtype=np.float64)
    turn = end.rotation @ np.linalg.inv(start.rotation)
    axis = cv2.Rodrigues(turn)[0].ravel()
    steps = np.stack([cv2.Rodrigues(axis * moment)[0] for moment in t])
    centers = start.center_world + t[:, None] * (end.center_world - start.center_world)
    return np.asarray(steps @ start.rotation), centers
