"""`unproject`, the inverse of `project`, for every camera model."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.errors import InputError
from tests.cameras.models import IDENTITY, MODELS, cameras_of
from tests.rendering.strategies import clouds, seeds

ULPS = 16
"""Bound on the depth of a map that was unprojected and rendered again, in units of 2^-23."""


@pytest.mark.parametrize("model", MODELS)
@settings(max_examples=25)
@given(data=st.data(), seed=seeds)
def test_project_inverts_unproject(model, data, seed):
    """The points of an image of random depths are drawn in their own pixels' middles."""
    camera = data.draw(cameras_of(model))
    shape = camera.height, camera.width
    for kind in camera.depth_kinds:
        depth = np.random.default_rng(seed).uniform(1.5, 30, shape)
        points = camera.unproject(depth, kind)
        assert points.shape == (*shape, 3) and points.dtype == np.float64
        seen = np.isfinite(points[..., 0])
        if kind == "z":  # rays that are not ahead have no z depth
            v, u = np.indices(shape, dtype=np.float64)
            ahead = camera.directions(u, v)[..., 0] > 1e-6
            seen &= ahead
        v, u = np.nonzero(seen)
        if model == "moving":  # what a moving sensor sees at the seam, it may see twice
            inner = (u > 0.05 * camera.width) & (u < 0.95 * camera.width - 1)
            u, v = u[inner], v[inner]
        again_u, again_v, again_depth, _ = camera.project(points[v, u], kind)
        drawn = np.isfinite(again_u)
        assert (~drawn).sum() <= 4  # rays on the very edge of a domain
        np.testing.assert_allclose(
            again_u[drawn], u[drawn], atol=1e-3 if model == "moving" else 1e-5
        )
        np.testing.assert_allclose(again_v[drawn], v[drawn], atol=1e-5)
        np.testing.assert_allclose(
            again_depth[drawn], depth[v, u][drawn], rtol=1e-5 if model == "moving" else 1e-9
        )


@pytest.mark.parametrize("model", MODELS)
@settings(max_examples=15)
@given(data=st.data())
def test_a_rendered_map_comes_back(device, model, data):
    """render, unproject, render again: the same pixels, the same state, depth to a few ulp."""
    camera = data.draw(cameras_of(model))
    points = data.draw(clouds(camera.pose, min_size=50))
    first = dw.render(dw.PointCloud(points), camera, device=device, max_range=60)
    kept = np.where(first.depth > 0.5, first.depth, 0)
    if model == "moving":
        kept = np.where(kept > 1.5, kept, 0)
        kept[:, : camera.width // 10 + 1] = kept[:, -camera.width // 10 - 1 :] = 0
    seen = np.isfinite(camera.unproject(kept)[..., 0])
    first = dataclasses.replace(first, depth=np.where(seen, kept, 0).astype(np.float32))
    cloud = first.unproject()
    again = dw.render(cloud, camera, device=device, max_range=61)
    np.testing.assert_array_equal(again.depth > 0, first.depth > 0)
    extent = np.abs(cloud.points_world).max(initial=0) + 10
    np.testing.assert_allclose(
        again.depth, first.depth, rtol=0, atol=ULPS * 2.0**-23 * extent, err_msg=model
    )
    assert again.stats.hidden == 0


def test_unproject_keeps_what_a_pixel_says():
    """The cloud of a map: one point a pixel, row by row, with its pixel, index and state."""
    points = np.float32([[2, 0.5, 0], [2, -0.5, 0], [3, 0, 0.7], [5, 0.5, 0]])
    camera = dw.PinholeCamera.from_fov((90, 90), (16, 16))
    depth_map = dw.render(dw.PointCloud(points), camera, device="cpu")
    cloud = depth_map.unproject()
    rows, columns = np.nonzero(depth_map.depth)
    assert len(cloud) == len(rows) == depth_map.stats.drawn
    assert list(cloud.attributes) == ["column", "row", "index", "state"]
    np.testing.assert_array_equal(cloud.attributes["column"], columns)
    np.testing.assert_array_equal(cloud.attributes["row"], rows)
    np.testing.assert_array_equal(cloud.attributes["index"], depth_map.index[rows, columns])
    assert (cloud.attributes["state"] == dw.State.MEASURED).all()
    exact = camera.unproject(depth_map)[rows, columns]
    np.testing.assert_allclose(cloud.points_world, exact, rtol=1e-6, atol=1e-6)


def test_a_map_knows_its_kind():
    """An array's kind is said, a map's is its own."""
    camera = dw.PinholeCamera.from_fov((90, 90), (5, 5))
    depth = np.full((5, 5), 2.0)
    along = camera.unproject(depth, "z")
    np.testing.assert_allclose(along[..., 0], 2)
    np.testing.assert_allclose(np.linalg.norm(camera.unproject(depth), axis=-1), 2)
    cloud = dw.PointCloud(np.float32([[2, 0.9, 0.9]]))
    by_z = dw.render(cloud, camera, depth="z", device="cpu")
    point = camera.unproject(by_z)[by_z.depth > 0][0]
    assert point[0] == pytest.approx(2)


@pytest.mark.parametrize("model", ["pinhole", "equirectangular"])
def test_empty_pixels_have_no_point(model):
    """0, negative, NaN and infinite depths give NaN, without a warning."""
    camera = MODELS[model](np.random.default_rng(1), IDENTITY, 24)
    assert camera.width * camera.height > 4
    depth = np.full((camera.height, camera.width), np.nan)
    depth.flat[:4] = 0, -1, np.inf, 2
    points = camera.unproject(depth)
    assert np.isfinite(points).all(axis=-1).sum() == 1


def test_another_shape_is_refused():
    """(height, width), both in the message."""
    camera = dw.PinholeCamera.from_fov((90, 90), (5, 4))
    with pytest.raises(InputError, match=r"\(4, 5\).*\(5, 4\)"):
        camera.unproject(np.ones((5, 4)))
