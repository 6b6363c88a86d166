"""Cameras of every model as hypothesis draws them, and what the references say of them."""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Callable

import numpy as np
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.errors import LensDomainWarning
from tests.reference import lenses, projection, rotation, zbuffer
from tests.rendering.strategies import orientations, position_frames, positions, seeds

XYZ = tuple[np.ndarray, np.ndarray, np.ndarray]

IDENTITY = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))


def quietly(make: Callable, *arguments, **options):
    """`make(...)`, whether or not its lens reaches the corners of its image."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LensDomainWarning)
        return make(*arguments, **options)


# --- random cameras ---


@st.composite
def poses(draw: st.DrawFn) -> dw.Pose:
    """Poses within 3 m of the origin, turned in any way, of both readings of P_C."""
    return dw.Pose.from_orientation(draw(positions), draw(orientations), draw(position_frames))


def sizes(rng: np.random.Generator, most: int) -> tuple[int, int]:
    """A width and a height from 1 to `most`."""
    width, height = rng.integers(1, most + 1, 2)
    return int(width), int(height)


def plane_intrinsics(
    rng: np.random.Generator, size: tuple[int, int], reach: tuple[float, float]
) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy: half the width is `reach` on the plane (or radians of a fisheye)."""
    width, height = size
    fx = 0.5 * width / rng.uniform(*reach)
    off = rng.uniform(-0.05, 0.05, 2)
    return (
        fx,
        fx * rng.uniform(0.9, 1.1),
        (width - 1) / 2 + off[0] * width,
        (height - 1) / 2 + off[1] * height,
    )


def brown_coefficients(rng: np.random.Generator) -> tuple[float, ...]:
    """k1, k2, p1, p2, k3 of real lenses and somewhat beyond."""
    return tuple((rng.uniform(-1, 1, 5) * (0.4, 0.3, 0.005, 0.005, 0.15)).tolist())


def rational_coefficients(rng: np.random.Generator) -> tuple[float, ...]:
    """All 14 coefficients: a weak quotient, thin prism, a sensor tilted by up to 3 degrees."""
    spread = [1.0, 0.4, 0.003, 0.003, 0.1, 1.0, 0.4, 0.1, *[0.005] * 4, 0.05, 0.05]
    values = rng.uniform(-1, 1, 14) * spread
    values[5] = values[0] + rng.uniform(-0.3, 0.3)  # numerator and denominator nearly cancel
    values[6] = values[1] + rng.uniform(-0.1, 0.1)
    return tuple(values.tolist())


def random_pinhole(rng: np.random.Generator, pose: dw.Pose, most: int) -> dw.PinholeCamera:
    size = sizes(rng, most)
    return dw.PinholeCamera(*plane_intrinsics(rng, size, (0.2, 2)), *size, pose)


def random_brown(rng: np.random.Generator, pose: dw.Pose, most: int) -> dw.PinholeCamera:
    size = sizes(rng, most)
    intrinsics = plane_intrinsics(rng, size, (0.3, 1.2))
    return quietly(dw.PinholeCamera, *intrinsics, *size, pose, brown_coefficients(rng))


def random_rational(rng: np.random.Generator, pose: dw.Pose, most: int) -> dw.PinholeCamera:
    size = sizes(rng, most)
    intrinsics = plane_intrinsics(rng, size, (0.3, 1.2))
    return quietly(dw.PinholeCamera, *intrinsics, *size, pose, rational_coefficients(rng))


def random_fisheye(rng: np.random.Generator, pose: dw.Pose, most: int) -> dw.FisheyeCamera:
    size = sizes(rng, most)
    intrinsics = plane_intrinsics(rng, size, (0.5, 2))
    coefficients = tuple((rng.uniform(-1, 1, 4) * (0.05, 0.02, 0.005, 0.001)).tolist())
    return quietly(dw.FisheyeCamera, *intrinsics, *size, pose, coefficients)


