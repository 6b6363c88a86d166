"""ROS's CameraInfo in YAML, as `camera_calibration_parsers` writes it and `camera_info_url` names.

What is read is the raw image's lens: `camera_matrix` and `distortion_coefficients`. The entries
`rectification_matrix` and `projection_matrix` speak of the rectified image and are checked but not
used. The file holds no pose, which in ROS is published as tf.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.camera import Camera
from depthwarp.cameras.fisheye import FisheyeCamera
from depthwarp.cameras.formats.content import beginning, content_errors, whole_size, write_text
from depthwarp.cameras.formats.flat_yaml import parse
from depthwarp.cameras.pinhole import PinholeCamera
from depthwarp.cameras.rig import Rig
from depthwarp.errors import FileFormatError, InputError

__all__ = ["CONVENTION", "NAME", "matches", "read_rig", "write_rig"]

NAME = "ros"

CONVENTION = (
    "The world is the camera's own optical frame (X right, Y down, Z forward), since the file "
    "holds no transform; pixel centres at whole numbers, of the raw image, neither binned nor cut."
)

Float64Array = npt.NDArray[np.float64]

KIND = "a ROS CameraInfo"

COUNTS = {"plumb_bob": (0, 4, 5), "rational_polynomial": (8, 12, 14), "equidistant": (4,)}
"""Distortion models, and how many coefficients each may have."""

MATRICES = {"rectification_matrix": (3, 3), "projection_matrix": (3, 4)}
"""What is checked and not used."""


def matches(path: Path) -> bool:
    """Whether the file begins as YAML with CameraInfo's names."""
    text = beginning(path)
    names = ("image_width", "camera_matrix")
    found = all(re.search(rf"^{name}\s*:", text, re.MULTILINE) for name in names)
    return found and "opencv-matrix" not in text


def read_rig(path: Path) -> Rig:
    """Read the camera; it has the name of the entry `camera_name`.

    Raises:
        FileFormatError: The file was cut short, an entry is missing or cannot be used, the image
            is binned or cut, or the distortion model is unknown.
    """
    with content_errors(path, KIND):
        entries = parse(path.read_text(encoding="utf-8-sig"))
        # ROS's own reader takes plumb_bob for files of before there was a choice.
        model = entries.get("distortion_model") or entries.get("camera_model") or "plumb_bob"
        if model not in COUNTS:
            raise FileFormatError(
                f"{path}: unknown distortion_model '{model}'; known are {', '.join(COUNTS)}"
            )
        _check_whole(entries)
        for name, shape in MATRICES.items():
            if _matrix(entries, name).shape != shape:
                raise ValueError(f"{name} is not {shape[0]} x {shape[1]}")
        coefficients = _matrix(entries, "distortion_coefficients").ravel().tolist()
        if len(coefficients) not in COUNTS[model]:
            raise ValueError(
                f"{model} has {' or '.join(map(str, COUNTS[model]))} coefficients, "
                f"got {len(coefficients)}"
            )
        size = whole_size(_number(entries, "image_width"), _number(entries, "image_height"))
        lens = FisheyeCamera if model == "equidistant" else PinholeCamera
        camera: Camera = lens.from_matrix(
            _matrix(entries, "camera_matrix"),
            size,
            coefficients,
        )
    return Rig.of({entries.get("camera_name") or "camera": camera})


def write_rig(rig: Rig, path: Path) -> None:
    """Write one camera that stands at the origin; its rectified image is that without the lens.

    Raises:
        InputError: Several cameras, a model that ROS does not have, a camera that is not at the
            origin of its optical frame, or a path that cannot be written.
    """
    if len(rig) != 1:
        raise InputError(
            f"cannot write {path}: a CameraInfo is one camera, the rig has {len(rig)}; write each "
            "to a file of its own"
        )
    camera = rig.cameras[0]
    if not isinstance(camera, PinholeCamera | FisheyeCamera):
        raise InputError(
            f"cannot write {path}: ROS has no model for a {type(camera).__name__}; it has "
            "PinholeCamera and FisheyeCamera"
        )
    model, coefficients = _model_of(camera)
    if not np.array_equal(camera.pose.optical_from_world, np.eye(4)):
        raise InputError(
            f"cannot write {path}: a CameraInfo holds no pose, which in ROS is published as tf; "
            "write camera.with_pose(Pose.from_optical(np.eye(4))), and its pose elsewhere"
        )
    lines = [
        f"image_width: {camera.width}",
        f"image_height: {camera.height}",
        f"camera_name: {json.dumps(rig.names[0], ensure_ascii=False)}",
        *_lines_of("camera_matrix", camera.K),
        f"distortion_model: {model}",
        *_lines_of("distortion_coefficients", np.array([coefficients])),
        *_lines_of("rectification_matrix", np.eye(3)),
        *_lines_of("projection_matrix", np.hstack([camera.K, np.zeros((3, 1))])),
    ]
    write_text(path, "\n".join(lines) + "\n")


def _model_of(camera: PinholeCamera | FisheyeCamera) -> tuple[str, tuple[float, ...]]:
    """Distortion model and coefficients."""
    if isinstance(camera, FisheyeCamera):
        return "equidistant", camera.distortion
    model = "rational_polynomial" if camera.lens.is_rational else "plumb_bob"
    used = len(camera.distortion)
    length = next(count for count in (5, *COUNTS["rational_polynomial"]) if count >= used)
    return model, camera.distortion + (0.0,) * (length - used)


def _lines_of(name: str, matrix: Float64Array) -> list[str]:
    rows, columns = matrix.shape
    data = ", ".join(repr(value) for value in matrix.ravel().tolist())
    return [f"{name}:", f"  rows: {rows}", f"  cols: {columns}", f"  data: [{data}]"]


def _check_whole(entries: dict[str, Any]) -> None:
    """Refuse an image that is binned, or a part of another."""
    for name in ("binning_x", "binning_y"):
        if entries.get(name, "0") not in ("0", "1"):
            raise ValueError(f"{name} is {entries[name]}: give the calibration of the whole image")
    roi = entries.get("roi") or {}
    if not isinstance(roi, dict):
        raise ValueError("roi is not a map")
    whole = {"width": entries["image_width"], "height": entries["image_height"]}
    for name in ("x_offset", "y_offset", *whole):
        if roi.get(name, "0") not in ("0", whole.get(name)):
            raise ValueError(f"roi.{name} is {roi[name]}: give the calibration of the whole image")


def _number(entries: dict[str, Any], name: str) -> float:
    value = entries[name]
    if not isinstance(value, str):
        raise ValueError(f"{name} is not a number")
    return float(value)


def _matrix(entries: dict[str, Any], name: str) -> Float64Array:
    matrix = entries[name]
    if not isinstance(matrix, dict):
        raise ValueError(f"{name} is not a map of rows, cols and data")
    rows, columns, data = int(matrix["rows"]), int(matrix["cols"]), matrix["data"]
    if not isinstance(data, list) or len(data) != rows * columns:
        raise ValueError(f"{name} does not hold {rows} x {columns} numbers")
    return np.array([float(value) for value in data]).reshape(rows, columns)
