"""The splat for CUDA, on every device: the keys and counts of the splat of single points."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from depthwarp.rendering.cuda_splatting import CudaSplatter
from depthwarp.rendering.points import Points
from depthwarp.rendering.views import DeviceViews
from depthwarp_kernels import splat
from tests.kernels.scenes import CULLED, SCENES, cloud_of, points_world, views_of

SIZES = (0, 1, 511, 513, 5000)
GROUPS = (1, 7, 1000)
"""One that takes all chunks of three views in turn, a few, and more than there are chunks."""


def buffers(views: DeviceViews, device: str) -> tuple[wp.array, wp.array]:
    """Keys and counts with anything in them."""
    width, height = views.size
    keys = wp.full((views.count, width * height), 7, dtype=wp.uint64, device=device)
    return keys, wp.full((views.count, splat.COUNT_COLUMNS), 7, dtype=wp.int64, device=device)


def point_by_point(views: DeviceViews, depth: str, points: Points, device: str):
    """Keys and counts of the kernel that draws each point by itself."""
    keys, counts = buffers(views, device)
    keys.fill_(splat.EMPTY_KEY)
    counts.zero_()
    config = splat.SplatConfig(points.source, views.model, depth, views.has_range_views)
    wp.launch(
        splat.splat_kernel(config),
        dim=(views.count, points.count),
        inputs=[*views.arrays, points.arrays, 0],
        outputs=[keys, counts],
        device=device,
    )
    return keys.numpy(), counts.numpy()


@pytest.mark.parametrize("scene", SCENES)
def test_keys_and_counts_are_those_of_single_points(device, scene):
    """Every lens, all ways to cull, below and above a chunk, however many groups share it."""
    views, config = views_of(scene, device)
    for prepared in (False, True) if scene in (*CULLED, "moving") else (False,):
        keys, counts = buffers(views, device)
        splatters = [CudaSplatter(views, config.depth, keys, counts, n) for n in GROUPS]
        for size in SIZES:
            points = cloud_of(points_world(size), prepared, device)
            expected = point_by_point(views, config.depth, points, device)
            for splatter in splatters:
                splatter.draw(points)
                np.testing.assert_array_equal(keys.numpy(), expected[0])
                np.testing.assert_array_equal(counts.numpy(), expected[1])
        assert (expected[0] != splat.EMPTY_KEY).sum() > 50
        assert expected[1].sum(axis=0)[splat.TOO_FAR] > 0


@pytest.mark.parametrize("places", [1, 4, 25, 1 << 20])
def test_a_list_too_short_for_all_chunks_is_filled_again(device, places):
    """Ten chunks and three views in passes of a chunk, of part of a view, of two views, of all."""
    views, config = views_of("pinhole", device)
    points = cloud_of(points_world(5000), True, device)
    keys, counts = buffers(views, device)
    CudaSplatter(views, config.depth, keys, counts, 5, places).draw(points)
    expected = point_by_point(views, config.depth, points, device)
    np.testing.assert_array_equal(keys.numpy(), expected[0])
    np.testing.assert_array_equal(counts.numpy(), expected[1])


def test_a_plain_cloud_may_start_anywhere(device):
    """An array that begins in the middle of another one: no reads of 16 bytes off their places."""
    views, config = views_of("pinhole", device)
    whole = cloud_of(points_world(1500), False, device).arrays.points_world
    keys, counts = buffers(views, device)
    splatter = CudaSplatter(views, config.depth, keys, counts, 4)
    for first in (1, 2, 3):
        points = cloud_of(whole.numpy()[first:], False, device)
        points.arrays.points_world = whole[first:]
        splatter.draw(points)
        expected = point_by_point(views, config.depth, points, device)
        np.testing.assert_array_equal(keys.numpy(), expected[0])
        np.testing.assert_array_equal(counts.numpy(), expected[1])


@pytest.mark.parametrize("pixels", [1, 31, 128, 129, 1000])
def test_resolved_maps_are_those_of_single_pixels(device, pixels):
    """Depth, index, state and drawn pixels, in images of part of a warp and of several."""
    rng = np.random.default_rng(pixels)
    keys = rng.integers(0, 1 << 63, (3, pixels), np.uint64)
    keys[rng.random(keys.shape) < 0.3] = splat.EMPTY_KEY
    views, config = views_of("pinhole", device)
    on_device = wp.array(keys, dtype=wp.uint64, device=device)
    maps = [
        wp.full((3, pixels), 9, dtype=dtype, device=device)
        for dtype in (wp.float32, wp.int32, wp.uint8)
    ]
    counts = wp.zeros((3, splat.COUNT_COLUMNS), dtype=wp.int64, device=device)
    CudaSplatter(views, config.depth, on_device, counts, 1).resolve(*maps)
    is_empty = keys == splat.EMPTY_KEY
    depth, index, state = (array.numpy() for array in maps)
    depth_bits = np.where(is_empty, 0, keys >> np.uint64(32)).astype(np.uint32)
    np.testing.assert_array_equal(depth.view(np.uint32), depth_bits)
    np.testing.assert_array_equal(index.view(np.uint32), keys.astype(np.uint32))
    np.testing.assert_array_equal(state, ~is_empty)
    np.testing.assert_array_equal(counts.numpy()[:, splat.DRAWN], (~is_empty).sum(axis=1))
    assert counts.numpy().sum() == (~is_empty).sum()


@pytest.mark.parametrize("prepared", [False, True], ids=["plain", "prepared"])
def test_a_captured_draw_follows_what_is_on_the_device(device, prepared):
    """Replayed after the views have changed places: nothing was read on the host, or allocated."""
    views, config = views_of("pinhole", device)
    points = cloud_of(points_world(5000), prepared, device)
    keys, counts = buffers(views, device)
    depth, index, state = (
        wp.zeros(keys.shape, dtype=dtype, device=device)
        for dtype in (wp.float32, wp.int32, wp.uint8)
    )
    splatter = CudaSplatter(views, config.depth, keys, counts, 7, places=16)

    def draw() -> None:
        splatter.draw(points)
        splatter.resolve(depth, index, state)

    draw()
    before = [array.numpy().copy() for array in (keys, counts, depth, index, state)]
    with wp.ScopedCapture(device=device) as capture:
        draw()
    views.arrays[0].assign(views.arrays[0].numpy()[::-1].copy())
    wp.capture_launch(capture.graph)
    for ours, theirs in zip((keys, counts, depth, index, state), before, strict=True):
        np.testing.assert_array_equal(ours.numpy(), theirs[::-1])
    assert np.any(before[0] != before[0][::-1])