def random_double_sphere(
    rng: np.random.Generator, pose: dw.Pose, most: int
) -> dw.DoubleSphereCamera:
    size = sizes(rng, most)
    intrinsics = plane_intrinsics(rng, size, (0.5, 1.5))
    xi, alpha = rng.uniform(-0.6, 0.6), rng.uniform(0, 0.95)
    return quietly(dw.DoubleSphereCamera, *intrinsics, xi, alpha, *size, pose)


def random_equirectangular(
    rng: np.random.Generator, pose: dw.Pose, most: int
) -> dw.EquirectangularCamera:
    azimuths = float(rng.choice([360.0, rng.uniform(30, 360)]))
    low, high = float(rng.choice([-90.0, -40.0])), float(rng.choice([90.0, 25.0]))
    return dw.EquirectangularCamera(*sizes(rng, most), pose, azimuths, (low, high))


def random_cylindrical(rng: np.random.Generator, pose: dw.Pose, most: int) -> dw.CylindricalCamera:
    azimuths = float(rng.choice([360.0, rng.uniform(30, 360)]))
    elevations = (float(rng.uniform(-80, -5)), float(rng.uniform(5, 80)))
    return dw.CylindricalCamera(*sizes(rng, most), pose, azimuths, elevations)


def random_orthographic(
    rng: np.random.Generator, pose: dw.Pose, most: int
) -> dw.OrthographicCamera:
    size = sizes(rng, most)
    return dw.OrthographicCamera(float(rng.uniform(0.5, 5) / max(size)), *size, pose)


