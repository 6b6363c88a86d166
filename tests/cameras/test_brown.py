"""Distorted pinholes: OpenCV's projection, its inverse, and where the lens would fold back."""

from __future__ import annotations

import json
import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.cameras.brown import BrownDistortion
from depthwarp.errors import InputError, LensDomainWarning
from tests.cameras.device_image import device_image
from tests.cameras.models import (
    IDENTITY,
    brown_coefficients,
    cameras_of,
    moved,
    plane_intrinsics,
    quietly,
    rational_coefficients,
)
from tests.rendering.strategies import seeds

COEFFICIENTS = {"brown": brown_coefficients, "rational": rational_coefficients}
POINTS = 102_000  # a few of them leave by the edge of the domain

# Of the kinds that are met: KITTI's raw left camera; a phone's, an action camera's, and the eight
# coefficients of a depth camera whose numerator and denominator nearly cancel.
KNOWN = [
    (
        (984.2439, 980.8141, 690.0, 233.1966),
        (1392, 512),
        (-0.3728755, 0.2037299, 0.002219027, 0.001383707, -0.07233722),
    ),
    ((3000, 3000, 2015.5, 1511.5), (4032, 3024), (0.1, -0.25, 0.0005, -0.0003, 0.15)),
    ((1100, 1100, 959.5, 539.5), (1920, 1080), (-0.25, 0.1, 0.0002, -0.0001, -0.015)),
    (
        (504, 504, 319.5, 287.5),
        (640, 576),
        (0.45, -0.05, 0.0001, 0.00003, 0.0005, 0.79, 0.02, -0.003),
    ),
]


def opencv_image(camera: dw.PinholeCamera, points_world: np.ndarray) -> np.ndarray:
    """cv2.projectPoints in float64, of points turned into the optical frame first: (2, N)."""
    transform = camera.pose.optical_from_world
    optical = points_world.astype(np.float64) @ transform[:3, :3].T + transform[:3, 3]
    image, _ = cv2.projectPoints(
        optical, np.zeros(3), np.zeros(3), camera.K, np.array(camera.distortion)
    )
    return image[:, 0].T


def points_in_view(camera: dw.Camera, rng: np.random.Generator, count: int) -> np.ndarray:
    """World points, float32, whose exact pictures are all over the image and its domain."""
    drawn = int(count / (1 - quietly(camera.lost_share))) + 1
    u, v = (rng.uniform(-0.5, side - 0.5, drawn) for side in camera.size)
    rays = camera.directions(u, v)
    rays = rays[np.isfinite(rays[:, 0])]
    camera_points = rays * rng.uniform(0.5, 15, len(rays))[:, None]
    return camera.pose.to_world(camera_points).astype(np.float32)


def real_camera(rng: np.random.Generator, make) -> dw.PinholeCamera:
    """A camera of 640 to 4000 px a side within 3 m of the origin."""
    size = int(rng.integers(640, 4001)), int(rng.integers(640, 4001))
    pose = moved(rng, dw.Pose.from_orientation(rng.uniform(-2, 2, 3), rng.uniform(-180, 180, 3)))
    intrinsics = plane_intrinsics(rng, size, (0.3, 1.2))
    return quietly(dw.PinholeCamera, *intrinsics, *size, pose, make(rng))


def kernel_error(camera: dw.Camera, points: np.ndarray, exact: np.ndarray, device: str) -> float:
    """Greatest distance of the kernel's u, v from exact ones; the pixel is the same but there."""
    uv = device_image(camera, points, device).astype(np.float64)
    error = abs(uv - exact)
    assert np.isfinite(error).all()
    pixel, expected = np.floor(uv.astype(np.float32) + np.float32(0.5)), np.floor(exact + 0.5)
    border = abs(exact + 0.5 - np.rint(exact + 0.5))
    assert (border[pixel != expected] < 0.01).all()
    return float(error.max())


# --- accuracy ---


