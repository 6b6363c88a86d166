"""Rendering: the kernels against the paper's loop Z-buffer, pixel by pixel and bit by bit."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp import arrays
from depthwarp.devices import free_memory, resolve_device
from depthwarp.errors import CapacityError, DeviceError, InputError
from depthwarp.rendering import RenderConfig, RenderPlan, ViewPlan
from depthwarp.rendering.plan import MAP_BYTES
from depthwarp.rendering.splatting import buffer_count
from tests.reference import projection, rotation, segmentation, zbuffer
from tests.rendering.strategies import (
    ahead_of,
    cameras,
    clouds,
    orientations,
    positions,
    range_views,
    seeds,
)

KINDS = ["range", "z"]
FLOAT32_MAX = float(np.finfo(np.float32).max)
IDENTITY = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))


# --- the twin ---


def camera_points(pose: dw.Pose, points: np.ndarray):
    """X, Y, Z in float32, as the kernel computes them."""
    return rotation.to_camera(points, pose.rotation, pose.position, pose.shift, np.float32)


def selected_by(view: dw.RangeView, line_count: int, xyz) -> np.ndarray:
    """The literal union (8)(9) in float32."""
    return segmentation.segment_union(
        *xyz, segmentation.rectangles(line_count, view.steps, np.float32)
    )


def twin(points: np.ndarray, camera: dw.PinholeCamera, selected=None, **options):
    """Depth, winner and counts of the loop, with the pinhole in float32."""
    xyz = camera_points(camera.pose, points)
    u, v = projection.project_pinhole(*xyz, camera.fx, camera.fy, camera.cx, camera.cy, np.float32)
    column, row = projection.pixel(u, v)
    options["max_range"] = min(options["max_range"], FLOAT32_MAX)  # no bound: still no infinities
    return zbuffer.render_loop(
        *xyz,
        column,
        row,
        width=camera.width,
        height=camera.height,
        selected=selected,
        **options,
    )


def assert_is_twin(depth_map: dw.DepthMap, expected) -> None:
    """The same bits of depth, the same winners, the same counts; a state that agrees with them."""
    depth, index, counts = expected
    np.testing.assert_array_equal(depth_map.depth.view(np.uint32), depth.view(np.uint32))
    np.testing.assert_array_equal(depth_map.index, index)
    assert dict(depth_map.stats) == counts
    assert_consistent(depth_map)


def assert_consistent(depth_map: dw.DepthMap) -> None:
    """What every map without filters obeys."""
    size = depth_map.camera.height, depth_map.camera.width
    assert depth_map.depth.shape == depth_map.index.shape == depth_map.state.shape == size
    assert depth_map.depth.dtype == np.float32
    assert depth_map.index.dtype == np.int32
    assert depth_map.state.dtype == np.uint8
    drawn = depth_map.state == dw.State.MEASURED
    np.testing.assert_array_equal(depth_map.depth > 0, drawn)
    np.testing.assert_array_equal(depth_map.index >= 0, drawn)
    np.testing.assert_array_equal(depth_map.index[~drawn], -1)
    assert (depth_map.state[~drawn] == dw.State.EMPTY).all()
    assert np.isfinite(depth_map.depth).all()
    assert len(np.unique(depth_map.index[drawn])) == drawn.sum() == depth_map.stats.drawn
    stats = dict(depth_map.stats)
    assert sum(stats.values()) == 2 * stats["total"] and min(stats.values()) >= 0


@st.composite
def bounds(draw: st.DrawFn, points: np.ndarray, pose: dw.Pose, kind: str) -> dict[str, float]:
    """Depth kind and range bounds; often the exact depth of a point, or the float beside it."""
    depths = zbuffer.DEPTH_KINDS[kind](*camera_points(pose, points), np.float32)
    depths = depths[np.isfinite(depths) & (depths > 0)].tolist()
    far = draw(st.sampled_from([15.0, math.inf, 0.1, *depths[:20]]))
    near = draw(st.sampled_from([0.0, 0.0, 0.1, *depths[-20:]]))
    if draw(st.booleans()):
        near = float(np.nextafter(np.float32(near), np.float32(1e9)))
    options = {"depth_kind": kind, "min_range": near, "max_range": far}
    assume(near < far)
    return options


def render(points: np.ndarray, camera, options: dict, device: str) -> dw.DepthMap:
    """`dw.render` with the options of the loop."""
    return dw.render(
        dw.PointCloud(points),
        camera,
        depth=options["depth_kind"],
        min_range=options["min_range"],
        max_range=options["max_range"],
        device=device,
    )


@st.composite
def small_range_views(draw: st.DrawFn, points_of) -> tuple[dw.RangeView, np.ndarray, int]:
    """A range view with a map of at most 24 pixels a side, a cloud, and the number N_L."""
    view = draw(range_views(depth_plane=True))
    points = draw(points_of(view.pose))
    if draw(st.booleans()):
        view = dataclasses.replace(view, depth_plane=None)
        farthest = segmentation.max_x_ahead(*camera_points(view.pose, points))
        assume(farthest > 0)
        line_count = segmentation.line_count(farthest, view.steps[0])
        assume(line_count < 4000)  # the loop over rectangles is slow
    else:
        line_count = segmentation.line_count(view.depth_plane, view.steps[0])
    _, half_width, half_height = segmentation.depth_plane(line_count, view.steps)
    side = draw(st.integers(1, 24))
    q_depth_map = 2 * max(half_width, half_height) / side
    return dataclasses.replace(view, q_depth_map=q_depth_map), points, line_count


# --- kernel == loop ---


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


# --- edges: few points, ties, underflow, overflow ---


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


# --- against other arithmetic ---


def float32_pixel_error(width: int, height: int) -> float:
    """Bound [px] of u and v computed in float32 from float32 X, Y, Z, near or in the image.

    With e = 2^-24: rounding f, the quotient and the product costs 3 e |u - cx|, the difference
    e |u|, and u + 0.5 another e |u + 0.5|; with |u - cx| <= W / 2 + 1 and |u| <= W + 1 that is
    below (4 W + 8) e.
    """
    return (4 * max(width, height) + 8) * 2.0**-24


def trigonometric_twin(points, view, camera, line_count, options):
    """The loop with Figure 10's angles in float64, and the pixels that lie at a border.

    Returns:
        The loop's result; and, as a mask of the image, the pixels for which some selected point is
        within `float32_pixel_error` of a border of the pixel, inside or outside.
    """
    xyz = camera_points(view.pose, points)
    selected = selected_by(view, line_count, xyz)
    u, v = np.full((2, len(points)), np.nan)
    plane, _, _ = segmentation.depth_plane(line_count, view.steps)
    with np.errstate(all="ignore"):
        u[selected], v[selected] = projection.project_trigonometric(
            *(axis[selected] for axis in xyz),
            plane,
            view.q_depth_map,
            camera.width,
            camera.height,
        )
    column, row = projection.pixel(u, v)
    result = zbuffer.render_loop(
        *xyz,
        column,
        row,
        width=camera.width,
        height=camera.height,
        selected=selected,
        **options,
    )
    at_border = np.zeros((camera.height, camera.width), bool)
    error = float32_pixel_error(camera.width, camera.height)
    for i in np.flatnonzero(selected):
        columns = {math.floor(u[i] + 0.5 - error), math.floor(u[i] + 0.5 + error)}
        rows = {math.floor(v[i] + 0.5 - error), math.floor(v[i] + 0.5 + error)}
        if len(columns) * len(rows) > 1:
            for r in rows & set(range(camera.height)):
                for c in columns & set(range(camera.width)):
                    at_border[r, c] = True
    return result, at_border


@given(data=st.data(), kind=st.sampled_from(KINDS))
def test_the_angles_of_figure_10_give_the_same_winner(device, data, kind):
    """The trigonometric projection in float64: every pixel that differs has a point at its border.

    "At its border" is `float32_pixel_error`, at most 6.2e-6 px for these 24 pixels.
    """
    view, points, line_count = data.draw(small_range_views(clouds))
    options = {"depth_kind": kind, "min_range": 0.0, "max_range": 15.0}
    depth_map = render(points, view, options, device)
    (depth, index, _), at_border = trigonometric_twin(
        points, view, depth_map.camera, line_count, options
    )
    np.testing.assert_array_equal(depth_map.index[~at_border], index[~at_border])
    np.testing.assert_array_equal(
        depth_map.depth[~at_border].view(np.uint32), depth[~at_border].view(np.uint32)
    )


@given(seed=seeds, kind=st.sampled_from(KINDS), position=positions, orientation=orientations)
def test_the_angles_of_figure_10_without_points_at_borders(
    device, seed, kind, position, orientation
):
    """Points at least 0.05 px from every border: the same winner everywhere, no exception."""
    rng = np.random.default_rng(seed)
    view = dw.RangeView(position, orientation, (70, 50), q_line=0.02, depth_plane=8.0)
    line_count = segmentation.line_count(8.0, view.steps[0])
    plane, half_width, half_height = segmentation.depth_plane(line_count, view.steps)
    view = dataclasses.replace(view, q_depth_map=2 * max(half_width, half_height) / 20)
    camera = view.camera_of_plane(line_count)
    u = rng.integers(-1, camera.width + 1, 300) + rng.uniform(-0.45, 0.45, 300)
    v = rng.integers(-1, camera.height + 1, 300) + rng.uniform(-0.45, 0.45, 300)
    X = rng.uniform(0.5, 8, 300)
    local = np.stack([X, (camera.cx - u) / camera.fx * X, (camera.cy - v) / camera.fy * X], axis=1)
    points = ahead_of(view.pose, local)
    options = {"depth_kind": kind, "min_range": 0.0, "max_range": 15.0}
    depth_map = render(points, view, options, device)
    expected, at_border = trigonometric_twin(points, view, camera, line_count, options)
    assert not at_border.any() and depth_map.stats.drawn > 20
    assert_is_twin(depth_map, expected)


def test_pixels_that_differ_from_the_angles_are_few_and_explained(device):
    """40,000 points, some aimed at borders, 300 x 249 px: a few winners differ, all explained."""
    rng = np.random.default_rng(12)
    view = dw.RangeView((0.3, -0.2, 0.1), (3, -7, 25), (60, 45), q_line=0.05, depth_plane=9.0)
    line_count = segmentation.line_count(9.0, view.steps[0])
    _, half_width, _ = segmentation.depth_plane(line_count, view.steps)
    view = dataclasses.replace(view, q_depth_map=2 * half_width / 300)
    camera = view.camera_of_plane(line_count)
    count = 40_000
    u = rng.uniform(-0.5, camera.width - 0.5, count)
    u[:1000] = np.rint(u[:1000]) - 0.5
    v = rng.uniform(-0.5, camera.height - 0.5, count)
    X = rng.uniform(1, 9, count)
    local = np.stack([X, (camera.cx - u) / camera.fx * X, (camera.cy - v) / camera.fy * X], axis=1)
    points = ahead_of(view.pose, local)
    options = {"depth_kind": "range", "min_range": 0.0, "max_range": 15.0}
    depth_map = render(points, view, options, device)
    (_, index, _), at_border = trigonometric_twin(points, view, camera, line_count, options)
    different = depth_map.index != index
    print(f"{different.sum()} of {different.size} pixels differ, {at_border.sum()} are at a border")
    assert 0 < different.sum() < different.size // 100
    assert at_border.sum() < different.size // 10
    assert not (different & ~at_border).any()
    # The loop with the kernel's own arithmetic needs no explanation.
    selected = selected_by(view, line_count, camera_points(view.pose, points))
    assert_is_twin(depth_map, twin(points, camera, selected, **options))


@given(data=st.data())
def test_depth_is_that_of_the_winning_point(device, data):
    """`camera.project` in float64 puts the winner into the pixel, at the depth of the map."""
    camera = data.draw(cameras())
    points = data.draw(clouds(camera.pose))
    for kind in KINDS:
        depth_map = dw.render(dw.PointCloud(points), camera, depth=kind, device=device)
        row, column = np.nonzero(depth_map.index >= 0)
        winners = points[depth_map.index[row, column]]
        moved = 1e-6 * (np.abs(winners).max(axis=1, initial=0) + 10)  # by rotating in float32
        x = camera.pose.to_camera(winners)[:, 0]
        clear = x > 2 * moved  # not so near the camera's plane that float64 may see it behind
        u, v, depth, _ = (values[clear] for values in camera.project(winners, depth=kind))
        row, column, x, moved = row[clear], column[clear], x[clear], moved[clear]
        assert (np.abs(depth - depth_map.depth[row, column]) <= moved).all()
        # A point that moves by `moved` moves in the image by f (1 + |Y / X|) / X of that.
        for place, center, focal, pixel in [
            (u, camera.cx, camera.fx, column),
            (v, camera.cy, camera.fy, row),
        ]:
            margin = (focal + np.abs(place - center)) * moved / (x - moved) + 1e-4
            assert (np.abs(place - pixel) <= 0.5 + margin).all()


@given(seed=seeds, motion=st.tuples(positions, orientations), kind=st.sampled_from(KINDS))
def test_moving_cloud_and_camera_together_changes_nothing(device, seed, motion, kind):
    """A rigid motion of both: the same winners, depths within the rounding of the coordinates."""
    rng = np.random.default_rng(seed)
    camera = dw.PinholeCamera.from_fov((70, 60), (16, 12), (0.5, 0.2, -0.3), (10, 20, 30))
    u = np.arange(16 * 12) % 16 + rng.uniform(-0.4, 0.4, 192)
    v = np.arange(16 * 12) // 16 + rng.uniform(-0.4, 0.4, 192)
    X = rng.uniform(1, 5, 192)
    local = np.stack([X, (camera.cx - u) / camera.fx * X, (camera.cy - v) / camera.fy * X], axis=1)
    points = ahead_of(camera.pose, local)
    moving = dw.Pose.from_orientation(*motion).optical_from_world
    moved = (points @ moving[:3, :3].T + moving[:3, 3]).astype(np.float32)
    other = dw.PinholeCamera.from_matrix(
        camera.K,
        camera.size,
        optical_from_world=camera.pose.optical_from_world @ np.linalg.inv(moving),
    )
    before = dw.render(dw.PointCloud(points), camera, depth=kind, device=device)
    after = dw.render(dw.PointCloud(moved), other, depth=kind, device=device)
    np.testing.assert_array_equal(before.index, np.arange(192).reshape(12, 16))
    np.testing.assert_array_equal(after.index, before.index)
    np.testing.assert_allclose(after.depth, before.depth, atol=1e-5)


def test_the_two_position_frames_agree_when_nothing_is_turned(device):
    """R = I: P_C in the world or in the rotated frame is the same picture, bit for bit."""
    rng = np.random.default_rng(13)
    cloud = dw.PointCloud(rng.uniform(-5, 5, (5000, 3)).astype(np.float32))
    maps = [
        dw.render(
            cloud,
            dw.RangeView((0.1, 0.2, 0.3), (0, 0, 0), (80, 60), 0.1, 0.1, frame),
            device=device,
        )
        for frame in ("world", "rotated")
    ]
    np.testing.assert_array_equal(maps[0].depth.view(np.uint32), maps[1].depth.view(np.uint32))
    np.testing.assert_array_equal(maps[0].index, maps[1].index)
    assert maps[0].stats == maps[1].stats and maps[0].stats.drawn > 400


def test_a_range_view_differs_from_its_camera_only_by_the_selection(device):
    """The camera of the depth plane draws all that the range view draws, and the rest ahead."""
    rng = np.random.default_rng(14)
    cloud = dw.PointCloud(rng.uniform(-5, 5, (20_000, 3)).astype(np.float32))
    view = dw.RangeView((0, 0, 0), (0, 0, 40), (60, 60), q_line=0.5, q_depth_map=0.1)
    paper = dw.render(cloud, view, device=device)
    part = cloud[view.segment(cloud, device=device)]
    alone = dw.render(part, view.camera(cloud, device=device), device=device)
    np.testing.assert_array_equal(paper.depth.view(np.uint32), alone.depth.view(np.uint32))
    whole = dw.render(cloud, view.camera(cloud, device=device), device=device)
    assert whole.stats.drawn > paper.stats.drawn > 1000
    near = (whole.depth > 0) & (whole.depth < paper.depth)
    assert near.any()  # nearer than the first rectangle, or outside its steps


# --- plans ---


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


# --- bad input ---


@pytest.mark.parametrize(
    ("low", "high"),
    [(0.0, 0.0), (2.0, 1.0), (-1.0, 5.0), (math.nan, 5.0), (0.0, math.nan), (0.0, -1.0)],
)
def test_bounds_that_are_no_interval_are_refused(low, high):
    """0 <= min_range < max_range; the message gives both."""
    camera = dw.PinholeCamera.from_fov((60, 45), (3, 3))
    cloud = dw.PointCloud(np.zeros((1, 3), np.float32))
    with pytest.raises(InputError, match="min_range and max_range"):
        dw.render(cloud, camera, min_range=low, max_range=high, device="cpu")


def test_an_unknown_depth_kind_is_refused():
    """The message lists the kinds."""
    camera = dw.PinholeCamera.from_fov((60, 45), (3, 3))
    with pytest.raises(InputError, match="depth must be one of 'range', 'z', got 'euclid'"):
        dw.render(dw.PointCloud(np.zeros((1, 3))), camera, depth="euclid", device="cpu")


def test_arguments_of_another_kind_are_refused():
    """An array is no cloud, a tuple no camera: the message says what to make of it."""
    camera = dw.PinholeCamera.from_fov((60, 45), (3, 3))
    with pytest.raises(InputError, match=r"PointCloud, got ndarray: dw.PointCloud\(points\)"):
        dw.render(np.zeros((1, 3)), camera, device="cpu")
    with pytest.raises(InputError, match="PinholeCamera or a RangeView, got tuple"):
        dw.render(dw.PointCloud(np.zeros((1, 3))), (1, 2, 3), device="cpu")


@pytest.mark.parametrize("name", ["cuda:99", "tpu", ""])
def test_a_device_that_is_not_there_is_refused(name):
    """The message names it and lists those that there are."""
    camera = dw.PinholeCamera.from_fov((60, 45), (3, 3))
    with pytest.raises(DeviceError, match=f"device '{name}' is not on this machine.*cpu"):
        dw.render(dw.PointCloud(np.zeros((1, 3))), camera, device=name)


def test_a_map_that_does_not_fit_is_refused(device, monkeypatch):
    """65,000 x 65,000 px with a gigabyte free: what is needed, what is free, what to do."""
    monkeypatch.setattr("depthwarp.devices.free_memory", lambda device: 10**9)
    camera = dw.PinholeCamera.from_fov((60, 45), (65_000, 65_000))
    cloud = dw.PointCloud(np.zeros((1, 3)))
    with pytest.raises(CapacityError, match=r"65000 x 65000.*1 GB are free.*smaller size"):
        dw.render(cloud, camera, device=device)
    view = dw.RangeView((0, 0, 0), (0, 0, 0), (60, 60), q_depth_map=1e-4, depth_plane=5.0)
    with pytest.raises(CapacityError, match="larger q_depth_map"):
        dw.render(cloud, view, device=device)


def test_filters_count_in_the_memory_of_a_map(device, monkeypatch):
    """A map that just fits does not with the filters' working memory."""
    camera = dw.PinholeCamera.from_fov((60, 45), (100, 100))
    cloud = dw.PointCloud(np.ones((1, 3)))
    buffers = buffer_count(1, resolve_device(device))
    enough = 100 * 100 * (MAP_BYTES + 8 * (buffers - 1) + 3)
    monkeypatch.setattr("depthwarp.devices.free_memory", lambda device: enough)
    dw.render(cloud, camera, device=device)
    with pytest.raises(CapacityError):
        dw.render(cloud, camera, filters=dw.filters.paper(), device=device)


def test_free_memory_is_a_number_of_this_machine(device):
    """More than nothing, less than a petabyte."""
    assert 0 < free_memory(resolve_device(device)) < 10**15
