"""The kernel's closed form selects what the paper's union of rectangles does, bit for bit."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.errors import InputError
from depthwarp.range_view import MAX_LINES
from depthwarp_kernels.segment import segment_kernel
from tests.range_view.views import DTYPES, PAPER
from tests.reference import rotation, segmentation
from tests.rendering.strategies import SPECIAL, clouds, fields_of_view, range_views, seeds


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
