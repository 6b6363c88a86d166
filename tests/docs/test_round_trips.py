"""The sentences of `docs/conventions.md` under "Round trips"."""

from __future__ import annotations

import numpy as np

import depthwarp as dw
from tests.docs.sentences import (
    DISTORTION,
    ORIGIN,
    PANORAMAS,
    looking,
    says,
)


@says("`camera.project` and `camera.unproject` are each other's inverse.")
def test_inverse():
    """Pixel centres of a distorted lens, at 2 m."""
    camera = dw.PinholeCamera(50.0, 51.0, 32.0, 24.0, 64, 48, ORIGIN, DISTORTION)
    points = camera.unproject(np.full((48, 64), 2.0))
    u, v, depth, valid = camera.project(points.reshape(-1, 3))
    rows, columns = np.indices((48, 64))
    np.testing.assert_allclose(u, columns.ravel(), atol=1e-8)
    np.testing.assert_allclose(v, rows.ravel(), atol=1e-8)
    np.testing.assert_allclose(depth, 2.0)
    assert valid.all()


@says(
    "A depth map that is unprojected and rendered again gives the same pixels and the same depth."
)
def test_render_again():
    """The same but for the rounding of the points to float32."""
    points = np.random.default_rng(0).uniform(-4, 4, (2000, 3)).astype(np.float32)
    for camera in (looking(3, 4, 5), PANORAMAS[0], PANORAMAS[1]):
        first = dw.render(dw.PointCloud(points), camera, device="cpu")
        second = dw.render(first.unproject(), camera, device="cpu")
        np.testing.assert_array_equal(second.state, first.state)
        np.testing.assert_allclose(second.depth, first.depth, rtol=1e-6)


@says("All devices give the same bits.")
def test_same_bits(device):
    """A fisheye, whose angles libraries round in their own ways, here and on the CPU."""
    points = np.random.default_rng(1).uniform(-4, 4, (2000, 3)).astype(np.float32)
    camera = dw.FisheyeCamera(20.0, 20.0, 31.5, 31.5, 64, 64, ORIGIN, (0.01, 0.0, 0.0, 0.0))
    here = dw.render(dw.PointCloud(points), camera, device=device)
    there = dw.render(dw.PointCloud(points), camera, device="cpu")
    assert here.depth.tobytes() == there.depth.tobytes()
    assert here.index.tobytes() == there.index.tobytes()
