"""Rendering: the kernels against the paper's loop Z-buffer, pixel by pixel and bit by bit."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import depthwarp as dw
from tests.rendering.strategies import (
    cameras,
    clouds,
    seeds,
)
from tests.rendering.twin import (
    IDENTITY,
    KINDS,
    assert_consistent,
    assert_is_twin,
    bounds,
    camera_points,
    render,
    selected_by,
    small_range_views,
    twin,
)


@given(data=st.data(), kind=st.sampled_from(KINDS))
def test_a_pinhole_renders_as_the_loop(device, data, kind):
    """Any pose, lens, size, cloud and bounds: depth bits, winners and counts are the loop's."""
    camera = data.draw(cameras())
    points = data.draw(clouds(camera.pose))
    options = data.draw(bounds(points, camera.pose, kind))
    depth_map = render(points, camera, options, device)
    assert_is_twin(depth_map, twin(points, camera, **options))
    assert depth_map.camera == camera and depth_map.kind == kind
    assert (depth_map.min_range, depth_map.max_range) == (
        options["min_range"],
        options["max_range"],
    )


@given(data=st.data(), kind=st.sampled_from(KINDS))
def test_a_range_view_renders_as_the_loop_over_the_selected(device, data, kind):
    """The paper's process: the union selects, the selected points are projected and compared."""
    view, points, line_count = data.draw(small_range_views(clouds))
    options = data.draw(bounds(points, view.pose, kind))
    depth_map = render(points, view, options, device)
    camera = view.camera(dw.PointCloud(points), device=device)
    assert depth_map.camera == camera
    selected = selected_by(view, line_count, camera_points(view.pose, points))
    assert_is_twin(depth_map, twin(points, camera, selected, **options))


@given(data=st.data(), kind=st.sampled_from(KINDS))
def test_a_camera_of_a_matrix_renders_as_the_loop(device, data, kind):
    """K with fx != fy and a principal point anywhere, extrinsics of OpenCV."""
    other = data.draw(cameras(max_side=8))
    numbers = st.floats(0.5, 40)
    K = np.diag([data.draw(numbers), data.draw(numbers), 1.0])
    K[:2, 2] = data.draw(st.floats(-5, 15)), data.draw(st.floats(-5, 15))
    camera = dw.PinholeCamera.from_matrix(
        K, other.size, optical_from_world=other.pose.optical_from_world
    )
    points = data.draw(clouds(camera.pose))
    options = data.draw(bounds(points, camera.pose, kind))
    assert_is_twin(render(points, camera, options, device), twin(points, camera, **options))


@given(seed=seeds, kind=st.sampled_from(KINDS), size=st.tuples(*[st.integers(1, 9)] * 2))
def test_points_on_pixel_borders(device, seed, kind, size):
    """u and v exactly on k - 0.5, and on the floats beside it: left and upper border belong."""
    camera = dw.PinholeCamera(4.0, 8.0, (size[0] - 1) / 2, (size[1] - 1) / 2, *size, IDENTITY)
    rng = np.random.default_rng(seed)
    X = rng.choice(np.float32([0.5, 1, 2, 4]), 200)
    u = rng.integers(-1, size[0] + 2, 200) - 0.5
    v = rng.integers(-1, size[1] + 2, 200) - 0.5
    points = np.stack([X, (camera.cx - u) * X / 4, (camera.cy - v) * X / 8], axis=1)
    points = points.astype(np.float32)
    way = rng.choice(np.float32([-np.inf, np.nan, np.inf]), points.shape)
    points = np.where(np.isnan(way), points, np.nextafter(points, way))
    options = {"depth_kind": kind, "min_range": 0.0, "max_range": 15.0}
    assert_is_twin(render(points, camera, options, device), twin(points, camera, **options))


def test_the_left_and_upper_border_belong_to_the_image(device):
    """u = -0.5 is column 0, u = W - 0.5 is outside; rows likewise."""
    camera = dw.PinholeCamera(1.0, 1.0, 1.0, 1.0, 3, 3, IDENTITY)  # u = 1 - Y / X
    points = np.float32([[1, 1.5, 0], [1, -1.5, 0], [1, 0, 1.5], [1, 0, -1.5], [1, 0.5, 0.5]])
    depth_map = dw.render(dw.PointCloud(points), camera, device=device)
    assert depth_map.index.tolist() == [[-1, 2, -1], [0, 4, -1], [-1, -1, -1]]
    assert depth_map.stats.outside == 2


@pytest.mark.parametrize("kind", KINDS)
def test_bounds_are_inclusive(device, kind):
    """A depth of exactly min_range or max_range is drawn, the floats beyond are not."""
    far, near = np.float32(9.7), np.float32(0.3)
    beyond, before = np.nextafter(far, np.float32(10)), np.nextafter(near, np.float32(0))
    camera = dw.PinholeCamera(1.0, 1.0, 0.0, 0.0, 1, 1, IDENTITY)
    for x, reason in [(far, "drawn"), (near, "drawn"), (beyond, "too_far"), (before, "too_near")]:
        cloud = dw.PointCloud(np.float32([[x, 0, 0]]))
        depth_map = dw.render(
            cloud, camera, depth=kind, min_range=float(near), max_range=float(far), device=device
        )
        assert depth_map.stats[reason] == 1
        assert depth_map.depth[0, 0] == (x if reason == "drawn" else 0)


@pytest.mark.parametrize("kind", KINDS)
def test_every_reason_by_hand(device, kind):
    """Each point counts once, under the first reason that applies."""
    camera = dw.PinholeCamera(1.0, 1.0, 1.0, 1.0, 3, 3, IDENTITY)
    points = [
        (math.nan, 0, 0),
        (1, 0, -math.inf),
        (-math.inf, 0, 0),
        (0, 0, 0),
        (-0.0, 1, 1),
        (-99, 0, 0),
        (1, 2, 0),
        (99, 990, 0),
        (16, 0, 0),
        (0.25, 0, 0),
        (15, 0, 0),
        (0.5, 0, 0),
    ]
    depth_map = dw.render(
        dw.PointCloud(np.float32(points)), camera, depth=kind, min_range=0.5, device=device
    )
    assert dict(depth_map.stats) == {
        "total": 12,
        "not_finite": 3,
        "behind": 3,
        "outside": 2,
        "too_far": 1,
        "too_near": 1,
        "hidden": 1,
        "drawn": 1,
    }
    assert depth_map.index[1, 1] == 11 and depth_map.depth[1, 1] == 0.5
    assert_consistent(depth_map)


def test_range_and_z_differ_as_named(device):
    """A point at (2, 2, 1): 3 m away, 2 m along the axis; the kind decides the winner too."""
    camera = dw.PinholeCamera(1.0, 1.0, 5.0, 5.0, 11, 11, IDENTITY)
    cloud = dw.PointCloud(np.float32([[2, 2, 1], [2.5, 0, 0], [2.4, 1.0, 0]]))
    by_range = dw.render(cloud, camera, device=device)
    by_z = dw.render(cloud, camera, depth="z", device=device)
    assert by_range.kind == "range" and by_z.kind == "z"
    assert by_range.depth[by_range.index == 0] == 3
    assert by_z.depth[by_z.index == 0] == 2
    assert by_range.index[5, 5] == 1 and by_z.index[5, 5] == 2
