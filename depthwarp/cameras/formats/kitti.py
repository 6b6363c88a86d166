"""KITTI's calibration files: `calib.txt` of the benchmarks, `calib_cam_to_cam.txt` of the raw data.

The rectified cameras `P0` to `P3`, which have no distortion. In a benchmark's file the world is
the LiDAR's frame (`Tr_velo_to_cam`, `Tr_velo_cam` or `Tr` lead from it); in the raw data's file it
is the LiDAR's too if `calib_velo_to_cam.txt` lies beside it, else that of camera 0 before
rectification; in one with the four projection matrices alone, that of camera 0 as rectified. A
benchmark's file holds no size. Saving takes up to four parallel `PinholeCamera`s without
distortion.
Source: Geiger, Lenz, Stiller, Urtasun 2013, "Vision meets robotics: the KITTI dataset".
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.camera import Camera
from depthwarp.cameras.formats.content import (
    beginning,
    check_intrinsics,
    content_errors,
    ideal_pinhole,
    whole_size,
    write_text,
)
from depthwarp.cameras.formats.optical import check_rotation
from depthwarp.cameras.pinhole import PinholeCamera
from depthwarp.cameras.rig import Rig
from depthwarp.errors import InputError

__all__ = ["CONVENTION", "NAME", "matches", "read_rig", "write_rig"]

NAME = "kitti"

CONVENTION = (
    "The world is the LiDAR's frame (X forward, Y left, Z up); P R0_rect Tr maps it to pixels of "
    "optical axes (X right, Y down, Z forward), pixel centres at whole numbers; metres. Where "
    "nothing leads from the LiDAR, the world is camera 0's optical frame: before rectification for "
    "a `calib_cam_to_cam.txt` without `calib_velo_to_cam.txt` beside it, rectified for projection "
    "matrices alone."
)

KIND = "a KITTI calibration"

FROM_LIDAR_FILE = "calib_velo_to_cam.txt"
"""Where the raw data has the way from the LiDAR to camera 0."""

Float64Array = npt.NDArray[np.float64]

NAMES = ("P0", "P1", "P2", "P3")

FROM_LIDAR = ("Tr_velo_to_cam", "Tr_velo_cam", "Tr")

RECTIFYING = ("R0_rect", "R_rect")

RAW_RECTIFYING = "R_rect_00"

MAX_TURN = 1e-9
"""Largest difference of two rotations of cameras that are written as parallel."""


def matches(path: Path) -> bool:
    """Whether a line begins as that of a projection matrix."""
    return re.search(r"^P(\d|_rect_0\d):", beginning(path), re.MULTILINE) is not None


def read_rig(path: Path, size: tuple[int, int] | None = None) -> Rig:
    """Read the rectified cameras.

    Args:
        path: The file.
        size: (width, height) [px], used if the file holds none.

    Raises:
        InputError: Neither the file nor `size` says how large the images are.
        FileFormatError: The file was cut short, or an entry is missing or cannot be used.
    """
    with content_errors(path, KIND):
        entries = _entries(path)
        reference_from_world = _reference_from_world(entries, path.parent / FROM_LIDAR_FILE)
        matrices = {
            name: _matrix(entries, key, (3, 4))
            for name in NAMES
            for key in (name, f"P_rect_0{name[1]}")
            if key in entries
        }
        for matrix in matrices.values():
            check_intrinsics(matrix[:, :3])
        sizes = {name: _size(entries, f"S_rect_0{name[1]}") or size for name in matrices}
    if None in sizes.values():
        raise InputError(
            f"{path} holds no image size: give size=(width, height) [px] of the images, which in "
            "KITTI differs by sequence, for example (1242, 375)"
        )
    with content_errors(path, KIND):
        cameras = {
            name: _camera(matrix, sizes[name] or (0, 0), reference_from_world)
            for name, matrix in matrices.items()
        }
        return Rig.of(cameras)


def write_rig(rig: Rig, path: Path) -> None:
    """Write parallel pinhole cameras as a benchmark's `calib.txt`, with `R0_rect` the identity.

    The file has no room for image sizes: to read it, `size` is needed. Names other than `P0` to
    `P3` become these, in order.

    Raises:
        InputError: More than four cameras, one with distortion or of another model, cameras that
            are not parallel, or a path that cannot be written.
    """
    if len(rig) > len(NAMES):
        raise InputError(
            f"cannot write {path}: a KITTI calibration has up to 4 cameras, the rig has {len(rig)}"
        )
    known = all(name in NAMES for name in rig)
    names = rig.names if known else NAMES[: len(rig)]
    cameras = [
        ideal_pinhole(camera, f"cannot write {path}: a KITTI calibration") for camera in rig.cameras
    ]
    reference = cameras[0].pose.optical_from_world
    lines = []
    for name, camera in zip(names, cameras, strict=True):
        transform = camera.pose.optical_from_world
        turn = float(np.abs(transform[:3, :3] - reference[:3, :3]).max())
        if turn > MAX_TURN:
            raise InputError(
                f"cannot write {path}: cameras of a KITTI calibration are parallel, the rotation "
                f"of '{name}' differs from that of '{names[0]}' by {turn:.3g}; write each camera "
                "to a file of its own"
            )
        shift = transform[:3, 3] - reference[:3, 3]
        lines.append(_line(name, camera.K @ np.column_stack([np.eye(3), shift])))
    lines += [_line("R0_rect", np.eye(3)), _line("Tr_velo_to_cam", reference[:3])]
    write_text(path, "\n".join(lines) + "\n")


def _camera(
    matrix: Float64Array, size: tuple[int, int], reference_from_world: Float64Array
) -> Camera:
    """Camera of a 3 x 4 projection matrix K [I | t]: t is the baseline, exactly."""
    K, (x, y, z) = matrix[:, :3], matrix[:, 3]
    fx, fy, cx, cy = check_intrinsics(K)
    transform = reference_from_world.copy()
    transform[:3, 3] += (x - cx * z) / fx, (y - cy * z) / fy, z
    return PinholeCamera.from_matrix(K, size, optical_from_world=transform)


def _reference_from_world(entries: dict[str, list[str]], beside: Path) -> Float64Array:
    """The rectified reference camera's optical axes from the world, shape (4, 4).

    Args:
        entries: Those of the file.
        beside: Where the raw data has the way from the LiDAR; need not exist.
    """
    rectified, reference = np.eye(4), np.eye(4)
    turns = [name for name in (*RECTIFYING, RAW_RECTIFYING) if name in entries]
    transforms = [name for name in FROM_LIDAR if name in entries]
    is_raw = any(name.startswith("P_rect_") for name in entries)
    if is_raw and not turns:
        raise KeyError(RAW_RECTIFYING)
    # Only projection matrices alone, all four, or the raw data may lack it: not a file cut short.
    may_lack = RAW_RECTIFYING in entries or (not turns and all(name in entries for name in NAMES))
    if not (transforms or may_lack):
        raise KeyError(" or ".join(FROM_LIDAR))
    if turns:
        rectified[:3, :3] = _matrix(entries, turns[0], (3, 3))
        check_rotation(turns[0], rectified[:3, :3])
    if transforms:
        reference[:3] = _matrix(entries, transforms[0], (3, 4))
    elif is_raw and beside.is_file():
        with content_errors(beside, f"the raw data's {FROM_LIDAR_FILE}"):
            lidar = _entries(beside)
            reference[:3, :3] = _matrix(lidar, "R", (3, 3))
            reference[:3, 3] = _matrix(lidar, "T", (3, 1))[:, 0]
            check_rotation("R", reference[:3, :3])
    return np.asarray(rectified @ reference)


def _entries(path: Path) -> dict[str, list[str]]:
    """The words behind each name; the tracking benchmark leaves out some of the colons."""
    entries: dict[str, list[str]] = {}
    for line in path.read_text(encoding="utf-8-sig").splitlines():
        words = line.split()
        if words:
            entries[words[0].removesuffix(":")] = words[1:]
    return entries


def _matrix(entries: dict[str, list[str]], name: str, shape: tuple[int, int]) -> Float64Array:
    words = entries[name]
    if len(words) != shape[0] * shape[1]:
        count = shape[0] * shape[1]
        raise ValueError(f"{name} must be {count} numbers, got {len(words)}; was it cut short?")
    return np.array([float(word) for word in words]).reshape(shape)


def _size(entries: dict[str, list[str]], name: str) -> tuple[int, int] | None:
    if name not in entries:
        return None
    width, height = (float(word) for word in entries[name])
    return whole_size(width, height)


def _line(name: str, matrix: Float64Array) -> str:
    return f"{name}: " + " ".join(repr(value) for value in matrix.ravel().tolist())
