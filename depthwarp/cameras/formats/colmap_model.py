"""What a COLMAP model says of its cameras and images, and what that is as a rig.

Source: COLMAP's documentation, "Camera Models" and "Output Format".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from depthwarp.cameras.camera import Camera
from depthwarp.cameras.fisheye import FisheyeCamera
from depthwarp.cameras.formats.lines import place_errors
from depthwarp.cameras.formats.optical import optical_of_pose, pose_of_optical
from depthwarp.cameras.pinhole import PinholeCamera
from depthwarp.cameras.pose import Pose
from depthwarp.cameras.quaternion import quaternion_from_rotation, rotation_from_quaternion
from depthwarp.cameras.rig import Rig
from depthwarp.errors import FileFormatError, InputError

__all__ = [
    "MODELS",
    "CameraRecord",
    "ImageRecord",
    "LensModel",
    "check_known_model",
    "records_of",
    "rig_of",
]

PIXEL_CENTER = 0.5
"""Coordinate of the upper left pixel's centre in COLMAP; here it is 0."""


class LensModel(NamedTuple):
    """One of COLMAP's camera models.

    Attributes:
        number: What binary files call it.
        lens: The camera model that it is here.
        parameters: Names of its parameters, in order; `f` is fx and fy.
    """

    number: int
    lens: type[PinholeCamera] | type[FisheyeCamera]
    parameters: tuple[str, ...]


