"""The range view: the kernel's closed form against the paper's union, and the view's geometry."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.errors import CapacityError, InputError
from depthwarp.range_view import MAX_LINES
from depthwarp_kernels.segment import segment_kernel
from tests.reference import projection, range_view_shape, rotation, segmentation
from tests.rendering.strategies import SPECIAL, clouds, fields_of_view, range_views, seeds

DTYPES = [np.float32, np.float64]
PAPER = dw.RangeView(position=(1.79, 3.3, 1.2), orientation=(0, 0, 90), fov=(60, 60))


def twin(view: dw.RangeView, points: np.ndarray, dtype: type, line_count: int) -> np.ndarray:
    """The literal O(N N_L) union of (8)(9), from the same float64 rotation and steps."""
    pose = view.pose
    X, Y, Z = rotation.to_camera(points, pose.rotation, pose.position, pose.shift, dtype)
    rectangles = segmentation.rectangles(line_count, view.steps, dtype)
    return segmentation.segment_union(X, Y, Z, rectangles)


def launch_segment(points, position, steps, line_count, dtype, device) -> np.ndarray:
    """The kernel on a view that is not turned, with any steps at all."""
    scalar = wp.float32 if dtype is np.float32 else wp.float64
    vec3 = wp.types.vector(length=3, dtype=scalar)
    mat33 = wp.types.matrix(shape=(3, 3), dtype=scalar)
    selected = wp.empty(len(points), dtype=wp.uint8, device=device)
    wp.launch(
        segment_kernel(scalar),
        dim=len(points),
        inputs=[
            wp.array(points, dtype=wp.vec3f, device=device),
            mat33(*np.eye(3).ravel().tolist()),
            vec3(*position),
            vec3(0.0, 0.0, 0.0),
            vec3(*steps),
            line_count,
        ],
        outputs=[selected],
        device=device,
    )
    return selected.numpy().astype(bool)


def neighbours(rng: np.random.Generator, values: np.ndarray) -> np.ndarray:
    """Each value itself, or the floating point number just below or above it."""
    way = rng.choice(np.array([-np.inf, np.nan, np.inf], values.dtype), values.shape)
    with np.errstate(under="ignore"):
        return np.where(np.isnan(way), values, np.nextafter(values, way))


def border_targets(rng: np.random.Generator, rectangles, size: int) -> np.ndarray:
    """Camera points (size, 3) on the rectangles' planes, sides, tops, corners, and beside them."""
    x_n, y_n, z_n = rectangles
    count = len(x_n)
    n = rng.integers(0, count, size)
    side = np.clip(n + rng.integers(-2, 2, size), 0, count - 1)
    top = np.clip(n + rng.integers(-2, 2, size), 0, count - 1)
    sign = rng.choice(np.array([-1, 1], x_n.dtype), (2, size))
    inner = rng.choice(np.array([0.0, 0.5, 1.0, 1.0], x_n.dtype), (2, size))
    X = neighbours(rng, x_n[n])
    Y = sign[0] * neighbours(rng, y_n[side] * inner[0])
    Z = sign[1] * neighbours(rng, z_n[top] * inner[1])
    return np.stack([X, Y, Z], axis=1)


# --- the selected set is the union's, bit for bit ---


@pytest.mark.parametrize("dtype", DTYPES)
@given(data=st.data())
def test_segmentation_is_the_union_with_a_given_depth_plane(device, dtype, data):
    """Any pose, angles, step and cloud: the closed form selects the very set of the loop."""
    view = data.draw(range_views(depth_plane=True))
    points = data.draw(clouds(view.pose))
    cloud = dw.PointCloud(points)
    count = view.line_count(cloud, device=device)
    assert count == segmentation.line_count(view.depth_plane, view.steps[0])
    selected = view.segment(cloud, dtype=dtype, device=device)
    assert selected.dtype == np.bool_ and selected.shape == (len(points),)
    np.testing.assert_array_equal(selected, twin(view, points, dtype, count))


@pytest.mark.parametrize("dtype", DTYPES)
@given(data=st.data())
def test_segmentation_is_the_union_up_to_the_farthest_point(device, dtype, data):
    """Without a depth plane the cloud's farthest point ahead sets N_L, as in the reference."""
    view = data.draw(range_views(depth_plane=False))
    points = data.draw(clouds(view.pose))
    cloud, pose = dw.PointCloud(points), view.pose
    X, Y, Z = rotation.to_camera(points, pose.rotation, pose.position, pose.shift, np.float32)
    farthest = segmentation.max_x_ahead(X, Y, Z)
    count = segmentation.line_count(farthest, view.steps[0])
    if farthest == 0.0 or count > MAX_LINES:
        with pytest.raises(InputError, match="ahead|larger q_line"):
            view.segment(cloud, dtype=dtype, device=device)
        return
    assert view.line_count(cloud, device=device) == count
    selected = view.segment(cloud, dtype=dtype, device=device)
    np.testing.assert_array_equal(selected, twin(view, points, dtype, count))


