"""Quantized clouds: their maps are those of a plain cloud of the decoded points, bit for bit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.rendering import RenderConfig, RenderPlan, ViewPlan
from depthwarp_kernels.point_source import BLOCK
from tests.cameras.models import cameras_of
from tests.rendering.clumps import assert_same_map, clumps
from tests.rendering.quantizing import BOUNDS, assert_quantized, planes_of, three_kinds
from tests.rendering.test_prepared import cuda_splatter, room

CAMERA = dw.PinholeCamera.from_fov((90, 70), (40, 30), (0.5, 0.2, 0.1), (3, 4, 30))


def assert_maps_of_what_is_drawn(chunks: dw.PreparedCloud, camera: dw.Camera, **options) -> None:
    """A view of the quantized cloud is that of a plain cloud of its decoded points."""
    device = chunks.device.alias
    plain = dw.PointCloud(chunks.points_world())
    expected = dw.render(plain, camera, device=device, **options)
    assert_same_map(dw.render(chunks, camera, device=device, **options), expected)


def test_a_large_block_does_not_spoil_the_others(device):
    """Blocks of 4, 8 and 12 bytes stand side by side in one cloud and are drawn alike."""
    points = three_kinds()
    chunks = assert_quantized(points, 1e-4, device)
    kinds, numbers = np.unique(planes_of(chunks), return_counts=True)
    assert kinds.tolist() == [1, 2, 3] and numbers.min() >= 2
    assert chunks.bytes_per_point == pytest.approx(4 * planes_of(chunks).mean())
    for yaw in (0, 90, 180):
        camera = CAMERA.with_pose(dw.Pose.from_orientation((0.1, 0, 0), (5, -10, yaw)))
        assert_maps_of_what_is_drawn(chunks, camera, max_range=math.inf)
        assert dw.render(chunks, camera, device=device).stats.drawn > 500


@pytest.mark.parametrize("model", ["pinhole", "equirectangular"])
@settings(max_examples=15)
@given(data=st.data())
def test_maps_are_those_of_the_decoded_points(device, model, data):
    """Any pose, lens and bounds; clumps ahead, behind, around, tiny, huge, not finite."""
    camera = data.draw(cameras_of(model))
    points = data.draw(clumps(camera.pose))
    chunks = assert_quantized(points, data.draw(st.sampled_from(BOUNDS)), device)
    far = data.draw(st.sampled_from([15.0, math.inf]))
    assert_maps_of_what_is_drawn(chunks, camera, max_range=far)


@pytest.mark.parametrize("size", [0, 1, 511, 512, 513, 20_000, 70_000])
def test_any_number_of_points(device, size):
    """From none to many, also shared among threads; a last block that is not full is exact."""
    points = room(size)
    chunks = assert_quantized(points, 0.05, device)
    assert_maps_of_what_is_drawn(chunks, CAMERA)
    full, rest = divmod(size, BLOCK)
    rows = chunks.source.original.numpy()[full * BLOCK : size]
    np.testing.assert_array_equal(chunks.points_world()[rows], points[rows])
    assert planes_of(chunks).tolist() == [1] * full + [3] * bool(rest)
    assert chunks.bytes_per_point == pytest.approx(
        (4 * full + 12 * bool(rest)) / max(chunks.blocks, 1)
    )


def test_a_plan_with_the_splat_for_cuda(monkeypatch):
    """Its kernels run on a CPU too, and draw the same map with the same counts."""
    chunks = assert_quantized(three_kinds(), 1e-4)
    expected = dw.render(chunks, CAMERA, device="cpu", max_range=math.inf)
    monkeypatch.setattr(
        "depthwarp.rendering.plan.splatter_of",
        lambda views, config, device, **how: cuda_splatter(views, config),
    )
    assert_same_map(dw.render(chunks, CAMERA, device="cpu", max_range=math.inf), expected)


def test_a_view_on_the_border_of_a_block_loses_no_decoded_point(device):
    """Spheres hold what is drawn: a point is drawn where it moved to, on an image's border.

    Blocks a millimetre wide, moved by up to half of that, 3 m before an image 20 mm wide there.
    """
    rng = np.random.default_rng(3)
    corners = np.repeat(rng.uniform(-1, 1, (40, 3)), BLOCK, axis=0)
    points = (corners + rng.uniform(0, 0.001, (len(corners), 3))).astype(np.float32)
    chunks = assert_quantized(points, 1e-3, device)
    for target in chunks.points_world()[rng.integers(0, len(points), 20)].astype(np.float64):
        pose = dw.Pose.from_orientation(tuple(target + (-3, 0.01, 0.01)), (0, 0, 0))
        camera = dw.PinholeCamera(7500.0, 7500.0, 24.5, 24.5, 50, 50, pose)
        assert_maps_of_what_is_drawn(chunks, camera)


def test_one_renderer_draws_exact_quantized_and_plain_clouds_in_turn(device):
    """What was drawn before leaves no trace, and each kind has kernels of its own."""
    cloud = dw.PointCloud(three_kinds())
    renderer = dw.Renderer([CAMERA], max_points=len(cloud), max_range=math.inf, device=device)
    exact, quantized = cloud.prepare(device=device), cloud.prepare(device=device, max_error=1e-4)
    for chunks in (quantized, exact, quantized):
        renderer.render(chunks)
        plain = dw.PointCloud(chunks.points_world())
        expected = dw.render(plain, CAMERA, max_range=math.inf, device=device)
        assert_same_map(renderer.depth_maps()[0], expected)


@pytest.mark.parametrize("threads", [1, 3])
def test_a_plan_without_an_index_draws_the_same_depths(threads):
    """Keys of 32 bits from packed blocks, more than one thread's share of them."""
    chunks = assert_quantized(room(70_000), 0.05)
    maps = []
    for with_index in (True, False):
        views = [ViewPlan(CAMERA)]
        plan = RenderPlan(
            views, RenderConfig(), chunks.device, with_index=with_index, threads=threads
        )
        plan.render(chunks)
        maps.append(plan.maps.depth.numpy().copy())
    np.testing.assert_array_equal(maps[0].view(np.uint32), maps[1].view(np.uint32))
    assert np.count_nonzero(maps[0]) > 500