MODELS: dict[str, LensModel] = {
    "SIMPLE_PINHOLE": LensModel(0, PinholeCamera, ("f", "cx", "cy")),
    "PINHOLE": LensModel(1, PinholeCamera, ("fx", "fy", "cx", "cy")),
    "SIMPLE_RADIAL": LensModel(2, PinholeCamera, ("f", "cx", "cy", "k1")),
    "RADIAL": LensModel(3, PinholeCamera, ("f", "cx", "cy", "k1", "k2")),
    "OPENCV": LensModel(4, PinholeCamera, ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")),
    "OPENCV_FISHEYE": LensModel(5, FisheyeCamera, ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")),
    "FULL_OPENCV": LensModel(
        6,
        PinholeCamera,
        ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    ),
    "SIMPLE_RADIAL_FISHEYE": LensModel(8, FisheyeCamera, ("f", "cx", "cy", "k1")),
    "RADIAL_FISHEYE": LensModel(9, FisheyeCamera, ("f", "cx", "cy", "k1", "k2")),
    "SIMPLE_FISHEYE": LensModel(14, FisheyeCamera, ("f", "cx", "cy")),
    "FISHEYE": LensModel(15, FisheyeCamera, ("fx", "fy", "cx", "cy")),
}
"""COLMAP's models that are lenses here, by their names in text files."""

NOT_SUPPORTED = (
    "FOV",
    "THIN_PRISM_FISHEYE",
    "RAD_TAN_THIN_PRISM_FISHEYE",
    "SIMPLE_DIVISION",
    "DIVISION",
)
"""COLMAP's models that are no lens here."""

DISTORTION: dict[type[Camera], tuple[str, ...]] = {
    PinholeCamera: ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    FisheyeCamera: ("k1", "k2", "k3", "k4"),
}
"""Parameters of the distortion, in the order that the lenses here take them."""

ORIGIN = pose_of_optical(np.eye(3), np.zeros(3))
"""Pose of a camera without an image: its optical axes are the world's."""


class CameraRecord(NamedTuple):
    """A line of cameras.txt: a lens."""

    number: int
    model: str
    width: int
    height: int
    parameters: tuple[float, ...]


class ImageRecord(NamedTuple):
    """A line of images.txt: a lens at a place, optical axes, world to camera.

    Attributes:
        number: The image's own.
        quaternion: (w, x, y, z).
        translation: Of the world's origin, in optical axes [m].
        camera: Number of its camera.
        name: File name of the image.
    """

    number: int
    quaternion: tuple[float, ...]
    translation: tuple[float, ...]
    camera: int
    name: str


def check_known_model(path: Path, place: str, name: str) -> LensModel:
    """The lens model of a name.

    Raises:
        FileFormatError: There is none of that name here.
    """
    if name not in MODELS:
        is_colmaps = "not supported; supported" if name in NOT_SUPPORTED else "not known; known"
        raise FileFormatError(
            f"{path}: {place}: the camera model {name[:40]} is {is_colmaps} are "
            f"{', '.join(MODELS)}. Convert it with COLMAP, or undistort the images"
        )
    return MODELS[name]


def rig_of(
    cameras: Sequence[CameraRecord],
    images: Sequence[ImageRecord] | None,
    cameras_path: Path,
    images_path: Path,
) -> Rig:
    """The images as cameras, by name; without a list of images the cameras, by number.

    Raises:
        FileFormatError: Two of one number or name, an image of a camera that is not there, numbers
            out of their range, or a quaternion that is not of length 1; the message says where.
    """
    lenses: dict[int, Camera] = {}
    for record in cameras:
        if record.number in lenses:
            raise FileFormatError(f"{cameras_path}: two cameras have the number {record.number}")
        with place_errors(cameras_path, f"camera {record.number}"):
            lenses[record.number] = _lens_of(record)
    if not lenses:
        raise FileFormatError(f"{cameras_path}: no camera in it; copy or write it again")
    if images is None:
        return Rig.of({str(number): lens for number, lens in lenses.items()})
    placed: dict[str, Camera] = {}
    for image in images:
        if image.name in placed:
            raise FileFormatError(f"{images_path}: two images have the name '{image.name}'")
        if image.camera not in lenses:
            raise FileFormatError(
                f"{images_path}: image '{image.name}' is of camera {image.camera}, which "
                f"{cameras_path.name} does not have; take both files from one model"
            )
        with place_errors(images_path, f"image '{image.name}'"):
            placed[image.name] = lenses[image.camera].with_pose(_pose_of(image))
    if not placed:
        raise FileFormatError(f"{images_path}: no image in it; copy or write it again")
    return Rig.of(placed)


def records_of(rig: Rig) -> tuple[list[CameraRecord], list[ImageRecord]]:
    """The rig as COLMAP says it: equal lenses are one camera, numbers count from 1.

    Raises:
        InputError: A lens that COLMAP has no model for.
    """
    numbers: dict[tuple[str, int, int, tuple[float, ...]], int] = {}
    images: list[ImageRecord] = []
    for name, camera in zip(rig.names, rig.cameras, strict=True):
        lens = _model_of(name, camera)
        number = numbers.setdefault(lens, len(numbers) + 1)
        rotation, center = optical_of_pose(camera.pose)
        quaternion = quaternion_from_rotation(rotation.T)
        translation = -rotation_from_quaternion(quaternion) @ center
        images.append(
            ImageRecord(
                len(images) + 1,
                tuple(quaternion.tolist()),
                tuple(translation.tolist()),
                number,
                name,
            )
        )
    return [CameraRecord(number, *lens) for lens, number in numbers.items()], images


def _lens_of(record: CameraRecord) -> Camera:
    """The lens of a camera, at the origin."""
    model = MODELS[record.model]
    given = dict(zip(model.parameters, record.parameters, strict=True))
    return model.lens(
        fx=given["f"] if "f" in given else given["fx"],
        fy=given["f"] if "f" in given else given["fy"],
        cx=given["cx"] - PIXEL_CENTER,
        cy=given["cy"] - PIXEL_CENTER,
        width=record.width,
        height=record.height,
        pose=ORIGIN,
        distortion=_distortion(model, given),
    )


def _distortion(model: LensModel, given: Mapping[str, float]) -> tuple[float, ...]:
    return tuple(given.get(name, 0.0) for name in DISTORTION[model.lens])


def _pose_of(image: ImageRecord) -> Pose:
    translation = np.array(image.translation)
    if not np.isfinite(translation).all():
        raise InputError(f"the translation must be finite numbers, got {image.translation}")
    optical_from_world = rotation_from_quaternion(image.quaternion)
    return pose_of_optical(optical_from_world.T, -optical_from_world.T @ translation)


def _model_of(name: str, camera: Camera) -> tuple[str, int, int, tuple[float, ...]]:
    """Model, width, height and parameters of a lens: the first model that holds it all."""
    if isinstance(camera, FisheyeCamera):
        model = "OPENCV_FISHEYE"
    elif isinstance(camera, PinholeCamera) and len(camera.distortion) <= 8:
        used = len(camera.distortion)
        model = "PINHOLE" if used == 0 else "OPENCV" if used <= 4 else "FULL_OPENCV"
    else:
        raise InputError(
            f"camera '{name}' cannot be written for COLMAP, which has no model for a "
            f"{type(camera).__name__}"
            + (" with thin prism or tilt" if isinstance(camera, PinholeCamera) else "")
        )
    values = dict(zip(DISTORTION[type(camera)], camera.distortion, strict=False))
    values |= {"fx": camera.fx, "fy": camera.fy}
    values |= {"cx": camera.cx + PIXEL_CENTER, "cy": camera.cy + PIXEL_CENTER}
    parameters = tuple(float(values.get(key, 0.0)) for key in MODELS[model].parameters)
    return model, camera.width, camera.height, parameters