@given(
    seed=seeds,
    fov=st.tuples(fields_of_view, fields_of_view),
    q_line=st.one_of(st.just(0.01), st.floats(1e-3, 3)),
    lines=st.integers(1, 800),
    yaw=st.sampled_from([0, 90]),
    frame=st.sampled_from(["world", "rotated"]),
)
def test_points_on_the_borders_of_rectangles_float32(device, seed, fov, q_line, lines, yaw, frame):
    """X = X_n, |Y| = Y_n, |Z| = Z_n and the floats next to them, exactly as the kernel sees them.

    A view at the origin, not turned or turned by a quarter, moves no bit of such a point.
    """
    view = dw.RangeView((0, 0, 0), (0, 0, yaw), fov, q_line, position_frame=frame)
    view = dataclasses.replace(view, depth_plane=lines * view.steps[0])
    rng = np.random.default_rng(seed)
    count = segmentation.line_count(view.depth_plane, view.steps[0])
    rectangles = segmentation.rectangles(count, view.steps, np.float32)
    targets = border_targets(rng, rectangles, 300)
    points = targets if yaw == 0 else np.stack([-targets[:, 1], targets[:, 0], targets[:, 2]], 1)
    X, Y, Z = rotation.to_camera(points, view.pose.rotation, (0, 0, 0), (0, 0, 0), np.float32)
    reached = np.stack([X, Y, Z], axis=1)
    if yaw == 0:
        np.testing.assert_array_equal(reached, targets)
    else:  # the cosine of 90 degrees is 6e-17: only an exact 0 becomes another number
        assert np.abs(reached - targets).max() <= 1e-15 * np.abs(targets).max()

    selected = view.segment(dw.PointCloud(points), device=device)
    np.testing.assert_array_equal(selected, segmentation.segment_union(X, Y, Z, rectangles))


@given(
    seed=seeds,
    fov=st.tuples(fields_of_view, fields_of_view),
    q_line=st.one_of(st.just(0.01), st.floats(1e-3, 3)),
    lines=st.integers(1, 300),
)
def test_points_on_the_borders_of_rectangles_float64(device, seed, fov, q_line, lines):
    """The same in float64: a position is chosen so that point - position is the border itself.

    Points are stored as float32, so p = float32(border) and position = p - border, which is exact.
    """
    view = dw.RangeView((0, 0, 0), (0, 0, 0), fov, q_line)
    view = dataclasses.replace(view, depth_plane=lines * view.steps[0])
    rng = np.random.default_rng(seed)
    count = segmentation.line_count(view.depth_plane, view.steps[0])
    rectangles = segmentation.rectangles(count, view.steps, np.float64)
    for target in border_targets(rng, rectangles, 12):
        point = target.astype(np.float32)
        position = tuple((point.astype(np.float64) - target).tolist())
        placed = dataclasses.replace(view, position=position)
        X, Y, Z = rotation.to_camera(point[None], np.eye(3), position, (0, 0, 0), np.float64)
        assert (X[0], Y[0], Z[0]) == tuple(target)
        expected = segmentation.segment_union(X, Y, Z, rectangles)
        selected = placed.segment(dw.PointCloud(point[None]), dtype=np.float64, device=device)
        assert selected.tolist() == expected.tolist(), target


@pytest.mark.parametrize("dtype", DTYPES)
@given(seed=seeds, numerators=st.tuples(*[st.integers(1, 4096)] * 3), lines=st.integers(1, 400))
def test_points_on_the_borders_of_exact_rectangles(device, dtype, seed, numerators, lines):
    """Steps of k / 1024 m: every border is a float32, so strict inequalities show in both types."""
    steps = tuple(k / 1024 for k in numerators)
    rng = np.random.default_rng(seed)
    rectangles = segmentation.rectangles(lines, steps, np.float32)
    points = border_targets(rng, rectangles, 300)
    origin = (0.0, 0.0, 0.0)
    X, Y, Z = rotation.to_camera(points, np.eye(3), origin, origin, dtype)
    expected = segmentation.segment_union(X, Y, Z, segmentation.rectangles(lines, steps, dtype))
    selected = launch_segment(points, origin, steps, lines, dtype, device)
    np.testing.assert_array_equal(selected, expected)


