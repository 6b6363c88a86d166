"""What the tests of `docs/conventions.md` share: the mark of a sentence, cameras, small helpers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

import depthwarp as dw

ORIGIN = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))
SQUARE = dw.PinholeCamera(10.0, 10.0, 5.0, 5.0, 11, 11, ORIGIN)
PANORAMAS = [
    dw.EquirectangularCamera.looking((360, 180), orientation=(0, 0, 30)),
    dw.CylindricalCamera.looking((360, 90), orientation=(0, 0, 30)),
]
DISTORTION = (
    -0.2,
    0.06,
    1e-3,
    -2e-3,
    -0.01,
    0.02,
    0.01,
    -0.003,
    1e-3,
    -1e-3,
    2e-3,
    5e-4,
    0.01,
    -0.02,
)


def says(sentence: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Mark the test of a sentence."""

    def mark(test: Callable[..., None]) -> Callable[..., None]:
        test.sentence = sentence  # type: ignore[attr-defined]
        return test

    return mark


def looking(roll: float, pitch: float, yaw: float) -> dw.PinholeCamera:
    """A camera at the origin, 90 degrees wide."""
    return dw.PinholeCamera.from_fov((90, 90), (11, 11), orientation=(roll, pitch, yaw))


def pixel(camera: dw.Camera, point: tuple[float, float, float]) -> tuple[float, float]:
    """(u, v) of a world point."""
    u, v, _, _ = camera.project(np.array([point]))
    return float(u[0]), float(v[0])


def drawn(camera: dw.Camera, *points: tuple[float, float, float], **options) -> dw.DepthMap:
    """The depth map of some points."""
    cloud = dw.PointCloud(np.array(points, np.float32).reshape(-1, 3))
    return dw.render(cloud, camera, device="cpu", **options)
