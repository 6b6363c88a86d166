"""Open3D's pinhole cameras in JSON: parameters, trajectories of them, or intrinsics alone.

One camera is named `camera`; those of a trajectory are `0`, `1` and so on. Intrinsics alone give a
camera at the origin. The file has no lens distortion: saving takes
`PinholeCamera`s without.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.formats.content import (
    beginning,
    content_errors,
    ideal_pinhole,
    read_json,
    write_text,
)
from depthwarp.cameras.pinhole import PinholeCamera
from depthwarp.cameras.rig import Rig
from depthwarp.errors import FileFormatError

__all__ = ["CONVENTION", "NAME", "matches", "read_rig", "write_rig"]

NAME = "open3d"

CONVENTION = (
    "Optical axes (X right, Y down, Z forward), extrinsics from the world to these axes, matrices "
    "column by column; pixel centres at whole numbers, so that the middle of an image is "
    "width / 2 - 0.5; metres."
)

KIND = "an Open3D camera"

PARAMETERS, TRAJECTORY = "PinholeCameraParameters", "PinholeCameraTrajectory"

LIST = "parameters"
"""Where a trajectory holds its cameras."""


def matches(path: Path) -> bool:
    """Whether the file begins as JSON with Open3D's names."""
    text = beginning(path)
    names = (f'"{PARAMETERS}"', f'"{TRAJECTORY}"', '"intrinsic_matrix"')
    return text.lstrip().startswith("{") and any(name in text for name in names)


def read_rig(path: Path) -> Rig:
    """Read the camera, or the cameras of a trajectory.

    Raises:
        FileFormatError: The file was cut short, an entry is missing or cannot be used, or its
            class is unknown.
    """
    content = read_json(path, KIND)
    with content_errors(path, KIND):
        kind = content.get("class_name")
        if kind is None:
            return Rig.of({"camera": _camera(content, None)})
        if kind == PARAMETERS:
            return Rig.of({"camera": _camera(content["intrinsic"], content["extrinsic"])})
        if kind == TRAJECTORY:
            cameras = [_camera(entry["intrinsic"], entry["extrinsic"]) for entry in content[LIST]]
            return Rig(tuple(str(k) for k in range(len(cameras))), tuple(cameras))
    raise FileFormatError(
        f"{path}: unknown class_name {kind!r}; known are {PARAMETERS} and {TRAJECTORY}"
    )


def write_rig(rig: Rig, path: Path) -> None:
    """Write one camera as parameters, several as a trajectory, in which their names get lost.

    Raises:
        InputError: A camera with distortion or of another model, or a path that cannot be written.
    """
    entries = [
        _entry(ideal_pinhole(camera, f"cannot write {path}: Open3D's file"))
        for camera in rig.cameras
    ]
    content = entries[0]
    if len(entries) > 1:
        content = _versioned({"class_name": TRAJECTORY, LIST: entries})
    write_text(path, json.dumps(content, indent=2) + "\n")


def _camera(intrinsic: dict[str, Any], extrinsic: list[float] | None) -> PinholeCamera:
    transform = np.eye(4) if extrinsic is None else _matrix("extrinsic", extrinsic, 4)
    return PinholeCamera.from_matrix(
        _matrix("intrinsic_matrix", intrinsic["intrinsic_matrix"], 3),
        (intrinsic["width"], intrinsic["height"]),
        optical_from_world=transform,
    )


def _matrix(name: str, values: list[float], side: int) -> npt.NDArray[np.float64]:
    """A square matrix, given column by column."""
    numbers = np.asarray(values, dtype=np.float64)
    if numbers.shape != (side * side,):
        raise ValueError(f"{name} must be {side * side} numbers, got shape {numbers.shape}")
    return numbers.reshape(side, side).T


def _entry(camera: PinholeCamera) -> dict[str, Any]:
    intrinsic = {
        "width": camera.width,
        "height": camera.height,
        "intrinsic_matrix": camera.K.T.ravel().tolist(),
    }
    extrinsic = camera.pose.optical_from_world.T.ravel().tolist()
    return _versioned({"class_name": PARAMETERS, "extrinsic": extrinsic, "intrinsic": intrinsic})


def _versioned(entries: dict[str, Any]) -> dict[str, Any]:
    return entries | {"version_major": 1, "version_minor": 0}
