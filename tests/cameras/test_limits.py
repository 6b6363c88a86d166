"""Bounds of what a camera sees: they hold every ray of the image, and not much more."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings

import depthwarp as dw
from depthwarp.cameras.limits import WIDER, cone_limits, plane_limits
from tests.cameras.models import IDENTITY, MODELS, quietly
from tests.rendering.strategies import seeds

PLANE_MODELS = ["pinhole", "brown", "rational"]
CONE_MODELS = ["fisheye", "double_sphere"]
WHOLE = (0.0, 1.0, 0.0, 1.0) * 2 + (0.0,) * 8  # all that is ahead is seen, nothing for certain


def rays_in(camera: dw.Camera) -> np.ndarray:
    """Rays all over the image and on its border, shape (N, 3), without those of no domain."""
    u = np.linspace(-0.5, camera.width - 0.5, 83)
    v = np.linspace(-0.5, camera.height - 0.5, 71)
    rays = camera.directions(*np.meshgrid(u, v)).reshape(-1, 3)
    return rays[~np.isnan(rays[:, 0])]


def camera_of(model: str, seed: int) -> dw.Camera:
    """A random camera of a model at the origin."""
    rng = np.random.default_rng(seed)
    return MODELS[model](rng, IDENTITY, int(rng.choice([2, 30, 2000])))


def distances(camera: dw.Camera, rays: np.ndarray, first: int = 0) -> np.ndarray:
    """Signed distances of rays' ends from the four planes, shape (N, 4), inward above 0."""
    planes = plane_limits(camera)[first : first + 8]
    left_y, left_x, right_y, right_x, upper_z, upper_x, lower_z, lower_x = planes
    normals = np.array(
        [[left_x, left_y, 0], [right_x, right_y, 0], [upper_x, 0, upper_z], [lower_x, 0, lower_z]]
    )
    if any(planes):  # of inner planes, none where nothing is certain
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, rtol=1e-12)
    return rays @ normals.T


@pytest.mark.parametrize("model", PLANE_MODELS)
@settings(max_examples=20)
@given(seed=seeds)
def test_planes_hold_every_ray(model, seed):
    """Of any lens, whether or not its domain covers the image, with room to spare."""
    camera = camera_of(model, seed)
    rays = rays_in(camera)
    assert (distances(camera, rays) > 0).all()


@pytest.mark.parametrize("model", CONE_MODELS)
@settings(max_examples=20)
@given(seed=seeds)
def test_cones_hold_every_ray(model, seed):
    """Also of lenses that see beside and behind themselves."""
    camera = camera_of(model, seed)
    cosine, sine = cone_limits(camera, math.pi)
    assert math.isclose(cosine * cosine + sine * sine, 1, rel_tol=1e-12) and sine >= 0
    assert (rays_in(camera)[:, 0] >= cosine).all()


@pytest.mark.parametrize("fov", [(1.0, 0.5), (60.0, 45.0), (120.0, 90.0), (170.0, 20.0)])
def test_planes_are_tight(fov):
    """Of a pinhole: half the field of view and the margin, on each side."""
    limits = plane_limits(dw.PinholeCamera.from_fov(fov, (64, 48)))
    for k, angle in enumerate((fov[0], fov[0], fov[1], fov[1]) * 2):
        half = math.radians(angle) / 2 + (WIDER if k < 4 else -WIDER)
        side = -1 if k % 2 == 0 else 1  # left and upper rays lie at positive y and z
        np.testing.assert_allclose(limits[2 * k], side * math.cos(half), atol=1e-9)
        np.testing.assert_allclose(limits[2 * k + 1], math.sin(half), atol=1e-9)


