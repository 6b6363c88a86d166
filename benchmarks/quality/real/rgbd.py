"""Recorded depth pictures: clouds of some frames, judged by another frame's own depth."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

import depthwarp as dw
from benchmarks.quality.evaluate import Shot
from benchmarks.quality.truth import BAND_PX, HIDDEN_M, Label, View, near

__all__ = ["living_room", "noisy_and_clean", "plain_edges", "shot_of"]

Float64Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

NOVEL_VIEW_M = 0.02
SOURCE_STEP = 5
SEEN_M = 0.02  # a frame observes a point whose depth it agrees with
EDGE_M, EDGE_SHARE = 0.1, 0.05


def living_room(data: Path, device: str = "cpu") -> list[Shot]:
    """Frames of the clean living room, from the cloud of every fifth frame and of no other.

    Right is within 2 cm; what counts is what one of the cloud's frames observed, too.
    """
    frames = _frames(data / "rgbd_livingroom")
    sources = frames[::SOURCE_STEP]
    targets = [frame for place, frame in enumerate(frames) if place % SOURCE_STEP]
    cloud = dw.PointCloud(np.concatenate([_points(*source) for source in sources]))
    shots = []
    for camera, depth in targets:
        points = camera.unproject(depth, "z").reshape(-1, 3)
        observed = np.zeros(depth.size, dtype=bool)
        for other, measured in sources:
            observed |= _agrees(points, other, measured)
        observed &= depth.ravel() > 0
        view = View(camera, depth, observed.reshape(depth.shape), plain_edges(depth))
        shots.append(shot_of(view, cloud, "z", NOVEL_VIEW_M, device))
    return shots


def noisy_and_clean(data: Path, device: str = "cpu") -> list[Shot]:
    """Frames with a sensor's noise and holes, judged by the same frames without."""
    folder = data / "rgbd_noisy_vs_clean"
    entries = json.loads((folder / "frames.json").read_text())
    shots = []
    for frame in entries["frames"]:
        camera = _camera(entries, frame["T_world_from_camera_ground_truth"])
        noisy, clean = (
            _read(folder / f"{kind}_{frame['id']:05d}.png") for kind in ("noisy", "clean")
        )
        view = View(camera, clean, clean > 0, plain_edges(clean))
        cloud = dw.PointCloud(_points(camera, noisy))
        shots.append(shot_of(view, cloud, "z", HIDDEN_M, device))
    return shots


def shot_of(
    view: View, cloud: dw.PointCloud, kind: dw.cameras.DepthKind, right: float, device: str
) -> Shot:
    """A view of a cloud; a winner is hidden that lies 5 cm behind its pixel's true depth."""
    raw = dw.render(cloud, view.camera, depth=kind, max_range=math.inf, device=device)
    label = np.where(raw.depth > view.depth + HIDDEN_M, Label.HIDDEN, Label.VISIBLE)
    label = np.where(view.depth > 0, label, Label.UNKNOWN).astype(np.uint8)
    return Shot(view, cloud, raw, label, right)


def plain_edges(depth: Float64Array) -> BoolArray:
    """Within 5 px of where neighbours differ by 10 cm and 5 % of their depth [m]."""
    edges = np.zeros(depth.shape, dtype=bool)
    for axis in (0, 1):
        step = np.abs(np.diff(depth, axis=axis))
        nearer = np.minimum(np.delete(depth, -1, axis=axis), np.delete(depth, 0, axis=axis))
        jump = (nearer > 0) & (step > EDGE_M + EDGE_SHARE * nearer)
        ahead = [slice(None), slice(None)]
        ahead[axis] = slice(None, -1)
        edges[tuple(ahead)] |= jump
    return near(edges, BAND_PX)


def _frames(folder: Path) -> list[tuple[dw.PinholeCamera, Float64Array]]:
    """Camera and z depth [m] of every frame."""
    entries = json.loads((folder / "frames.json").read_text())
    return [
        (_camera(entries, frame["T_world_from_camera"]), _read(folder / frame["depth"]))
        for frame in entries["frames"]
    ]


def _camera(entries: dict[str, Any], world_from_camera: npt.ArrayLike) -> dw.PinholeCamera:
    size = entries["width"], entries["height"]
    matrix = np.array(world_from_camera)
    if np.linalg.det(matrix[:3, :3]) < 0:  # a world that is a mirror image: only one frame is used
        matrix = np.eye(4)
    return dw.PinholeCamera.from_matrix(
        entries["K"], size, optical_from_world=np.linalg.inv(matrix)
    )


def _read(path: Path) -> Float64Array:
    image: Any = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    return np.asarray(image, dtype=np.float64) / 1000.0


def _points(camera: dw.PinholeCamera, depth: Float64Array) -> npt.NDArray[np.float32]:
    points = camera.unproject(depth, "z")
    return points[np.isfinite(points[..., 0])].astype(np.float32)


def _agrees(points: Float64Array, camera: dw.PinholeCamera, measured: Float64Array) -> BoolArray:
    """Which world points, shape (N, 3), a frame measured, too."""
    u, v, depth, inside = camera.project(np.nan_to_num(points), depth="z")
    seen = np.zeros(len(points), dtype=bool)
    row, column = (np.floor(c[inside] + 0.5).astype(int) for c in (v, u))
    seen[inside] = np.abs(measured[row, column] - depth[inside]) <= SEEN_M
    return seen