@pytest.mark.parametrize("model", COEFFICIENTS)
@settings(max_examples=15)
@given(seed=seeds)
def test_projection_is_opencvs(model, seed):
    """`project` to 1e-9 of the image, of any calibration, within the lens's domain."""
    rng = np.random.default_rng(seed)
    camera = real_camera(rng, COEFFICIENTS[model])
    points = points_in_view(camera, rng, 500)
    u, v, _, _ = camera.project(points)
    exact = opencv_image(camera, points)
    drawn = np.isfinite(u)
    assert drawn.mean() > 0.99  # all but some that float32 moved over the edge of the domain
    np.testing.assert_allclose(np.stack([u, v])[:, drawn], exact[:, drawn], rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("model", COEFFICIENTS)
def test_the_kernel_is_within_a_hundredth_of_a_pixel(device, model):
    """Random calibrations, 10^5 points each all over the image, printed."""
    rng = np.random.default_rng(1)
    worst = 0.0
    for _ in range(4):
        camera = real_camera(rng, COEFFICIENTS[model])
        points = points_in_view(camera, rng, POINTS)
        points = points[inside_the_edge(camera, points)]
        error = kernel_error(camera, points, opencv_image(camera, points), device)
        print(f"{model} {camera.size}: {len(points)} points, at most {error:.5f} px off")
        worst = max(worst, error)
    assert worst < 0.01


def inside_the_edge(camera: dw.PinholeCamera, points: np.ndarray) -> np.ndarray:
    """Whether float32 cannot have moved a point over the edge of the domain."""
    x, y, z = camera.pose.to_camera(points).T
    return np.hypot(y, z) < x * camera.lens.max_radius * (1 - 1e-5)


@pytest.mark.parametrize(("intrinsics", "size", "distortion"), KNOWN)
def test_known_calibrations(device, intrinsics, size, distortion):
    """Lenses of real kinds: they do not warn, and both projections are OpenCV's."""
    camera = dw.PinholeCamera(*intrinsics, *size, IDENTITY, distortion)
    points = points_in_view(camera, np.random.default_rng(2), POINTS)
    exact = opencv_image(camera, points)
    u, v, _, _ = camera.project(points)
    np.testing.assert_allclose(np.stack([u, v]), exact, rtol=1e-9, atol=1e-9)
    error = kernel_error(camera, points, exact, device)
    print(f"{size}: at most {error:.5f} px off")
    assert error < 0.01


def test_calibrations_of_real_recordings(device, shared_data: Path):
    """Intrinsics and poses of the recordings: undistorted ones, printed."""
    folders = [f for f in sorted(shared_data.glob("rgbd_*")) if (f / "frames.json").is_file()]
    if not folders:
        pytest.skip(f"no real calibrations on this machine: none in {shared_data}")
    for folder in folders:
        entries = json.loads((folder / "frames.json").read_text())
        size = entries["width"], entries["height"]
        camera = dw.PinholeCamera.from_matrix(entries["K"], size, (0.0,) * 4 + (1e-12,))
        points = points_in_view(camera, np.random.default_rng(3), POINTS)
        error = kernel_error(camera, points, opencv_image(camera, points), device)
        print(f"{folder.name}: at most {error:.5f} px off")
        assert error < 0.01


# --- the inverse ---


@pytest.mark.parametrize("model", COEFFICIENTS)
@settings(max_examples=25)
@given(data=st.data())
def test_directions_invert_the_projection(model, data):
    """Every pixel that has a ray is where the ray is drawn, to 1e-7 px."""
    camera = data.draw(cameras_of(model))
    v, u = np.indices((camera.height, camera.width), dtype=np.float64)
    rays = camera.directions(u, v)
    seen = np.isfinite(rays[..., 0])
    again_u, again_v = camera.image_of(rays[seen])
    drawn = np.isfinite(again_u)
    assert drawn.sum() >= seen.sum() - 4  # one on the very edge may round over it
    np.testing.assert_allclose(again_u[drawn], u[seen][drawn], atol=1e-7)
    np.testing.assert_allclose(again_v[drawn], v[seen][drawn], atol=1e-7)


@pytest.mark.parametrize("model", COEFFICIENTS)
@settings(max_examples=15)
@given(seed=seeds, part=st.floats(0, 0.9999))
def test_every_ray_of_the_domain_comes_back(model, seed, part):
    """Ideal coordinates up to the edge: bent and straightened they are the same ones."""
    rng = np.random.default_rng(seed)
    lens = BrownDistortion.from_coefficients(COEFFICIENTS[model](rng))
    angle = rng.uniform(0, 2 * np.pi, 200)
    radius = np.sqrt(rng.uniform(0, 1, 200)) * part * min(lens.max_radius, 3.0)
    a, b = radius * np.cos(angle), radius * np.sin(angle)
    x, y = lens.apply(a, b)
    back = lens.undo(x, y)
    drawn = np.isfinite(x)  # a tilted sensor does not reach everything
    np.testing.assert_allclose(back[0][drawn], a[drawn], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(back[1][drawn], b[drawn], rtol=1e-5, atol=1e-5)


# --- the domain ---


def brute_force_radius(coefficients: tuple[float, ...], most: float) -> float:
    """Where the determinant of cv2.projectPoints' Jacobian (differences) is first not above 0."""
    bare = np.array((*coefficients, *[0.0] * 14)[:12])  # a tilt folds nothing
    angles = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    radii = np.linspace(0, most, 801)[1:]
    a, b = radii[:, None] * np.cos(angles), radii[:, None] * np.sin(angles)
    step = 1e-6

    def image(a, b):
        plane = np.stack([a.ravel(), b.ravel(), np.ones(a.size)], axis=1)
        bent, _ = cv2.projectPoints(plane, np.zeros(3), np.zeros(3), np.eye(3), bare)
        return bent[:, 0].reshape(*a.shape, 2)

    by_a = (image(a + step, b) - image(a - step, b)) / (2 * step)
    by_b = (image(a, b + step) - image(a, b - step)) / (2 * step)
    determinant = by_a[..., 0] * by_b[..., 1] - by_a[..., 1] * by_b[..., 0]
    folded = np.flatnonzero((determinant <= 0).any(axis=1))
    return float(radii[folded[0]]) if folded.size else np.inf


@pytest.mark.parametrize("model", COEFFICIENTS)
def test_the_edge_of_the_domain_is_the_first_fold(model):
    """`max_radius` against a brute-force search up to a radius of 3 (72 degrees)."""
    rng = np.random.default_rng(4)
    compared = 0
    for _ in range(8):
        coefficients = np.array(COEFFICIENTS[model](rng))
        coefficients[2:4] *= 8  # so that directions differ
        lens = BrownDistortion.from_coefficients(coefficients)
        exact = brute_force_radius(lens.coefficients, 3.0)
        if exact < 3:
            assert lens.max_radius == pytest.approx(exact, abs=0.006)
            compared += 1
        else:
            assert lens.max_radius > 2.994
    assert compared >= 3


@pytest.mark.parametrize(
    ("coefficients", "radius"),
    [
        ((-0.3, 0, 0, 0), (1 / 0.9) ** 0.5),  # 1 + 3 k1 r^2 = 0
        ((0, -0.2, 0, 0), 1.0),  # 1 + 5 k2 r^4 = 0
        ((0.1, 0, 0, 0), np.inf),
        ((-1e-7, 0, 0, 0), (1 / 3e-7) ** 0.5),  # beyond 89.9 degrees it folds all the same
        ((0, 0, 0, 0, 0, -0.25, 0, 0), 2.0),  # the denominator is 0
        ((0, 0, 0, 0, 0, 0.25, 0, 0), 2.0),  # r / (1 + r^2 / 4) is greatest at 2
    ],
)
def test_the_edge_by_hand(coefficients, radius):
    """Where the radial part stops to grow, or its denominator to be above 0."""
    lens = BrownDistortion.from_coefficients(coefficients)
    assert lens.max_radius == pytest.approx(radius, rel=1e-9)


def test_nothing_folds_back(device):
    """Points beyond the edge, whose formula comes back into the image, are outside, not drawn."""
    k1 = -0.3
    camera = quietly(dw.PinholeCamera, 300, 300, 319.5, 239.5, 640, 480, IDENTITY, (k1, 0, 0, 0))
    radius = np.linspace(0, 3, 601)[1:]
    points = np.stack([np.full(600, 2.0), -2 * radius, np.zeros(600)], axis=1).astype(np.float32)
    bent = radius * (1 + k1 * radius**2)
    came_back = (radius > (1 / 0.9) ** 0.5) & (abs(300 * bent) < 319)
    assert came_back.sum() > 100
    depth_map = dw.render(dw.PointCloud(points), camera, device=device)
    winners = depth_map.index[depth_map.index >= 0]
    assert winners.size > 100 and not came_back[winners].any()
    assert depth_map.stats.outside == (radius > camera.lens.max_radius).sum()
    u, _, _, valid = camera.project(points)
    np.testing.assert_array_equal(valid, np.isfinite(u))
    assert not valid[came_back].any()


@pytest.mark.parametrize("model", COEFFICIENTS)
def test_every_winner_is_on_the_ray_of_its_pixel(device, model):
    """Strong random lenses, points everywhere: a pixel's point lies within a pixel of its ray."""
    rng = np.random.default_rng(5)
    points = rng.uniform(-10, 10, (60_000, 3)).astype(np.float32)
    for _ in range(4):
        coefficients = np.array(COEFFICIENTS[model](rng)) * 1.3
        intrinsics = plane_intrinsics(rng, (160, 120), (0.8, 1.6))
        camera = quietly(dw.PinholeCamera, *intrinsics, 160, 120, IDENTITY, tuple(coefficients))
        depth_map = dw.render(dw.PointCloud(points), camera, device=device)
        v, u = np.nonzero(depth_map.index >= 0)
        assert len(u) > 500
        winners = points[depth_map.index[v, u]].astype(np.float64)
        exact_u, exact_v, _, valid = camera.project(winners)
        assert valid.mean() > 0.999  # but for some within float32's rounding of a border
        # The double-precision inverse of where it was drawn is the point's own direction.
        rays = camera.directions(exact_u[valid], exact_v[valid])
        along = winners[valid] / np.linalg.norm(winners[valid], axis=1)[:, None]
        np.testing.assert_allclose(rays, along, atol=1e-4)  # beside a fold a ray is not sharper
        assert (abs(exact_u[valid] - u[valid]) <= 0.51).all()
        assert (abs(exact_v[valid] - v[valid]) <= 0.51).all()


@pytest.mark.parametrize(
    ("k1", "half"), [(-0.3, 0.75), (-0.3, 1.2), (-0.5, 0.6), (-0.28, 0.72), (-0.25, 0.5)]
)
def test_lost_pixels_warn_with_their_share(k1, half):
    """The share of pixels farther out than the lens draws; none is lost: no warning."""
    greatest = (-1 / (3 * k1)) ** 0.5 * 2 / 3  # r (1 + k1 r^2) at the edge of the domain
    v, u = np.indices((480, 640))
    f = 320 / half
    lost = (np.hypot(u - 319.5, v - 239.5) > greatest * f).mean()
    arguments = (f, f, 319.5, 239.5, 640, 480, IDENTITY, (k1, 0, 0, 0))
    if lost == 0:
        dw.PinholeCamera(*arguments)  # warnings are errors
        return
    with pytest.warns(LensDomainWarning, match="folds back") as caught:
        camera = dw.PinholeCamera(*arguments)
    assert camera.lost_share() == pytest.approx(lost, abs=0.02)
    assert f"{camera.lost_share():.1%}" in str(caught[0].message)
    assert caught[0].filename == __file__


def test_a_pose_does_not_repeat_the_warning():
    """`with_pose` moves the camera: same lens, nothing of it is looked at again."""
    camera = quietly(dw.PinholeCamera, 300, 300, 319.5, 239.5, 640, 480, IDENTITY, (-0.4, 0, 0, 0))
    pose = dw.Pose.from_orientation((1, 2, 3), (4, 5, 6))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        moved_camera = camera.with_pose(pose)
    assert moved_camera.pose == pose and camera.pose == IDENTITY
    assert moved_camera.lens is camera.lens and moved_camera.with_pose(IDENTITY) == camera


# --- coefficients ---


def test_trailing_zeros_are_dropped_by_groups():
    """4, 5, 8, 12 or 14 remain; an ideal lens has none."""
    for given_, kept in [((0,) * 14, 0), ((0, 0, 0.1, 0, 0), 4), ((0.1, *[0] * 13), 4)]:
        assert len(BrownDistortion.from_coefficients(given_).coefficients) == kept
    for place, kept in [(4, 5), (5, 8), (7, 8), (8, 12), (12, 14), (13, 14)]:
        values = np.zeros(14)
        values[place] = 0.01
        assert len(BrownDistortion.from_coefficients(values).coefficients) == kept


@pytest.mark.parametrize("count", [1, 3, 6, 7, 9, 13, 15])
def test_another_number_of_coefficients_is_refused(count):
    """The message lists the numbers and the order."""
    with pytest.raises(InputError, match=rf"4, 5, 8, 12, 14 coefficients.*got {count}"):
        dw.PinholeCamera.from_matrix(np.eye(3), (4, 4), [0.1] * count)


def test_a_coefficient_that_is_not_finite_is_refused():
    """By name."""
    with pytest.raises(InputError, match="distortion"):
        dw.PinholeCamera.from_matrix(np.eye(3), (4, 4), [0.1, np.nan, 0, 0])
