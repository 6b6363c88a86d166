"""Cameras as plain numbers, for JSON: what a depth map's files say of the camera that made it."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from depthwarp.cameras.camera import Camera
from depthwarp.cameras.double_sphere import DoubleSphereCamera
from depthwarp.cameras.fisheye import FisheyeCamera
from depthwarp.cameras.orthographic import OrthographicCamera
from depthwarp.cameras.panorama import CylindricalCamera, EquirectangularCamera
from depthwarp.cameras.pinhole import PinholeCamera
from depthwarp.cameras.pose import Pose
from depthwarp.cameras.spinning import SpinningLidar

__all__ = ["MODELS", "camera_from_dict", "camera_to_dict"]

MODELS: dict[str, type[Camera]] = {
    "pinhole": PinholeCamera,
    "fisheye": FisheyeCamera,
    "double_sphere": DoubleSphereCamera,
    "equirectangular": EquirectangularCamera,
    "cylindrical": CylindricalCamera,
    "orthographic": OrthographicCamera,
    "spinning_lidar": SpinningLidar,
}
"""Camera models by the names that files use."""

NAMES = {model: name for name, model in MODELS.items()}


def camera_to_dict(camera: Camera) -> dict[str, Any]:
    """A camera as numbers, lists and text, from which `camera_from_dict` makes an equal one.

    Beside the model's own fields it holds, for other programs, `optical_from_world` (4 x 4,
    OpenCV's axes) and, where the model has one, the intrinsic matrix `K`.
    """
    entries: dict[str, Any] = {"model": NAMES[type(camera)]}
    for field in fields(camera):  # type: ignore[arg-type]
        value = getattr(camera, field.name)
        entries[field.name] = _pose_to_dict(value) if isinstance(value, Pose) else value
    if isinstance(camera, PinholeCamera | FisheyeCamera):
        entries["K"] = camera.K.tolist()
    entries["optical_from_world"] = camera.pose.optical_from_world.tolist()
    return entries


def camera_from_dict(entries: dict[str, Any]) -> Camera:
    """The camera that `camera_to_dict` described.

    Raises:
        KeyError: An entry is missing.
        ValueError: An unknown model, or a value out of its range.
        TypeError: A value of another type.
    """
    name = entries["model"]
    if name not in MODELS:
        raise ValueError(f"unknown camera model {name!r}, known are {', '.join(MODELS)}")
    model = MODELS[name]
    values = {}
    for field in fields(model):  # type: ignore[arg-type]
        value = entries[field.name]
        if field.name.startswith("pose") and value is not None:
            value = _pose_from_dict(value)
        elif isinstance(value, list):
            value = tuple(value)
        values[field.name] = value
    return model(**values)


def _pose_to_dict(pose: Pose) -> dict[str, Any]:
    return {
        "camera_from_world": pose.camera_from_world,
        "position": pose.position,
        "shift": pose.shift,
    }


def _pose_from_dict(entries: dict[str, Any]) -> Pose:
    first, second, third = (tuple(row) for row in entries["camera_from_world"])
    return Pose((first, second, third), tuple(entries["position"]), tuple(entries["shift"]))
