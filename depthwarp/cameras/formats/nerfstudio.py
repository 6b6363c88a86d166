"""nerfstudio's transforms.json, and those of Instant NGP and NeRF, which say less.

Source: nerfstudio's documentation, "Data conventions", and for panoramas its ray generator.
Saving takes cameras of one model: `PinholeCamera`s with at most k1, k2, p1, p2, k3,
`FisheyeCamera`s or `EquirectangularCamera`s.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.camera import Camera
from depthwarp.cameras.fisheye import FisheyeCamera
from depthwarp.cameras.formats.content import beginning, read_json, whole_size, write_text
from depthwarp.cameras.formats.lines import place_errors
from depthwarp.cameras.formats.optical import check_rotation, optical_of_pose, pose_of_optical
from depthwarp.cameras.panorama import EquirectangularCamera
from depthwarp.cameras.pinhole import PinholeCamera
from depthwarp.cameras.pose import Pose
from depthwarp.cameras.rig import Rig
from depthwarp.errors import FileFormatError, InputError

__all__ = ["CONVENTION", "NAME", "matches", "read_rig", "write_rig"]

Float64Array = npt.NDArray[np.float64]

NAME = "nerfstudio"

CONVENTION = (
    "Camera to world, 4 x 4, with OpenGL's axes (X right, Y up, Z backward), in the unit of the "
    "file, read as [m]; the world is that of the matrices as they stand, after any "
    "`applied_transform`; the upper left pixel's centre is at (0.5, 0.5), so principal points are "
    "0.5 px less here."
)

KIND = "a nerfstudio transforms.json"

MODELS: dict[str, type[Camera]] = {
    "SIMPLE_PINHOLE": PinholeCamera,
    "PINHOLE": PinholeCamera,
    "SIMPLE_RADIAL": PinholeCamera,
    "RADIAL": PinholeCamera,
    "OPENCV": PinholeCamera,
    "OPENCV_FISHEYE": FisheyeCamera,
    "EQUIRECTANGULAR": EquirectangularCamera,
}
"""Values of `camera_model`; the first five differ in nothing, numbers that are absent are 0."""


DISTORTION: dict[type[Camera], tuple[str, ...]] = {
    PinholeCamera: ("k1", "k2", "p1", "p2", "k3"),
    FisheyeCamera: ("k1", "k2", "k3", "k4"),
    EquirectangularCamera: (),
}
"""Names of the coefficients, in the order that the lenses here take them."""

COEFFICIENTS = ("k1", "k2", "k3", "k4", "p1", "p2")
LENS_NUMBERS = ("w", "h", "fl_x", "fl_y", "cx", "cy", "camera_angle_x", "camera_angle_y")

PIXEL_CENTER = 0.5
"""Coordinate of the upper left pixel's centre in the file; here it is 0."""

OPTICAL_FROM_OPENGL = np.diag([1.0, -1.0, -1.0])

ORIGIN = pose_of_optical(np.eye(3), np.zeros(3))
"""Pose of a lens before its frame's is known."""


def matches(path: Path) -> bool:
    """Whether it is JSON that begins with entries of transforms.json."""
    text = beginning(path).lstrip()
    entries = ('"frames"', '"transform_matrix"', '"camera_angle_x"', '"fl_x"')
    return text.startswith("{") and any(entry in text for entry in entries)


def read_rig(path: Path, size: tuple[int, int] | None = None) -> Rig:
    """Read the frames as cameras; their names are the frames' `file_path`.

    A number of the lens stands at the top for all frames, or in each frame. As in NeRF's files,
    `camera_angle_x` may stand for `fl_x`; without `fl_y` pixels are square, without `cx` and `cy`
    the principal point is the image's middle, and coefficients that are absent are 0.

    Args:
        path: The file.
        size: (width, height) [px] of the frames for which the file has no `w` and `h`.

    Raises:
        InputError: Neither the file nor `size` says how large the images are.
        FileFormatError: An entry is missing, contradicts another or cannot be used: an unknown
            model, numbers that are not finite, a matrix that is no rotation, two frames of a name.

    Warns:
        LensDomainWarning: A lens's domain is smaller than its image.
    """
    content = read_json(path, KIND)
    frames = content.get("frames") if isinstance(content, dict) else None
    if not isinstance(frames, list) or not frames:
        raise FileFormatError(f"{path} is not {KIND}: it has no list 'frames' with a frame in it")
    lenses: dict[tuple[tuple[str, Any], ...], Camera] = {}
    cameras: dict[str, Camera] = {}
    for k, frame in enumerate(frames):
        if not isinstance(frame, dict) or not isinstance(frame.get("file_path"), str):
            raise FileFormatError(f"{path}: frame {k} has no 'file_path', which is its name")
        name = frame["file_path"]
        if name in cameras:
            raise FileFormatError(f"{path}: two frames have the file_path '{name}'")
        with place_errors(path, f"frame {k} ('{name}')"):
            entries = _lens_entries(content, frame)
        absent = [side for side in ("w", "h") if side not in entries]
        if absent and size is None:
            raise InputError(
                f"{path}: frame {k} ('{name}') has no '{absent[0]}': give size=(width, height) "
                "[px], or add the image's size to the file, 'w' and 'h'"
            )
        with place_errors(path, f"frame {k} ('{name}')"):
            if size is not None:
                entries = {"w": float(size[0]), "h": float(size[1]), **entries}
            key = tuple(entries.items())
            if key not in lenses:
                lenses[key] = _lens_of(entries)
            cameras[name] = lenses[key].with_pose(_pose_of(frame.get("transform_matrix")))
    return Rig.of(cameras)


