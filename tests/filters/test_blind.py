"""Pixels that a lens has no ray for stay empty, whatever a filter would write there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

import depthwarp as dw
from depthwarp.errors import LensDomainWarning
from depthwarp.filters.blind import _blind_of, blind_pixels
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.inputs import device_points
from depthwarp.rendering.plan import RenderPlan
from depthwarp.rendering.views import ViewPlan
from tests.filters.maps import arrays_of, assert_maps, make_map

POSE = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))

FILLS = [
    dw.filters.fill("plane"),
    dw.filters.fill("nearest", radius=9),
    dw.filters.fill("push_pull"),
    dw.filters.dilate(side=9),
]


@pytest.fixture(scope="module")
def fisheye() -> dw.FisheyeCamera:
    """Its image is a circle of 25 px radius in 70 x 60 px."""
    with pytest.warns(LensDomainWarning):
        return dw.FisheyeCamera(8.0, 8.0, 35.0, 30.0, 70, 60, POSE)


def has_ray(camera: dw.Camera, kind: str = "range") -> np.ndarray:
    """Where `unproject` gives a point."""
    return np.isfinite(camera.unproject(np.ones((camera.height, camera.width)), kind)).all(axis=-1)


def circle_map(camera: dw.Camera, kind: str = "range") -> dw.DepthMap:
    """A third of the pixels that have a ray was measured."""
    drawn = has_ray(camera, kind) & (np.random.default_rng(5).random((60, 70)) < 0.3)
    return replace(make_map(np.where(drawn, 3.0, 0.0), camera), kind=kind)


def mixed_states(camera: dw.Camera) -> dw.DepthMap:
    """A third of all pixels, with a ray or without, hold a depth, in all states that may."""
    rng = np.random.default_rng(6)
    depth = np.where(rng.random((60, 70)) < 0.3, 3.0 + rng.integers(0, 2, (60, 70)), 0.0)
    held = rng.choice([s for s in dw.State if s != dw.State.EMPTY], depth.shape)
    return make_map(depth, camera, np.where(depth > 0, held, dw.State.EMPTY))


@pytest.mark.parametrize("kind", ["range", "z"])
@pytest.mark.parametrize("step", FILLS, ids=lambda step: type(step).__name__)
def test_nothing_is_filled_beside_the_image_circle(device, fisheye, step, kind):
    """Every depth has a point; inside the circle nearly every pixel has a depth."""
    filled = dw.filters.apply(circle_map(fisheye, kind), [step], device=device)
    seen = has_ray(fisheye, kind)
    assert 0.1 < seen.mean() < 0.6
    assert (filled.depth[~seen] == 0).all() and (filled.index[~seen] == -1).all()
    assert (filled.state[~seen] == dw.State.EMPTY).all()
    assert (filled.depth[seen] > 0).mean() > 0.97


def test_a_measured_pixel_whose_middle_has_no_ray_stays(device, fisheye):
    """A point may fall on the part of a pixel that the lens sees."""
    depth = np.where(has_ray(fisheye), 3.0, 0.0)
    row, column = np.argwhere(depth == 0)[0]
    depth[row, column] = 3.0
    after = dw.filters.apply(make_map(depth, fisheye), dw.filters.best(), device=device)
    assert after.depth[row, column] == 3.0


@pytest.mark.parametrize("step", FILLS, ids=lambda step: type(step).__name__)
def test_what_a_pixel_without_a_ray_held_stays(device, fisheye, step):
    """Measured, filled before, or erased with its depth kept: fills and dilation leave it."""
    before = mixed_states(fisheye)
    after = dw.filters.apply(before, [step], device=device)
    blind = ~has_ray(fisheye)
    for ours, theirs in zip(arrays_of(after), arrays_of(before), strict=True):
        np.testing.assert_array_equal(ours[blind], theirs[blind])


def test_a_chain_is_its_filters_one_by_one(device, fisheye):
    """Also where pixels without a ray hold a depth: the fill may start from them."""
    before = mixed_states(fisheye)
    chain = dw.filters.best()
    together = dw.filters.apply(before, chain, device=device)
    erased = dw.filters.apply(before, chain[:1], device=device)
    assert_maps(together, arrays_of(dw.filters.apply(erased, chain[1:], device=device)))


def test_in_a_plan_it_is_as_on_the_finished_map(device, fisheye):
    """Views of lenses with and without rays for all pixels, one after the other in one plan."""
    rng = np.random.default_rng(2)
    away = rng.normal(size=(4000, 3))
    away *= 4 / np.linalg.norm(away, axis=1, keepdims=True)
    cloud = dw.PointCloud(away.astype(np.float32))
    whole = dw.FisheyeCamera(60.0, 60.0, 35.0, 30.0, 70, 60, POSE)
    chain = dw.filters.best()
    for cameras in ([whole, fisheye, whole], [fisheye, whole, fisheye]):
        alone = [
            dw.filters.apply(dw.render(cloud, camera, device=device), chain, device=device)
            for camera in cameras
        ]
        target = wp.get_device(device)
        plan = RenderPlan([ViewPlan(cameras[0])], RenderConfig(filters=chain), target)
        drawn = dw.render_batch(cloud, cameras, filters=chain, device=device)
        for camera, expected, in_batch in zip(cameras, alone, drawn, strict=True):
            plan.look_from([ViewPlan(camera)])
            plan.render(device_points(cloud, target))
            for one in (in_batch, plan.depth_maps()[0]):
                np.testing.assert_array_equal(one.depth, expected.depth)
                np.testing.assert_array_equal(one.state, expected.state)
            assert (expected.depth[~has_ray(camera)] == 0).all()


def test_most_lenses_have_a_ray_for_every_pixel():
    """Then nothing is kept; equal lenses at other places are asked once."""
    pinhole = dw.PinholeCamera.from_fov((60, 45), (64, 48))
    assert blind_pixels([pinhole, dw.OrthographicCamera(0.01, 64, 48, POSE)], "range") is None
    asked = _blind_of.cache_info().misses
    elsewhere = dw.Pose.from_orientation((1, 2, 3), (4, 5, 6))
    assert blind_pixels([pinhole, replace(pinhole, pose=elsewhere)], "range") is None
    assert _blind_of.cache_info().misses == asked
