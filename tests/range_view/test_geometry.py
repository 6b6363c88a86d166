"""The view's geometry: rectangles, readings of the position, the camera and the depth plane."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import depthwarp as dw
from tests.range_view.views import DTYPES, PAPER
from tests.reference import projection, range_view_shape, segmentation
from tests.rendering.strategies import clouds, fields_of_view, range_views, seeds


@given(fov=st.tuples(fields_of_view, fields_of_view), q_line=st.floats(1e-4, 1))
def test_rectangles_are_the_corners_of_the_turned_v(fov, q_line):
    """X_n = n q_L cos h, Y_n = n q_L sin h, Z_n = n q_L tan v: the "V" drawn and turned."""
    view = dw.RangeView((0, 0, 0), (0, 0, 0), fov, q_line)
    h, v = math.radians(fov[0] / 2), math.radians(fov[1] / 2)
    expected = (q_line * math.cos(h), q_line * math.sin(h), q_line * math.tan(v))
    assert view.steps == pytest.approx(expected, rel=1e-15)
    assert view.steps == segmentation.steps(fov, q_line)

    rectangles = view.rectangles(50)
    assert rectangles.shape == (50, 3)
    corners = range_view_shape.corner_rectangles(range_view_shape.range_view_edges(fov, q_line, 50))
    np.testing.assert_allclose(rectangles[:, 0], corners["x"], rtol=1e-13)
    np.testing.assert_allclose(rectangles[:, 1], corners["y_max"], rtol=1e-13)
    np.testing.assert_allclose(-rectangles[:, 1], corners["y_min"], rtol=1e-13)
    np.testing.assert_allclose(rectangles[:, 2], corners["z_max"], rtol=1e-13)
    np.testing.assert_allclose(-rectangles[:, 2], corners["z_min"], rtol=1e-13)


def test_a_finer_line_converges_to_the_frustum(device):
    """As q_L goes to 0 the range view becomes |Y| < X tan h, |Z| < X tan v / cos h."""
    rng = np.random.default_rng(2)
    camera = rng.uniform((0.05, -6, -6), (6, 6, 6), (20_000, 3))
    cloud = dw.PointCloud(camera.astype(np.float32))
    X, Y, Z = cloud.points_world.astype(np.float64).T
    missing = []
    for q_line in (0.5, 0.05, 0.005, 0.0005):
        view = dw.RangeView((0, 0, 0), (0, 0, 0), (70, 50), q_line, depth_plane=7.0)
        step, side, top = view.steps
        frustum = (np.abs(Y) < X * side / step) & (np.abs(Z) < X * top / step)
        nearer = X - 1.01 * step  # a rectangle stands between X - step and X
        certain = (nearer > step) & (np.abs(Y) < nearer * side / step)
        certain &= np.abs(Z) < nearer * top / step
        selected = view.segment(cloud, dtype=np.float64, device=device)
        assert not (selected & ~frustum).any()
        assert not (certain & ~selected).any()
        missing.append(int((frustum & ~selected).sum()))
    assert missing[0] > missing[1] > missing[2] > missing[3]
    assert missing[3] <= 5 < 1000 < frustum.sum()


@given(data=st.data())
def test_both_readings_of_the_position_agree_when_nothing_is_turned(device, data):
    """R = I: p - P_C before or after the rotation is the same number."""
    view = data.draw(range_views(depth_plane=True))
    view = dataclasses.replace(view, orientation=(0.0, 0.0, 0.0), position_frame="world")
    rotated = dataclasses.replace(view, position_frame="rotated")
    cloud = dw.PointCloud(data.draw(clouds(view.pose)))
    for dtype in DTYPES:
        np.testing.assert_array_equal(
            view.segment(cloud, dtype=dtype, device=device),
            rotated.segment(cloud, dtype=dtype, device=device),
        )


def test_the_two_readings_differ_when_turned(device):
    """Yaw 90, 3 m ahead: P_C + (0, 3, 0) in the world; P_C + (3, 0, 0), turned back, if rotated."""
    world, rotated = (1.79, 3.3 + 3, 1.2), (-3.3, 1.79 + 3, 1.2)
    cloud = dw.PointCloud(np.array([world, rotated], np.float32))
    other = dataclasses.replace(PAPER, position_frame="rotated", depth_plane=3.0)
    view = dataclasses.replace(PAPER, depth_plane=3.0)
    assert view.segment(cloud, device=device).tolist() == [True, False]
    assert other.segment(cloud, device=device).tolist() == [False, True]


@given(data=st.data())
def test_the_camera_is_a_pinhole_of_focal_depth_plane_over_q(device, data):
    """fx = fy = D_PD / q_DM exactly; W and H are round(2 Y_NL / q_DM), round(2 Z_NL / q_DM)."""
    view = data.draw(range_views(depth_plane=True))
    empty = dw.PointCloud(np.empty((0, 3), np.float32))
    count = view.line_count(empty, device=device)
    plane, half_width, half_height = segmentation.depth_plane(count, view.steps)
    q = 2 * max(half_width, half_height) / data.draw(st.floats(0.2, 3000))
    view = dataclasses.replace(view, q_depth_map=q)
    camera = view.camera(empty, device=device)
    assert camera.fx == camera.fy == plane / q
    expected = projection.depth_map_size(half_width, half_height, q)
    assert camera.size == tuple(max(1, side) for side in expected)  # one pixel at least
    assert (camera.cx, camera.cy) == ((camera.width - 1) / 2, (camera.height - 1) / 2)
    assert camera.pose == view.pose


@given(data=st.data(), seed=seeds)
def test_the_camera_projects_as_the_angles_of_figure_10(data, seed):
    """The pinhole and the trigonometry of Figure 10 are one line: within 1e-9 px, relatively."""
    view = data.draw(range_views(depth_plane=True))
    plane, half_width, half_height = segmentation.depth_plane(
        segmentation.line_count(view.depth_plane, view.steps[0]), view.steps
    )
    view = dataclasses.replace(view, q_depth_map=2 * max(half_width, half_height) / 1000)
    camera = view.camera(dw.PointCloud(np.empty((0, 3), np.float32)))
    rng = np.random.default_rng(seed)
    local = rng.uniform(-1, 1, (200, 3)) * (0, half_width, half_height) + (plane, 0, 0)
    local *= rng.uniform(0.1, 1, (200, 1))
    pose = camera.pose
    points = (local + np.array(pose.shift)) @ pose.rotation + np.array(pose.position)
    u, v, depth, valid = camera.project(points)
    X, Y, Z = pose.to_camera(points).T
    expected = projection.project_trigonometric(
        X, Y, Z, plane, view.q_depth_map, camera.width, camera.height
    )
    np.testing.assert_allclose(u, expected[0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(v, expected[1], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(depth, np.sqrt(X * X + Y * Y + Z * Z), rtol=1e-12)
    inner = (np.abs(Y) < 0.99 * X * half_width / plane) & (
        np.abs(Z) < 0.99 * X * half_height / plane
    )
    if min(camera.size) > 100:  # else the rounding to whole pixels is more than 1 %
        assert valid[inner].all()


@pytest.mark.parametrize("fov", [(60, 60), (90, 40), (120, 120), (10, 80)])
def test_the_vertical_angle_is_that_of_the_side_edges(device, fov):
    """On the optical axis the view is higher: tan(v_axis) = tan v / cos h."""
    view = dw.RangeView((0, 0, 0), (0, 0, 0), fov, q_depth_map=0.001, depth_plane=5.0)
    camera = view.camera(dw.PointCloud(np.empty((0, 3), np.float32)), device=device)
    h, v = math.radians(fov[0] / 2), math.radians(fov[1] / 2)
    half_pixel = 0.51 / camera.fy  # the height is rounded to whole pixels
    assert camera.height / 2 / camera.fy == pytest.approx(math.tan(v) / math.cos(h), abs=half_pixel)
    assert camera.width / 2 / camera.fx == pytest.approx(math.tan(h), abs=half_pixel)
    step, side, top = view.steps
    assert math.degrees(math.atan(top / math.hypot(step, side))) == pytest.approx(fov[1] / 2)
    # A camera by field of view takes the angle on the axis: with that angle it is the same one.
    axis = 2 * math.degrees(math.atan(math.tan(v) / math.cos(h)))
    other = dw.PinholeCamera.from_fov((fov[0], axis), camera.size)
    assert (other.fx, other.fy) == pytest.approx((camera.fx, camera.fy), rel=half_pixel)
    assert (other.cx, other.cy) == (camera.cx, camera.cy)


def test_the_papers_width_of_724_pixels(device):
    """60 degrees, 1 cm, the farthest point at 6.265 m: 724 rectangles and columns."""
    view = dw.RangeView((0, 0, 0), (0, 0, 0), (60, 60))
    cloud = dw.PointCloud(np.array([[6.265, 0.1, 0.2], [3, 0, 0], [-9, 0, 0]], np.float32))
    assert view.line_count(cloud, device=device) == 724
    assert view.camera(cloud, device=device).width == 724
    assert view.rectangles(724)[-1, 0] >= 6.265 > view.rectangles(724)[-2, 0]


def test_the_depth_plane_stands_at_or_just_behind_the_farthest_point(device):
    """N_L = ceil(max X / (q_L cos h)); a given D_PD takes its place."""
    points = np.array([[4, 0, 0], [2, 9, 9], [np.nan, 0, 0], [np.inf, 0, 0]], np.float32)
    cloud = dw.PointCloud(points)
    view = dw.RangeView((0, 0, 0), (0, 0, 0), (90, 60), q_line=0.1)
    count = view.line_count(cloud, device=device)
    plane, before = count * view.steps[0], (count - 1) * view.steps[0]
    assert before < 4 <= plane
    given_plane = dataclasses.replace(view, depth_plane=1.0)
    assert given_plane.line_count(cloud, device=device) == math.ceil(1.0 / view.steps[0])
    near = dataclasses.replace(view, depth_plane=1e-9)
    assert near.line_count(cloud, device=device) == 1
