"""Cameras: where one looks from, and through which lens."""

from depthwarp.cameras.pinhole import DepthKind, PinholeCamera
from depthwarp.cameras.pose import Pose, PositionFrame

__all__ = ["DepthKind", "PinholeCamera", "Pose", "PositionFrame"]