def write_rig(rig: Rig, path: Path) -> None:
    """Write a rig; the cameras' names become the frames' `file_path`.

    The file appears whole or not at all. Equal lenses stand at the top, others in the frames.

    Args:
        rig: Pinhole cameras with at most k1, k2, p1, p2, k3, or fisheye cameras, or
            equirectangular panoramas: a file has one model.
        path: The file.

    Raises:
        InputError: Another lens, several models, or a path that cannot be written.
    """
    placed = dict(zip(rig.names, rig.cameras, strict=True))
    lenses = {name: _entries_of(name, camera) for name, camera in placed.items()}
    models = {entries.pop("camera_model"): name for name, entries in lenses.items()}
    if len(models) > 1:
        named = ", ".join(f"'{name}' is {model}" for model, name in models.items())
        raise InputError(f"nerfstudio has one camera model a file: {named}; write one file a model")
    first = next(iter(lenses.values()))
    is_shared = all(entries == first for entries in lenses.values())
    frames = []
    for name, camera in placed.items():
        own = {} if is_shared else lenses[name]
        matrix = _matrix_of(camera.pose).tolist()
        frames.append({"file_path": name, **own, "transform_matrix": matrix})
    top = {"camera_model": next(iter(models)), **(first if is_shared else {})}
    text = json.dumps({**top, "frames": frames}, indent=1, ensure_ascii=False)
    write_text(path, text + "\n")


def _lens_entries(content: Mapping[str, Any], frame: Mapping[str, Any]) -> dict[str, Any]:
    """What the file and the frame say of the lens, checked one by one."""
    entries: dict[str, Any] = {}
    for key in ("camera_model", "is_fisheye", *LENS_NUMBERS, *COEFFICIENTS):
        values = [source[key] for source in (content, frame) if key in source]
        # Programs differ in which of the two they take.
        if len(values) == 2 and values[0] != values[1]:
            raise InputError(
                f"'{key}' is {values[0]!r} at the top of the file and {values[1]!r} in the frame; "
                "leave one of them out"
            )
        if values:
            is_number = key in LENS_NUMBERS or key in COEFFICIENTS
            entries[key] = _number(key, values[0]) if is_number else values[0]
    is_fisheye = entries.pop("is_fisheye", False)
    name = entries.setdefault("camera_model", "OPENCV_FISHEYE" if is_fisheye else "OPENCV")
    if not isinstance(name, str) or name not in MODELS:
        raise InputError(f"the camera_model {name!r} is not known; known are {', '.join(MODELS)}")
    return entries


def _number(key: str, value: Any) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not abs(value) <= sys.float_info.max:  # NaN compares as false
        raise InputError(f"'{key}' must be a finite number, got {value!r:.80}")
    return float(value)


def _lens_of(entries: Mapping[str, Any]) -> Camera:
    """The lens, at the origin."""
    width, height = whole_size(entries["w"], entries["h"])
    fx, fy = _focal_lengths(entries)
    cx, cy = entries.get("cx", width / 2), entries.get("cy", height / 2)
    model = MODELS[entries["camera_model"]]
    names = DISTORTION[model]
    for key in COEFFICIENTS:
        if key not in names and entries.get(key, 0.0) != 0:
            raise InputError(
                f"'{key}' is {entries[key]}, which a {model.__name__} does not have: undistort the "
                "images or calibrate without it"
            )
    if model is EquirectangularCamera:
        return _panorama((width, height), (fx, fy), (cx, cy))
    lens = FisheyeCamera if model is FisheyeCamera else PinholeCamera
    coefficients = tuple(entries.get(key, 0.0) for key in names)
    cx, cy = cx - PIXEL_CENTER, cy - PIXEL_CENTER
    return lens(fx, fy, cx, cy, width, height, ORIGIN, coefficients)


