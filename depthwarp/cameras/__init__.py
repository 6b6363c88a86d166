"""Cameras: where one looks from, and through which lens."""

from depthwarp.cameras.camera import Camera, DepthKind
from depthwarp.cameras.double_sphere import DoubleSphereCamera
from depthwarp.cameras.fisheye import FisheyeCamera
from depthwarp.cameras.formats import (
    load,
    load_rig,
    load_trajectory,
    save,
    save_trajectory,
)
from depthwarp.cameras.orthographic import OrthographicCamera
from depthwarp.cameras.panorama import CylindricalCamera, EquirectangularCamera
from depthwarp.cameras.pinhole import PinholeCamera
from depthwarp.cameras.pose import Pose, PositionFrame
from depthwarp.cameras.rig import Rig
from depthwarp.cameras.spinning import SpinningLidar
from depthwarp.cameras.trajectory import Trajectory

__all__ = [
    "Camera",
    "CylindricalCamera",
    "DepthKind",
    "DoubleSphereCamera",
    "EquirectangularCamera",
    "FisheyeCamera",
    "OrthographicCamera",
    "PinholeCamera",
    "Pose",
    "PositionFrame",
    "Rig",
    "SpinningLidar",
    "Trajectory",
    "load",
    "load_rig",
    "load_trajectory",
    "save",
    "save_trajectory",
]
