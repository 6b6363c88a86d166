"""Rendering against other arithmetic: figure 10's angles, float64, and moved worlds."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import depthwarp as dw
from tests.reference import projection, segmentation, zbuffer
from tests.rendering.strategies import (
    ahead_of,
    cameras,
    clouds,
    orientations,
    positions,
    seeds,
)
from tests.rendering.twin import (
    KINDS,
    assert_is_twin,
    camera_points,
    render,
    selected_by,
    small_range_views,
    twin,
)


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
