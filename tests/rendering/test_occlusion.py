"""Occlusion culling: blocks behind what is drawn are left out, and no bit of the maps changes."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

import depthwarp as dw
from depthwarp.rendering import RenderConfig, RenderPlan, ViewPlan, occlusion
from depthwarp_kernels.lens_pinhole import PinholeLens, bounds_pinhole
from depthwarp_kernels.options import EXACT
from tests.cameras.models import IDENTITY
from tests.rendering.clumps import assert_same_map

wp.set_module_options(EXACT)

CPU = wp.get_device("cpu")


def walls(count: int, seed: int = 0) -> np.ndarray:
    """Points on five walls one behind the other, those behind wider; some not finite."""
    rng = np.random.default_rng(seed)
    x = rng.choice([2.0, 3.0, 4.0, 6.0, 9.0], count)
    points = np.column_stack([x, *(rng.uniform(-1, 1, (2, count)) * 0.8 * x)])
    points += rng.normal(0, 0.003, points.shape)
    points[rng.random(count) < 0.01, 2] = np.nan
    return points.astype(np.float32)


@pytest.fixture
def drawn(monkeypatch) -> list[int]:
    """Lengths of the lists that were drawn, with their sum before anything was left out."""
    lengths: list[int] = []
    rounds = occlusion.Occlusion.rounds

    def counted(self, source, view, keys, seen, count):
        lengths.append(-count)
        for left, length in rounds(self, source, view, keys, seen, count):
            lengths.append(length)
            yield left, length

    monkeypatch.setattr(occlusion.Occlusion, "rounds", counted)
    return lengths


@pytest.mark.parametrize("kind", ["range", "z"])
@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("max_error", [None, 0.001])
def test_what_is_hidden_is_left_out_and_changes_nothing(drawn, kind, threads, max_error):
    """Five dense walls, looked at straight and aslant: the maps and counts of every point."""
    chunks = dw.PointCloud(walls(300_000)).prepare(device="cpu", max_error=max_error)
    plain = dw.PointCloud(chunks.points_world())
    for orientation in ((0, 0, 0), (3, 5, 12)):
        camera = dw.PinholeCamera.from_fov((60, 50), (48, 40), orientation=orientation)
        config = RenderConfig(kind, 0.5, 20.0)
        plan = RenderPlan([ViewPlan(camera)], config, CPU, threads=threads)
        plan.render(chunks)
        options = {"depth": kind, "min_range": 0.5, "max_range": 20.0, "device": "cpu"}
        assert_same_map(plan.depth_maps()[0], dw.render(plain, camera, **options))
    assert len(drawn) == 8  # three rounds a view
    assert sum(drawn) < 0.05 * sum(length for length in drawn if length < 0)


def test_depths_alone_hide_too(drawn):
    """Keys without an index: the same depth map."""
    chunks = dw.PointCloud(walls(300_000)).prepare(device="cpu")
    views = [ViewPlan(dw.PinholeCamera.from_fov((60, 50), (48, 40)))] * 3
    maps = []
    for with_index in (True, False):
        plan = RenderPlan(views, RenderConfig(), CPU, with_index=with_index, threads=2)
        plan.render(chunks)
        maps.append((plan.maps.depth.numpy(), plan.stats()))
    np.testing.assert_array_equal(maps[0][0], maps[1][0])
    assert maps[0][1] == maps[1][1]
    assert sum(drawn) < 0.05 * sum(length for length in drawn if length < 0)


def test_holes_show_what_is_behind(drawn):
    """A pixel that the near wall leaves empty keeps all blocks behind its tile."""
    points = walls(300_000)
    direction = points[:, 1:] / points[:, :1]
    hole = (np.abs(direction) < 0.05).all(axis=1) & (points[:, 0] < 8)
    cloud = dw.PointCloud(points[~hole])
    camera = dw.PinholeCamera.from_fov((60, 50), (48, 40))
    ours = dw.render(cloud.prepare(device="cpu"), camera, device="cpu")
    assert_same_map(ours, dw.render(cloud, camera, device="cpu"))
    assert 8.5 < ours.depth[20, 24] < 9.5


@pytest.mark.parametrize("threads", [1, 2])
def test_a_cloud_of_few_points_is_drawn_at_once(drawn, threads):
    """Less than `DENSE` points a pixel: nobody asks what is hidden."""
    chunks = dw.PointCloud(walls(300_000)).prepare(device="cpu")
    camera = dw.PinholeCamera.from_fov((60, 50), (480, 400))
    plan = RenderPlan([ViewPlan(camera)], RenderConfig(), CPU, threads=threads)
    plan.render(chunks)
    assert drawn == [] and plan.stats()[0].drawn > 10_000


@pytest.mark.parametrize("threads", [1, 2])
def test_a_view_of_few_points_is_drawn_at_once(drawn, threads):
    """A dense cloud, of which a camera sees the least part: one list, all of it."""
    chunks = dw.PointCloud(walls(300_000)).prepare(device="cpu")
    camera = dw.PinholeCamera.from_fov((60, 50), (90, 75), orientation=(0, 0, 60))
    plan = RenderPlan([ViewPlan(camera)], RenderConfig(), CPU, threads=threads)
    plan.render(chunks)
    assert len(drawn) == 2 and sum(drawn) == 0 and plan.stats()[0].drawn > 100
    plain = dw.PointCloud(chunks.points_world())
    assert_same_map(plan.depth_maps()[0], dw.render(plain, camera, device="cpu"))


@wp.kernel
def bounds_of_spheres(
    # In:
    lenses: wp.array[PinholeLens],
    spheres: wp.array[wp.vec4f],
    # Out:
    bounds_out: wp.array[wp.vec4f],
):
    i = wp.tid()
    sphere = spheres[i]
    center = wp.vec3f(sphere[0], sphere[1], sphere[2])
    bounds_out[i] = bounds_pinhole(lenses[0], center, sphere[3])


def test_bounds_hold_every_point_of_a_sphere():
    """Brute force: directions all over spheres, and none of the bounds is far too wide."""
    rng = np.random.default_rng(5)
    camera = dw.PinholeCamera(300.0, 280.0, 319.5, 239.5, 640, 480, IDENTITY)
    centers = np.column_stack([rng.uniform(1, 9, 500), rng.uniform(-6, 6, (500, 2))])
    radii = centers[:, 0] / rng.uniform(1.5, 50, 500)
    lens = wp.array([camera.device_lens().numbers], dtype=PinholeLens, device=CPU)
    spheres = np.column_stack([centers, radii]).astype(np.float32)
    bounds = wp.empty(500, dtype=wp.vec4f, device=CPU)
    wp.launch(
        bounds_of_spheres,
        500,
        inputs=[lens, wp.array(spheres, dtype=wp.vec4f, device=CPU)],
        outputs=[bounds],
        device=CPU,
    )
    ways = rng.normal(size=(4000, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    for (*center, radius), (low_u, low_v, high_u, high_v) in zip(
        spheres.astype(float), bounds.numpy(), strict=True
    ):
        u, v = camera.image_of(np.array(center) + radius * ways)
        assert low_u - 0.1 <= u.min() and u.max() <= high_u + 0.1
        assert low_v - 0.1 <= v.min() and v.max() <= high_v + 0.1
        assert high_u - low_u < 1.15 * (u.max() - u.min()) + 0.1
        assert high_v - low_v < 1.15 * (v.max() - v.min()) + 0.1
