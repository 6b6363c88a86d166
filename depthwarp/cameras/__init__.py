"""Cameras: where one looks from, and through which lens."""

from depthwarp.cameras.camera import Camera, DepthKind
from depthwarp.cameras.double_sphere import DoubleSphereCamera
from depthwarp.cameras.fisheye import FisheyeCamera
from depthwarp.cameras.orthographic import OrthographicCamera
from depthwarp.cameras.panorama import CylindricalCamera, EquirectangularCamera
from depthwarp.cameras.pinhole import PinholeCamera
from depthwarp.cameras.pose import Pose, PositionFrame
from depthwarp.cameras.spinning import SpinningLidar

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
    "SpinningLidar",
]