@pytest.mark.parametrize("dtype", DTYPES)
@given(
    seed=seeds,
    steps=st.tuples(*[st.floats(1e-6, 1e3, exclude_min=True)] * 3),
    lines=st.sampled_from([MAX_LINES, MAX_LINES - 1, 1_000_003]),
)
def test_the_guess_is_at_most_one_off_for_millions_of_rectangles(device, dtype, seed, steps, lines):
    """As many rectangles as are allowed, points on their planes: m is the count of X_n < X.

    That count is the union's, as rectangles only grow; it is affordable for millions of them.
    """
    rng = np.random.default_rng(seed)
    steps = tuple(float(np.float32(step)) for step in steps)
    near = np.sort(rng.integers(1, lines + 1, 200))
    x_n, y_n, z_n = (dtype(near) * dtype(step) for step in steps)
    targets = border_targets(rng, (x_n, y_n, z_n), 300).astype(np.float32)
    X, Y, Z = (column.astype(dtype) for column in targets.T)
    m = _count_of_planes_before(X, dtype(steps[0]), lines)
    n = m.astype(dtype)
    expected = (m >= 1) & (np.abs(Y) < n * dtype(steps[1])) & (np.abs(Z) < n * dtype(steps[2]))
    selected = launch_segment(targets, (0.0, 0.0, 0.0), steps, lines, dtype, device)
    np.testing.assert_array_equal(selected, expected)


def _count_of_planes_before(X: np.ndarray, step: np.floating, lines: int) -> np.ndarray:
    """The number of n in 1..lines with dtype(n) * step < X, by bisection (X_n never falls)."""
    low, high = np.zeros(X.shape, np.int64), np.full(X.shape, lines, np.int64)
    while (low < high).any():
        middle = (low + high + 1) // 2
        before = middle.astype(X.dtype) * step < X
        low, high = np.where(before, middle, low), np.where(before, high, middle - 1)
    return low


@pytest.mark.parametrize("dtype", DTYPES)
@pytest.mark.parametrize("fov", [(60, 60), (1, 179), (179, 1)])
def test_points_with_odd_coordinates(device, dtype, fov):
    """Every triple of zeros, NaN, infinities, huge, tiny and subnormal coordinates."""
    values = np.append(SPECIAL, np.array([0.7, -0.7, 0.02], np.float32))
    points = np.stack(np.meshgrid(values, values, values), axis=-1).reshape(-1, 3)
    view = dw.RangeView((0, 0, 0), (0, 0, 0), fov, depth_plane=1.0)
    selected = view.segment(dw.PointCloud(points), dtype=dtype, device=device)
    np.testing.assert_array_equal(
        selected, twin(view, points, dtype, view.line_count(dw.PointCloud(points[:0])))
    )
    assert selected.any() and not selected[~np.isfinite(points).all(axis=1)].any()
    assert not selected[points[:, 0] <= 0].any()


def test_float64_segmentation_is_finer_than_float32(device):
    """A point on a float32 plane that stands just behind the float64 one: only float64 selects."""
    step, side, _ = PAPER.steps
    n = next(n for n in range(2, 100) if float(np.float32(n) * np.float32(step)) > n * step)
    # Rectangle n - 1 is too narrow for this point, n is not.
    point = (np.float32(n) * np.float32(step), (n - 0.5) * side, 0.0)
    cloud = dw.PointCloud(np.array([point], np.float32))
    view = dataclasses.replace(
        PAPER, position=(0, 0, 0), orientation=(0, 0, 0), depth_plane=n * step
    )
    assert not view.segment(cloud, dtype=np.float32, device=device).item()
    assert view.segment(cloud, dtype=np.float64, device=device).item()


def test_selected_points_of_an_empty_cloud_are_none(device):
    """With a depth plane given, no points give an empty mask."""
    view = dataclasses.replace(PAPER, depth_plane=5.0)
    selected = view.segment(dw.PointCloud(np.empty((0, 3), np.float32)), device=device)
    assert selected.shape == (0,) and selected.dtype == np.bool_


def test_the_mask_selects_a_cloud(device):
    """`cloud[view.segment(cloud)]` is the segmented cloud: all of it in the view, none left out."""
    rng = np.random.default_rng(1)
    cloud = dw.PointCloud(rng.uniform(-5, 8, (5000, 3)).astype(np.float32))
    part = cloud[PAPER.segment(cloud, device=device)]
    assert 100 < len(part) < len(cloud)
    again = dataclasses.replace(PAPER, depth_plane=PAPER.steps[0] * PAPER.line_count(cloud))
    assert again.segment(part, device=device).all()


