"""Rendering at the edges: few points, ties, underflow, overflow."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import depthwarp as dw
from tests.reference import zbuffer
from tests.rendering.strategies import (
    cameras,
    clouds,
    seeds,
)
from tests.rendering.twin import (
    KINDS,
    assert_consistent,
    camera_points,
    render,
)


@pytest.mark.parametrize("kind", KINDS)
def test_no_points_give_an_empty_map(device, kind):
    """Zero points: nothing drawn, every count zero."""
    camera = dw.PinholeCamera.from_fov((60, 45), (5, 4))
    cloud = dw.PointCloud(np.empty((0, 3), np.float32))
    depth_map = dw.render(cloud, camera, depth=kind, device=device)
    assert not depth_map.depth.any() and not any(depth_map.stats.values())
    assert_consistent(depth_map)


def test_one_point(device):
    """A cloud of one point: one pixel, through a camera and through a range view."""
    cloud = dw.PointCloud(np.float32([[1.79, 5.3, 1.2]]))
    pose = {"position": (1.79, 3.3, 1.2), "orientation": (0, 0, 90)}
    camera = dw.PinholeCamera.from_fov((60, 45), (7, 5), **pose)
    depth_map = dw.render(cloud, camera, device=device)
    assert depth_map.depth[2, 3] == pytest.approx(2.0) and depth_map.stats.drawn == 1
    view = dw.RangeView(**pose, fov=(60, 60), q_depth_map=0.1)
    depth_map = dw.render(cloud, view, device=device)
    assert depth_map.stats.drawn == 1 and depth_map.depth.max() == pytest.approx(2.0)


def test_points_at_the_camera(device):
    """At the centre a point is not ahead; so near that its range underflows, it is too near."""
    camera = dw.PinholeCamera.from_fov((60, 45), (3, 3))
    cloud = dw.PointCloud(np.float32([[0, 0, 0], [1e-30, 0, 0], [1e-40, 0, 0]]))
    depth_map = dw.render(cloud, camera, device=device)
    assert (depth_map.stats.behind, depth_map.stats.too_near) == (1, 2)
    assert not depth_map.depth.any()
    by_z = dw.render(cloud, camera, depth="z", device=device)
    assert by_z.stats.drawn == 1 and by_z.depth[1, 1] == np.float32(1e-40)


def test_a_range_that_overflows_is_too_far(device):
    """Without a bound, a point whose squares overflow float32 is counted, not drawn as infinite."""
    camera = dw.PinholeCamera.from_fov((60, 45), (3, 3))
    cloud = dw.PointCloud(np.float32([[1e30, 0, 0], [1e18, 0, 0]]))
    depth_map = dw.render(cloud, camera, max_range=math.inf, device=device)
    assert (depth_map.stats.too_far, depth_map.stats.drawn) == (1, 1)
    assert depth_map.depth[1, 1] == np.float32(1e18)
    assert depth_map.max_range == math.inf


@pytest.mark.parametrize("orientation", [(0, 0, 45), (45, 0, 0), (-45, 0, 0)])
@pytest.mark.parametrize("range_view", [False, True])
def test_a_coordinate_that_overflows_when_turned_is_not_finite(device, orientation, range_view):
    """Two coordinates of 3e38 add up to more than float32 holds, in X, Y or Z alone."""
    points = np.float32([[3e38, 3e38, 1] if orientation[2] else [1, 3e38, 3e38], [5, 1, 0]])
    xyz = np.stack(camera_points(dw.Pose.from_orientation((0, 0, 0), orientation), points))
    assert np.isinf(xyz[:, 0]).sum() == 1
    if range_view:
        camera = dw.RangeView((0, 0, 0), orientation, (170, 170), 0.1, 1.0, depth_plane=5.0)
    else:
        camera = dw.PinholeCamera.from_fov((170, 170), (3, 3), (0, 0, 0), orientation)
    stats = dw.render(dw.PointCloud(points), camera, max_range=math.inf, device=device).stats
    assert (stats.not_finite, stats.drawn) == (1, 1)


@given(seed=seeds, count=st.integers(2, 300))
def test_the_lowest_index_wins_a_tie(device, seed, count):
    """Copies of a few points, and mirror images of one range: the first of each pixel is kept."""
    rng = np.random.default_rng(seed)
    base = rng.uniform((1, -1, -1), (2, 1, 1), (3, 3)).astype(np.float32)
    points = base[rng.integers(0, 3, count)] * rng.choice(np.float32([-1, 1]), (count, 3))
    points[:, 0] = np.abs(points[:, 0])
    camera = dw.PinholeCamera.from_fov((100, 100), (2, 2))
    depth_map = dw.render(dw.PointCloud(points), camera, device=device)
    u, v, _, valid = camera.project(points)
    pixel = np.floor(v + 0.5) * 2 + np.floor(u + 0.5)
    distance = zbuffer.depth_range(*points.T, np.float32)
    for row in range(2):
        for column in range(2):
            here = np.flatnonzero(valid & (pixel == row * 2 + column))
            first = here[distance[here] == distance[here].min()][0] if len(here) else -1
            assert depth_map.index[row, column] == first


@given(data=st.data(), seed=seeds, kind=st.sampled_from(KINDS))
def test_shuffling_the_cloud_changes_no_depth(device, data, seed, kind):
    """The same depth bits and counts; the winner is the same point, or ties with it."""
    camera = data.draw(cameras(max_side=8))
    points = data.draw(clouds(camera.pose, max_size=400))
    options = {"depth_kind": kind, "min_range": 0.0, "max_range": 15.0}
    order = np.random.default_rng(seed).permutation(len(points))
    one = render(points, camera, options, device)
    other = render(points[order], camera, options, device)
    np.testing.assert_array_equal(one.depth.view(np.uint32), other.depth.view(np.uint32))
    np.testing.assert_array_equal(one.state, other.state)
    assert one.stats == other.stats

    depths = zbuffer.DEPTH_KINDS[kind](*camera_points(camera.pose, points), np.float32)
    place = np.argsort(order)  # of an original point in the shuffled cloud
    for ours, shuffled in zip(one.index[one.index >= 0], other.index[one.index >= 0], strict=True):
        theirs = order[shuffled]
        if theirs != ours:  # a tie: each took the first in its own order
            assert depths[theirs] == depths[ours]
            assert ours < theirs and shuffled < place[ours]


def test_shuffling_a_cloud_without_ties_maps_the_winners_back(device):
    """20,000 points of different range: the index map goes through the permutation."""
    rng = np.random.default_rng(11)
    points = rng.uniform(-5, 5, (20_000, 3)).astype(np.float32)
    camera = dw.PinholeCamera.from_fov((90, 70), (60, 40))
    order = rng.permutation(len(points))
    one = dw.render(dw.PointCloud(points), camera, device=device)
    other = dw.render(dw.PointCloud(points[order]), camera, device=device)
    drawn = one.index >= 0
    assert drawn.sum() > 1000
    np.testing.assert_array_equal(one.index[drawn], order[other.index[drawn]])