def random_lidar(rng: np.random.Generator, pose: dw.Pose, most: int) -> dw.SpinningLidar:
    """Beams in any order, with or without azimuth offsets, origin offset and azimuth 0."""
    beams = int(rng.integers(2, max(3, min(most, 64))))
    step = rng.uniform(0.5, 1.5, beams) * rng.uniform(0.3, 50 / beams)
    elevations = rng.permutation(np.cumsum(step) - rng.uniform(0, step.sum()))
    width = int(rng.integers(max(2, most // 2), most + 2))
    return dw.SpinningLidar(
        width,
        tuple(elevations.tolist()),
        pose,
        azimuth_zero=rng.choice([None, rng.uniform(-width, 2 * width)]),
        beam_azimuths=tuple(rng.uniform(-8, 8, beams).tolist()) if rng.random() < 0.5 else None,
        origin_offset=float(rng.choice([0.0, 0.0277])),
    )


def random_moving_lidar(rng: np.random.Generator, pose: dw.Pose, most: int) -> dw.SpinningLidar:
    """A sensor that moves by up to 0.3 m and 2 degrees in a turn."""
    lidar = random_lidar(rng, pose, most)
    return dataclasses.replace(lidar, pose_end=moved(rng, pose))


def moved(rng: np.random.Generator, pose: dw.Pose) -> dw.Pose:
    """A pose, up to 0.3 m and 2 degrees farther."""
    turn = dw.Pose.from_orientation((0, 0, 0), rng.uniform(-1, 1, 3) * 2 / np.sqrt(3))
    way = rng.uniform(-1, 1, 3) * 0.3 / np.sqrt(3)
    rows = tuple(map(tuple, (turn.rotation @ pose.rotation).tolist()))
    return dw.Pose(rows, tuple((pose.center_world + way).tolist()))


MODELS = {
    "pinhole": random_pinhole,
    "brown": random_brown,
    "rational": random_rational,
    "fisheye": random_fisheye,
    "double_sphere": random_double_sphere,
    "equirectangular": random_equirectangular,
    "cylindrical": random_cylindrical,
    "orthographic": random_orthographic,
    "spinning": random_lidar,
    "moving": random_moving_lidar,
}
"""Makers of random cameras (rng, pose, greatest side), by the name of the kernels' model."""


@st.composite
def cameras_of(draw: st.DrawFn, model: str, max_side: int = 24) -> dw.Camera:
    """Random cameras of one model, small so that many points meet in a pixel."""
    return MODELS[model](np.random.default_rng(draw(seeds)), draw(poses()), max_side)


# --- what the references say ---


def intrinsics_of(camera: dw.Camera) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy."""
    return camera.fx, camera.fy, camera.cx, camera.cy


def lidar_numbers(camera: dw.SpinningLidar) -> tuple:
    """Intrinsics, distance of the beams' origins from the axis, and the beams."""
    beams = camera.limits, camera.order, camera.offsets[camera.order]
    return (camera.fx, camera.cx, camera.width), camera.origin_offset, beams


def twin_image(camera: dw.Camera, xyz: XYZ) -> tuple[np.ndarray, np.ndarray]:
    """u, v in float32 of points in the camera frame, as the model's kernel computes them."""
    if isinstance(camera, dw.OrthographicCamera):
        return lenses.project_orthographic(*xyz, camera.pixel_size, camera.cx, camera.cy)
    if isinstance(camera, dw.SpinningLidar):
        return lenses.project_spinning(*xyz, *lidar_numbers(camera))
    numbers = intrinsics_of(camera)
    if isinstance(camera, dw.EquirectangularCamera | dw.CylindricalCamera):
        period = camera.width if camera.azimuths == 360 else 0
        if isinstance(camera, dw.CylindricalCamera):
            return lenses.project_cylindrical(*xyz, numbers, period)
        return lenses.project_equirectangular(*xyz, numbers, period, camera.row_limits())
    if isinstance(camera, dw.FisheyeCamera):
        return lenses.project_fisheye(*xyz, numbers, camera.distortion, camera.max_angle)
    if isinstance(camera, dw.DoubleSphereCamera):
        domain = camera.xi, camera.alpha, camera.least_cosine
        return lenses.project_double_sphere(*xyz, numbers, *domain)
    if not camera.distortion:
        return projection.project_pinhole(*xyz, *numbers, np.float32)
    padded = (*camera.distortion, *[0.0] * 14)
    if len(camera.distortion) <= 5:
        return lenses.project_brown(*xyz, numbers, padded[:5], camera.lens.max_radius)
    return lenses.project_rational(
        *xyz, numbers, padded[:14], camera.lens.tilt, camera.lens.max_radius
    )


def twin_camera_points(camera: dw.Camera, points: np.ndarray) -> XYZ:
    """X, Y, Z in float32, as the model's kernel computes them."""
    pose = camera.pose
    if isinstance(camera, dw.SpinningLidar) and camera.pose_end is not None:
        numbers = lidar_numbers(camera)
        return lenses.to_camera_moving(
            points, *camera.column_poses, lambda *xyz: lenses.meet_spinning(*xyz, *numbers)[0]
        )
    return rotation.to_camera(points, pose.rotation, pose.position, pose.shift, np.float32)


def twin_depth(camera: dw.Camera, xyz: XYZ, kind: str) -> np.ndarray:
    """Depths in float32 of points in the camera frame."""
    if isinstance(camera, dw.OrthographicCamera):
        kind = "z"
    if isinstance(camera, dw.SpinningLidar):
        return lenses.range_spinning(*xyz, camera.origin_offset)
    return zbuffer.DEPTH_KINDS[kind](*xyz, np.float32)


def sees_ahead_only(camera: dw.Camera, kind: str) -> bool:
    """Whether points behind are counted so."""
    return kind == "z" or isinstance(camera, dw.PinholeCamera | dw.OrthographicCamera)


def least_z_cosine(camera: dw.Camera, kind: str) -> float:
    """Cosine of the angle from the axis at which a kind of depth ends before 90 degrees, or 0."""
    wide = isinstance(camera, dw.FisheyeCamera | dw.DoubleSphereCamera)
    return float(np.cos(np.radians(85))) if wide and kind == "z" else 0.0
