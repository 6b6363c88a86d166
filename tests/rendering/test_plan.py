"""Plans: many views in one launch, and what they leave alone."""

from __future__ import annotations

import numpy as np
import pytest

import depthwarp as dw
from depthwarp import arrays
from depthwarp.devices import resolve_device
from depthwarp.errors import InputError
from depthwarp.rendering import RenderConfig, RenderPlan, ViewPlan


def test_a_plan_of_many_views_is_many_single_ones(device):
    """Views of one size in one launch, drawn twice: each time the maps of `dw.render`."""
    rng = np.random.default_rng(15)
    views = [
        dw.PinholeCamera.from_fov((90, 70), (32, 24), (0.1 * i, 0, 0), (0, 0, 60 * i))
        for i in range(4)
    ]
    config = RenderConfig("z", 0.5, 4.0, dw.filters.paper())
    target = resolve_device(device)
    plan = RenderPlan([ViewPlan(camera) for camera in views], config, target)
    for count in (3000, 100, 0):
        cloud = dw.PointCloud(rng.uniform(-5, 5, (count, 3)).astype(np.float32))
        plan.render(arrays.share_points(cloud.points_world, target))
        for camera, ours in zip(views, plan.depth_maps(), strict=True):
            single = dw.render(
                cloud,
                camera,
                depth="z",
                min_range=0.5,
                max_range=4.0,
                filters=dw.filters.paper(),
                device=device,
            )
            np.testing.assert_array_equal(ours.depth, single.depth)
            np.testing.assert_array_equal(ours.index, single.index)
            np.testing.assert_array_equal(ours.state, single.state)
            assert ours.stats == single.stats and ours.camera == camera


def test_maps_of_a_plan_outlive_the_next_rendering(device):
    """`depth_maps` copies: a later `render` does not change maps that were handed out."""
    target = resolve_device(device)
    camera = dw.PinholeCamera.from_fov((60, 60), (3, 3))
    plan = RenderPlan([ViewPlan(camera)], RenderConfig(), target)
    plan.render(arrays.share_points(np.float32([[2, 0, 0]]), target))
    first = plan.depth_maps()[0]
    plan.render(arrays.share_points(np.float32([[5, 0, 0]]), target))
    assert first.depth[1, 1] == 2 and plan.depth_maps()[0].depth[1, 1] == 5


def test_views_that_do_not_go_together_are_refused(device):
    """A plan holds views of one size, all with or all without segmentation, and at least one."""
    target = resolve_device(device)
    small, large = (dw.PinholeCamera.from_fov((60, 60), (side, side)) for side in (3, 4))
    segmented = ViewPlan(small, 10, (0.1, 0.1, 0.1))
    for views in ([], [ViewPlan(small), ViewPlan(large)], [ViewPlan(small), segmented]):
        with pytest.raises(InputError, match="^views"):
            RenderPlan(views, RenderConfig(), target)


def test_rendering_leaves_the_cloud_alone(device):
    """The points are read where they lie (no copy on a CPU), and not written."""
    points = np.random.default_rng(16).uniform(-5, 5, (1000, 3)).astype(np.float32)
    cloud = dw.PointCloud(points.copy())
    camera = dw.PinholeCamera.from_fov((90, 90), (20, 20))
    dw.render(cloud, camera, filters=dw.filters.paper(), device=device)
    np.testing.assert_array_equal(cloud.points_world, points)
