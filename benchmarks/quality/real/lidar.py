"""Recorded laser sweeps: some of the returns are kept back, and judge what is filled in."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

import depthwarp as dw
from benchmarks.quality.evaluate import Shot
from benchmarks.quality.real.rgbd import plain_edges, shot_of
from benchmarks.quality.truth import Label, View

__all__ = ["kitti", "ouster"]

OUSTER_RIGHT_M, KITTI_RIGHT_M = 0.10, 0.20
OUSTER_KEPT, KITTI_KEPT = 0.5, 0.75
SWEEPS = {"os0_128_street": "os0_128_street", "os1_128_seq_0": "os1_128_seq"}
DRIVES = ("testing_000000", "testing_000002", "testing_000007")
SEED = 3


def ouster(data: Path, device: str = "cpu") -> list[Shot]:
    """Range images of which half the returns are dropped; the dropped ones count.

    The images were set straight, so a sensor with upright columns renders the kept returns
    into their own pixels. Right is within 10 cm of the range.
    """
    generator = np.random.default_rng(SEED)
    shots = []
    for name, description in SWEEPS.items():
        entries = json.loads((data / "ouster" / f"{description}.json").read_text())
        ranges = np.load(data / "ouster" / f"{name}.npz")["range_mm"] / 1000.0
        pose = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))
        elevations = tuple(entries["beam_altitude_angles_deg"])
        lidar = dw.SpinningLidar(ranges.shape[1], elevations, pose)
        kept = generator.random(ranges.shape) < OUSTER_KEPT
        points = lidar.unproject(np.where(kept, ranges, 0.0))
        cloud = dw.PointCloud(points[np.isfinite(points[..., 0])].astype(np.float32))
        view = View(lidar, ranges, ranges > 0, plain_edges(ranges))
        shot = shot_of(view, cloud, "range", OUSTER_RIGHT_M, device)
        shots.append(replace(shot, held_out=(ranges > 0) & ~kept))
    return shots


def kitti(data: Path, device: str = "cpu") -> list[Shot]:
    """Sweeps seen by the car's camera: three of four points are drawn, the others count.

    Camera and scanner stand apart, so a few of the points that count are hidden from the camera
    themselves; they are the same for every chain. What hides what is not known.
    Right is within 20 cm.
    """
    generator = np.random.default_rng(SEED)
    shots = []
    for name in DRIVES:
        entries = json.loads((data / "kitti" / f"{name}_calib.json").read_text())
        camera = dw.PinholeCamera.from_matrix(
            entries["K_camera2"],
            (entries["width"], entries["height"]),
            optical_from_world=entries["T_camera2_from_lidar"],
        )
        points = dw.read(data / "kitti" / f"{name}.bin").points_world
        kept = generator.random(len(points)) < KITTI_KEPT
        rest = dw.PointCloud(points[~kept])
        truth = dw.render(rest, camera, depth="z", max_range=200.0, device=device).depth
        depth = truth.astype(np.float64)
        view = View(camera, depth, depth > 0, np.zeros(depth.shape, dtype=bool))
        shot = shot_of(view, dw.PointCloud(points[kept]), "z", KITTI_RIGHT_M, device)
        unknown = np.full(depth.shape, Label.UNKNOWN, dtype=np.uint8)
        shots.append(replace(shot, label=unknown))
    return shots