# --- the geometry that GEOMETRY.md states ---


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


# --- bad input ---


@pytest.mark.parametrize(
    "points",
    [
        np.empty((0, 3)),
        [[1.79, 0.0, 1.2]],
        [[1.79, 3.3, 1.2]],
        [[math.nan, 9.0, 0.0], [0.0, math.inf, 0.0]],
    ],
    ids=["no points", "behind", "at the camera", "not finite"],
)
def test_nothing_ahead_is_an_error_that_says_what_to_do(device, points):
    """Without a point ahead there is no depth plane; the message names the ways out."""
    cloud = dw.PointCloud(np.array(points, np.float32))
    for call in (PAPER.line_count, PAPER.segment, PAPER.camera):
        with pytest.raises(InputError, match=r"ahead.*orientation.*depth_plane"):
            call(cloud, device=device)


@pytest.mark.parametrize("angle", [0, 180, 181, -60, 360, math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", [0, 1])
def test_a_field_of_view_out_of_range_is_refused(angle, place):
    """Each angle is above 0 and below 180 degrees; the message names fov and the value."""
    fov = [60.0, 60.0]
    fov[place] = angle
    with pytest.raises(InputError, match="fov.*"):
        dw.RangeView((0, 0, 0), (0, 0, 0), tuple(fov))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("q_line", 0.0),
        ("q_line", -0.01),
        ("q_line", math.nan),
        ("q_line", math.inf),
        ("q_depth_map", 0.0),
        ("q_depth_map", -1.0),
        ("q_depth_map", math.nan),
        ("depth_plane", 0.0),
        ("depth_plane", -2.0),
        ("depth_plane", math.nan),
        ("depth_plane", math.inf),
        ("position", (0.0, math.nan, 0.0)),
        ("position", (0.0, 0.0)),
        ("orientation", (math.inf, 0.0, 0.0)),
        ("orientation", (0.0, 0.0, 0.0, 0.0)),
        ("position_frame", "camera"),
    ],
)
def test_a_parameter_out_of_range_is_refused(name, value):
    """The message begins with the parameter's name."""
    with pytest.raises(InputError, match=f"^{name}"):
        dataclasses.replace(PAPER, **{name: value})


@pytest.mark.parametrize("q_line", [1e-7, 1e-300, 5e-324])
def test_a_line_that_is_too_fine_is_refused(device, q_line):
    """Millions of rectangles: the message says how many, and to choose a larger q_line."""
    view = dataclasses.replace(PAPER, q_line=q_line, depth_plane=6.0)
    cloud = dw.PointCloud(np.zeros((1, 3), np.float32))
    for call in (view.line_count, view.segment, view.camera):
        with pytest.raises(InputError, match="larger q_line"):
            call(cloud, device=device)


def test_as_many_rectangles_as_are_allowed(device):
    """The limit itself passes, one more does not."""
    empty = dw.PointCloud(np.empty((0, 3), np.float32))
    view = dataclasses.replace(PAPER, depth_plane=MAX_LINES * PAPER.steps[0])
    assert view.line_count(empty, device=device) == MAX_LINES
    view = dataclasses.replace(PAPER, depth_plane=(MAX_LINES + 1) * PAPER.steps[0])
    with pytest.raises(InputError, match=f"{MAX_LINES} are possible"):
        view.line_count(empty, device=device)


@pytest.mark.parametrize("q_depth_map", [1e-6, 1e-300, 5e-324])
def test_a_pixel_that_is_too_small_is_refused(device, q_depth_map):
    """A map of a million pixels a side and more: CapacityError, with the remedy."""
    view = dataclasses.replace(PAPER, q_depth_map=q_depth_map, depth_plane=6.0)
    cloud = dw.PointCloud(np.zeros((1, 3), np.float32))
    with pytest.raises(CapacityError, match="larger q_depth_map"):
        view.camera(cloud, device=device)
    with pytest.raises(CapacityError, match="larger q_depth_map"):
        dw.render(cloud, view, device=device)


def test_segmentation_in_another_type_is_refused():
    """Only the two precisions that are exact."""
    with pytest.raises(InputError, match="dtype"):
        PAPER.segment(dw.PointCloud(np.ones((1, 3), np.float32)), dtype=np.float16)