def _focal_lengths(entries: Mapping[str, Any]) -> tuple[float, float]:
    """Of columns and rows [px]; by the field of view [rad] where a file has only that."""
    given = []
    for axis, side in (("x", "w"), ("y", "h")):
        angle = entries.get(f"camera_angle_{axis}")
        if f"fl_{axis}" in entries:
            given.append(entries[f"fl_{axis}"])
        elif angle is not None:
            if not 0 < angle < math.pi:
                raise InputError(
                    f"'camera_angle_{axis}' must be above 0 and below pi radians, got {angle}"
                )
            given.append(0.5 * entries[side] / math.tan(0.5 * angle))
        elif not given:
            raise InputError("there is neither 'fl_x' nor 'camera_angle_x'")
    return given[0], given[-1]


def _panorama(
    size: tuple[int, int], focal: tuple[float, float], center: tuple[float, float]
) -> Camera:
    """A panorama: nerfstudio's coordinate (x - cx) / fl_x counts half turns, and so do rows."""
    width, height = size
    if abs(center[0] - width / 2) > 1e-6:
        raise InputError(
            f"'cx' of a panorama must be half its width, {width / 2}, got {center[0]}: turn the "
            "poses instead"
        )
    if min(focal) <= 0:
        raise InputError(f"'fl_x' and 'fl_y' must be above 0, got {focal}")
    # A hair for rounding: the camera itself is the judge of what is nearly a full turn.
    if focal[0] < width / 2 * (1 - 1e-9):
        raise InputError(
            f"'fl_x' of a panorama must be at least half its width, {width / 2}, which is a full "
            f"turn, got {focal[0]}"
        )
    low, high = 180 * (center[1] - height) / focal[1], 180 * center[1] / focal[1]
    if max(-low, high) > 90 * (1 + 1e-9):
        raise InputError(
            f"'fl_y' {focal[1]} and 'cy' {center[1]} of a panorama give elevations from {low:.6g} "
            f"to {high:.6g} degrees, beyond the poles; a full panorama has both {height} and "
            f"{height / 2}"
        )
    return EquirectangularCamera(width, height, ORIGIN, 180 * width / focal[0], (low, high))


def _pose_of(matrix: Any) -> Pose:
    try:
        transform = np.array(matrix, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"'transform_matrix' must be 4 x 4 numbers, got {matrix!r:.80}") from error
    if transform.shape not in ((4, 4), (3, 4)) or not np.isfinite(transform).all():
        raise InputError(
            f"'transform_matrix' must be 4 x 4 finite numbers, got shape {transform.shape}"
        )
    if not np.allclose(transform[3:], (0, 0, 0, 1), rtol=0, atol=1e-9):
        raise InputError(
            f"'transform_matrix' must end in the row (0, 0, 0, 1), got {transform[3].tolist()}"
        )
    check_rotation("'transform_matrix'", transform[:3, :3])
    return pose_of_optical(transform[:3, :3] @ OPTICAL_FROM_OPENGL, transform[:3, 3])


def _matrix_of(pose: Pose) -> Float64Array:
    rotation, center = optical_of_pose(pose)
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation @ OPTICAL_FROM_OPENGL, center
    return matrix


def _entries_of(name: str, camera: Camera) -> dict[str, Any]:
    """The inverse of `_lens_of`."""
    size = {"w": camera.width, "h": camera.height}
    if isinstance(camera, EquirectangularCamera):
        low, high = camera.elevations
        fl_y = 180 * camera.height / (high - low)
        focal = {"fl_x": 180 * camera.width / camera.azimuths, "fl_y": fl_y}
        center = {"cx": camera.width / 2, "cy": high * fl_y / 180}
        return {"camera_model": "EQUIRECTANGULAR", **size, **focal, **center}
    coefficients = DISTORTION.get(type(camera), ())
    if not isinstance(camera, PinholeCamera | FisheyeCamera) or (
        len(camera.distortion) > len(coefficients)
    ):
        raise InputError(
            f"camera '{name}' cannot be written for nerfstudio, which has no model for this "
            f"{type(camera).__name__}: only pinholes with k1, k2, p1, p2, k3, fisheyes, panoramas"
        )
    model = "OPENCV_FISHEYE" if isinstance(camera, FisheyeCamera) else "OPENCV"
    focal = {"fl_x": camera.fx, "fl_y": camera.fy}
    center = {"cx": camera.cx + PIXEL_CENTER, "cy": camera.cy + PIXEL_CENTER}
    used = dict(zip(coefficients, camera.distortion, strict=False))
    bent = {key: used.get(key, 0.0) for key in coefficients}
    return {"camera_model": model, **size, **focal, **center, **bent}
