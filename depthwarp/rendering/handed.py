"""What is handed to a renderer's call: arrays checked for device, type and shape, none copied."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp import arrays
from depthwarp.cameras import Camera, Pose
from depthwarp.checks import check_choice
from depthwarp.cloud import PointCloud
from depthwarp.errors import InputError
from depthwarp.prepared import PreparedCloud

__all__ = ["check_array", "check_cameras", "check_outputs", "check_points", "check_poses"]


def check_array(
    name: str, array: Any, dtype: Any, device: Any, shape: tuple[int, ...] | None = None
) -> Any:
    """Return a contiguous Warp array of a type on a device; of a shape, or else of one dimension.

    Raises:
        InputError: Anything else.
    """
    wanted = f"a wp.array of {dtype.__name__} on {device.alias}"
    if not isinstance(array, wp.array):
        raise InputError(f"{name} must be {wanted}, got {type(array).__name__}")
    if array.dtype != dtype or array.device != device or not array.is_contiguous:
        raise InputError(
            f"{name} must be {wanted}, contiguous, got {array.dtype.__name__} on {array.device}"
        )
    if array.ndim != (1 if shape is None else len(shape)) or shape not in (None, array.shape):
        raise InputError(f"{name} must have the shape {shape or '(N,)'}, got {array.shape}")
    return array


def check_cameras(cameras: Iterable[Camera]) -> tuple[Camera, ...]:
    """Return cameras of one image size.

    Raises:
        InputError: Something else than cameras, none, or several sizes.
    """
    if isinstance(cameras, Camera):
        raise InputError(
            f"cameras must be several, in a list, got one {type(cameras).__name__}: [camera]"
        )
    if not isinstance(cameras, Iterable):
        raise InputError(f"cameras must be several, in a list, got {type(cameras).__name__}")
    checked = tuple(cameras)
    for camera in checked:
        if not isinstance(camera, Camera):
            raise InputError(f"cameras must be cameras, got {type(camera).__name__}")
    if not checked:
        raise InputError("cameras must be at least one, got an empty list")
    sizes = sorted({camera.size for camera in checked})
    if len(sizes) > 1:
        raise InputError(
            "cameras must all be of one image size, got "
            f"{', '.join(f'{width} x {height}' for width, height in sizes[:4])}: make a Renderer "
            "for each size, or use dw.render_batch"
        )
    return checked


def check_outputs(outputs: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    """Return the names of what is drawn.

    Raises:
        InputError: Not a list of some of the known names.
    """
    names = ", ".join(map(repr, known))
    if isinstance(outputs, str):
        raise InputError(
            f"outputs must be a list of some of {names}, got the text {outputs!r}: ({outputs!r},)"
        )
    if not isinstance(outputs, Iterable):
        raise InputError(f"outputs must be a list of some of {names}, got {outputs!r}")
    checked = tuple(check_choice("outputs", name, known) for name in outputs)
    if not checked:
        raise InputError(f"outputs must be a list of some of {names}, got none")
    return checked


def check_points(points: Any, most: int, device: Any) -> Any:
    """Return points as a plan takes them: a `wp.array` of `wp.vec3f`, or a prepared cloud.

    Raises:
        InputError: Another device, shape or type, or more than `most` points.
    """
    if isinstance(points, PreparedCloud):
        if points.device != device:
            raise InputError(
                f"the cloud was prepared on {points.device.alias}, the renderer is on "
                f"{device.alias}"
            )
        count, cloud = len(points), points
    elif isinstance(points, PointCloud):
        count, cloud = len(points), _host_points(points.points_world, device, "cloud.points_world")
    elif isinstance(points, np.ndarray):
        count, cloud = len(points), _host_points(points, device, "points")
    else:
        cloud = check_array("points", points, wp.vec3f, device)
        count = cloud.shape[0]
    if count > most:
        raise InputError(f"{count} points are more than this renderer's max_points = {most}")
    return cloud


def _host_points(points: npt.NDArray[Any], device: Any, name: str) -> Any:
    if points.dtype != np.float32 or points.ndim != 2 or points.shape[1] != 3:
        raise InputError(
            f"points must be float32 of the shape (N, 3), got {points.dtype} of {points.shape}"
        )
    if device.is_cuda:
        raise InputError(
            f"points are on the host and the renderer is on {device.alias}: bring them there "
            f"once, wp.array({name}, dtype=wp.vec3f, device='{device.alias}')"
        )
    return arrays.share_points(np.ascontiguousarray(points), device)


def check_poses(poses: npt.NDArray[Any], count: int) -> list[Pose]:
    """Return matrices optical_from_world, shape (V, 4, 4), as poses.

    Raises:
        InputError: Another shape, or a matrix that is not a pose.
    """
    if poses.shape != (count, 4, 4):
        raise InputError(f"poses must have the shape (V, 4, 4) = {count, 4, 4}, got {poses.shape}")
    return [_pose(matrix, view) for view, matrix in enumerate(poses)]


def _pose(matrix: npt.NDArray[np.floating[Any]], view: int) -> Pose:
    try:
        return Pose.from_optical(matrix)
    except InputError as error:
        raise InputError(f"poses[{view}]: {error}") from error