@pytest.mark.parametrize("model", PLANE_MODELS)
@settings(max_examples=20)
@given(seed=seeds)
def test_inner_planes_hold_only_rays_of_the_image(model, seed):
    """Whatever lies between the inner planes is in the image and in the lens's domain."""
    camera = camera_of(model, seed)
    rng = np.random.default_rng(seed)
    rays = np.column_stack([np.ones(4000), np.tan(rng.uniform(-1.57, 1.57, (4000, 2)))])
    near = rays_in(camera)[::3]
    rays = np.concatenate([rays, near + rng.normal(0, 0.01, near.shape)])
    within = (distances(camera, rays, 8) > 0).all(axis=1) & (rays[:, 0] > 0)
    u, v = camera.image_of(rays[within])
    assert ((u > -0.5) & (u < camera.width - 0.5)).all()
    assert ((v > -0.5) & (v < camera.height - 0.5)).all()


def test_inner_planes_hold_most_of_an_image():
    """Of a lens whose domain is larger than its image; else the test above says nothing."""
    camera = dw.PinholeCamera(
        500.0, 510.0, 310.0, 250.0, 640, 480, IDENTITY, (-0.2, 0.05, 1e-3, -1e-3, 0.01)
    )
    within = (distances(camera, rays_in(camera), 8) > 0).all(axis=1)
    assert 0.9 < within.mean() < 1


def test_planes_know_left_from_right():
    """An axis at the left border of the image: what is seen lies to its right, below 0 in y."""
    camera = dw.PinholeCamera(50.0, 50.0, -0.5, 30.0, 50, 61, IDENTITY)
    ahead_left, ahead_right = (1, 0.5, 0), (1, -0.5, 0)
    seen = distances(camera, np.array([ahead_left, ahead_right], float))
    assert (seen[1] > 0).all() and seen[0, 0] < 0


def test_cones_are_tight():
    """Of an equidistant fisheye: the angle of the corner and the margin."""
    camera = dw.FisheyeCamera(100.0, 100.0, 49.5, 49.5, 100, 100, IDENTITY)
    cosine, sine = cone_limits(camera, camera.max_angle)
    assert math.atan2(sine, cosine) == pytest.approx(math.hypot(0.5, 0.5) + WIDER, abs=5e-4)


def test_a_domain_smaller_than_the_image_bounds_nothing():
    """Where border pixels have no ray, border rays say nothing of those within."""
    folding = quietly(
        dw.PinholeCamera, 30.0, 30.0, 31.5, 23.5, 64, 48, IDENTITY, (-0.5, 0.1, 0.0, 0.0, 0.0)
    )
    np.testing.assert_allclose(plane_limits(folding), WHOLE, atol=1e-15)
    wide = quietly(dw.FisheyeCamera, 10.0, 10.0, 49.5, 49.5, 100, 100, IDENTITY)
    assert cone_limits(wide, 2.5) == (math.cos(2.5), math.sin(2.5))
    assert cone_limits(wide, wide.max_angle) == (math.cos(math.pi), math.sin(math.pi))


def test_planes_of_the_widest_pinhole_stay_ahead():
    """Half a field of view of 89.95 degrees and the margin are not more than 90."""
    limits = plane_limits(dw.PinholeCamera.from_fov((179.9, 179.9), (64, 48)))
    np.testing.assert_allclose(limits[:8], WHOLE[:8], atol=1e-15)


@pytest.mark.parametrize("model", ["equirectangular", "cylindrical"])
@settings(max_examples=20)
@given(seed=seeds)
def test_bands_hold_every_ray(model, seed):
    """Of any panorama: elevations of the image and a margin, from pole to pole at most."""
    camera = camera_of(model, seed)
    low_cos, low_sin, high_cos, high_sin = camera.cull_limits
    heights = rays_in(camera)[:, 2]
    assert (heights >= low_sin - 1e-15).all() and (heights <= high_sin + 1e-15).all()
    low, high = math.atan2(low_sin, low_cos), math.atan2(high_sin, high_cos)
    assert -math.pi / 2 <= low < high <= math.pi / 2
    lowest, highest = np.radians(camera.elevations)
    pixel = (highest - lowest) / camera.height
    assert low >= lowest - pixel - 0.02 and high <= highest + pixel + 0.02
