"""ROS's CameraInfo in YAML: a calibration's file, or a message that was printed.

The file is what `camera_calibration_parsers` writes and `camera_info_url` names; the message what
`ros2 topic echo --once` or `rostopic echo -n 1` prints (`d`, `k`, `r`, `p` or `D`, `K`, `R`, `P`).

What is read is the raw image's lens: `camera_matrix` and `distortion_coefficients`. The entries
`rectification_matrix` and `projection_matrix` speak of the rectified image and are checked but not
used. The file holds no pose, which in ROS is published as tf. Saving takes one `PinholeCamera` (any
distortion) or `FisheyeCamera`, at the origin of its optical frame.
"""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.camera import Camera
from depthwarp.cameras.fisheye import FisheyeCamera
from depthwarp.cameras.formats.content import (
    beginning,
    check_intrinsics,
    content_errors,
    whole_size,
    write_text,
)
from depthwarp.cameras.formats.flat_yaml import parse
from depthwarp.cameras.formats.optical import check_rotation
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

SAME_MODEL = {"fisheye": "equidistant"}
"""Other names of distortion models."""

MATRICES = {"rectification_matrix": (3, 3), "projection_matrix": (3, 4)}
"""What is checked and not used."""


def matches(path: Path) -> bool:
    """Whether the file begins as YAML with CameraInfo's names."""
    text = beginning(path)
    names = set(re.findall(r"^(\w+)\s*:", text, re.MULTILINE))
    lens = {"image_width", "distortion_model", "distortion_coefficients"}
    is_file = "camera_matrix" in names and bool(names & lens)
    is_message = "distortion_model" in names and ({"d", "k"} <= names or {"D", "K"} <= names)
    return (is_file or is_message) and "opencv-matrix" not in text


def read_rig(path: Path, size: tuple[int, int] | None = None) -> Rig:
    """Read the camera; it has the name of the entry `camera_name`.

    Args:
        path: The file.
        size: (width, height) [px], used if the file holds none.

    Raises:
        InputError: Neither the file nor `size` says how large the image is.
        FileFormatError: The file was cut short, an entry is missing or cannot be used, the image
            is binned or cut, or the distortion model is unknown.
    """
    with content_errors(path, KIND):
        entries = _as_file(parse(path.read_text(encoding="utf-8-sig")))
        # ROS's own reader takes plumb_bob for files of before there was a choice.
        model = entries.get("distortion_model") or entries.get("camera_model") or "plumb_bob"
        model = SAME_MODEL.get(model, model)
        if model not in COUNTS:
            raise FileFormatError(
                f"{path}: unknown distortion_model '{model}'; known are {', '.join(COUNTS)}"
            )
        _check_whole(entries)
        for name, shape in MATRICES.items():
            if _matrix(entries, name).shape != shape:
                raise ValueError(f"{name} is not {shape[0]} x {shape[1]}")
        check_rotation("rectification_matrix", _matrix(entries, "rectification_matrix"))
        matrix = _matrix(entries, "camera_matrix")
        check_intrinsics(matrix)
        coefficients = _matrix(entries, "distortion_coefficients").ravel().tolist()
        if len(coefficients) not in COUNTS[model]:
            raise ValueError(
                f"{model} has {' or '.join(map(str, COUNTS[model]))} coefficients, "
                f"got {len(coefficients)}"
            )
        image_size = _size(entries, size)
    if image_size is None:
        raise InputError(
            f"{path} holds no image_width or no image_height: give size=(width, height) [px]"
        )
    with content_errors(path, KIND):
        lens = FisheyeCamera if model == "equidistant" else PinholeCamera
        camera: Camera = lens.from_matrix(matrix, image_size, coefficients)
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
    whole = {"width": entries.get("image_width"), "height": entries.get("image_height")}
    for name in ("x_offset", "y_offset", *whole):
        if roi.get(name, "0") not in ("0", whole.get(name)):
            raise ValueError(f"roi.{name} is {roi[name]}: give the calibration of the whole image")


def _as_file(entries: dict[str, Any]) -> dict[str, Any]:
    """The entries of a printed message, by the names that files have; those of a file as they are.

    ROS 1 prints the matrices in capitals, ROS 2 in small letters.
    """
    letter = next((letter for letter in ("k", "K") if letter in entries), None)
    if letter is None or "camera_matrix" in entries:
        return entries
    d, r, p = ("d", "r", "p") if letter == "k" else ("D", "R", "P")
    coefficients = entries[d] or []
    sides = {"image_width": "width", "image_height": "height"}
    return {
        **entries,
        **{name: entries[own] for name, own in sides.items() if own in entries},
        "camera_matrix": {"rows": "3", "cols": "3", "data": entries[letter]},
        "distortion_coefficients": {"rows": "1", "cols": len(coefficients), "data": coefficients},
        "rectification_matrix": {"rows": "3", "cols": "3", "data": entries[r]},
        "projection_matrix": {"rows": "3", "cols": "4", "data": entries[p]},
    }


def _size(entries: dict[str, Any], given: tuple[int, int] | None) -> tuple[int, int] | None:
    """The file's size, with what it lacks from the one that is given; None if that lacks too."""
    names = ("image_width", "image_height")
    if given is None and not all(name in entries for name in names):
        return None
    sides = given or (0, 0)
    width, height = (
        _number(entries, name) if name in entries else sides[k] for k, name in enumerate(names)
    )
    return whole_size(width, height)


def _number(entries: dict[str, Any], name: str) -> float:
    value = entries[name]
    if not isinstance(value, str):
        raise ValueError(f"{name} is not a number")
    return _finite(name, value)


def _finite(name: str, value: str) -> float:
    # .nan and .inf are how YAML writes them.
    number = float(re.sub(r"^([-+]?)\.(nan|inf)$", r"\1\2", value, flags=re.IGNORECASE))
    if not math.isfinite(number):
        raise InputError(f"{name} must be finite numbers, got '{value}'")
    return number


def _matrix(entries: dict[str, Any], name: str) -> Float64Array:
    matrix = entries[name]
    if not isinstance(matrix, dict):
        raise ValueError(f"{name} is not a map of rows, cols and data")
    rows, columns, data = int(matrix["rows"]), int(matrix["cols"]), matrix["data"]
    if not isinstance(data, list) or len(data) != rows * columns:
        raise ValueError(f"{name} does not hold {rows} x {columns} numbers")
    return np.array([_finite(name, value) for value in data]).reshape(rows, columns)
