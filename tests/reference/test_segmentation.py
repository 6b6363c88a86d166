"""The reference's range view and its union of rectangles, by hand and by brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.reference import (
    range_view_shape,
    segmentation,
)
from tests.reference.points import DTYPES, INF, NAN, columns


@pytest.mark.parametrize("fov", [(60, 60), (90, 45), (10, 120), (150, 1)])
def test_rectangle_corners_are_the_turned_v(fov):
    """X_n = n q_L cos h, Y_n = n q_L sin h, Z_n = n q_L tan v are the points of the "V"."""
    n_lines, q_line = 500, 0.01
    edges = range_view_shape.range_view_edges(fov, q_line, n_lines)
    corners = range_view_shape.corner_rectangles(edges)
    x, y, z = segmentation.rectangles(n_lines, segmentation.steps(fov, q_line), np.float64)
    for name, expected in {"x": x, "y_min": -y, "y_max": y, "z_min": -z, "z_max": z}.items():
        np.testing.assert_allclose(corners[name], expected, rtol=1e-13, err_msg=name)
    np.testing.assert_allclose(edges[:, :, 0], np.broadcast_to(x, (4, n_lines)), rtol=1e-13)
    assert (edges[:2, :, 1] > 0).all() and (edges[2:, :, 1] < 0).all()  # left, right
    assert (edges[::2, :, 2] > 0).all() and (edges[1::2, :, 2] < 0).all()  # upper, lower


def test_range_view_is_shifted_to_the_position():
    position = (1.79, 3.3, 1.2)
    at_origin = range_view_shape.range_view_edges((60, 60), 0.01, 3)
    shifted = range_view_shape.range_view_edges((60, 60), 0.01, 3, position)
    np.testing.assert_allclose(shifted - at_origin, np.broadcast_to(position, (4, 3, 3)))


def test_vertical_field_of_view_is_that_of_the_side_edges():
    """On the optical axis the view is higher: tan(v_axis) = tan v / cos h."""
    step_x, step_y, step_z = segmentation.steps((60, 40), 0.01)
    assert step_y / step_x == pytest.approx(math.tan(math.radians(30)))
    assert step_z / math.hypot(step_x, step_y) == pytest.approx(math.tan(math.radians(20)))
    assert step_z / step_x == pytest.approx(math.tan(math.radians(20)) / math.cos(math.radians(30)))


def test_the_last_rectangle_ends_the_cloud():
    assert segmentation.line_count(2.0, 0.5) == 4  # at the farthest point
    assert segmentation.line_count(2.01, 0.5) == 5  # just behind it
    assert segmentation.line_count(0.0, 0.5) == 1
    assert segmentation.line_count(np.float32(-3.0), 0.5) == 1
    assert segmentation.depth_plane(5, (0.5, 0.25, 1.0)) == (2.5, 1.25, 5.0)


def test_only_finite_points_ahead_set_the_line_count():
    points = [(1, 0, 0), (3, 9, 9), (-7, 0, 0), (NAN, 0, 0), (INF, 0, 0), (8, NAN, 0)]
    assert segmentation.max_x_ahead(*columns(points, np.float32)) == 3.0
    assert segmentation.max_x_ahead(*columns([(-1, 0, 0)], np.float32)) == 0.0
    assert segmentation.max_x_ahead(*columns(np.empty((0, 3)), np.float32)) == 0.0


@pytest.mark.parametrize("dtype", DTYPES)
def test_rectangles_are_rounded_products(dtype):
    """n times the rounded step, one rounding: not a running sum, not a rounded float64 product."""
    x, y, z = segmentation.rectangles(1000, (0.1, 0.7, 0.3), dtype)
    assert x.dtype == y.dtype == z.dtype == dtype
    for n in (1, 3, 7, 999, 1000):
        assert x[n - 1] == dtype(n) * dtype(0.1)
        assert y[n - 1] == dtype(n) * dtype(0.7)
        assert z[n - 1] == dtype(n) * dtype(0.3)


UNION_EXAMPLES = [
    # Rectangles X_n = n, |Y| < n / 2, |Z| < n / 4, n = 1..3
    ((1.5, 0.0, 0.0), True),
    ((1.0, 0.0, 0.0), False),  # on the first rectangle: not behind it
    ((0.5, 0.0, 0.0), False),  # before the first
    ((-2.0, 0.0, 0.0), False),
    ((1.5, 0.5, 0.0), False),  # on its side border
    ((1.5, -0.5, 0.0), False),
    ((1.5, 0.49, 0.0), True),
    ((1.5, 0.0, 0.25), False),  # on its upper border
    ((1.5, 0.0, -0.25), False),
    ((1.5, 0.0, -0.24), True),
    ((2.0, 0.75, 0.0), False),  # on rectangle 2: only 1 is before it, which is too narrow
    ((2.25, 0.75, 0.0), True),  # behind rectangle 2
    ((2.25, 0.75, 0.5), False),  # on the upper border of rectangle 2
    ((100.0, 1.4, 0.7), True),  # behind the last one, as (9) reads
    ((100.0, 1.5, 0.7), False),
    ((NAN, 0.0, 0.0), False),
    ((1.5, NAN, 0.0), False),
    ((1.5, 0.0, NAN), False),
    ((INF, 0.0, 0.0), False),
    ((-INF, 0.0, 0.0), False),
    ((1.5, INF, 0.0), False),
]


@pytest.mark.parametrize("dtype", DTYPES)
def test_union_of_rectangles_by_hand(dtype):
    rects = segmentation.rectangles(3, (1.0, 0.5, 0.25), dtype)
    X, Y, Z = columns([point for point, _ in UNION_EXAMPLES], dtype)
    selected = segmentation.segment_union(X, Y, Z, rects)
    assert selected.dtype == bool
    assert selected.tolist() == [kept for _, kept in UNION_EXAMPLES]


@pytest.mark.parametrize("dtype", DTYPES)
def test_union_is_decided_by_the_last_rectangle_before_the_point(dtype):
    """The closed form, by brute force, with coordinates on the borders themselves."""
    rng = np.random.default_rng(1)
    rects = segmentation.rectangles(60, segmentation.steps((70, 50), 0.05), dtype)
    pools = [np.concatenate([-r, r, rng.uniform(-2, 2, 50).astype(dtype)]) for r in rects]
    X, Y, Z = (rng.choice(pool, 4000) for pool in pools)
    X = np.abs(X)
    expected = []
    for x, y, z in zip(X, Y, Z, strict=True):
        m = np.count_nonzero(rects[0] < x)
        expected.append(m >= 1 and abs(y) < rects[1][m - 1] and abs(z) < rects[2][m - 1])
    selected = segmentation.segment_union(X, Y, Z, rects)
    assert selected.tolist() == expected
    assert 200 < selected.sum() < 3800


def test_union_of_fine_rectangles_is_the_frustum():
    rng = np.random.default_rng(2)
    step_x, step_y, step_z = steps = segmentation.steps((60, 60), 0.001)
    X, Y, Z = rng.uniform(-1, 1, (3, 3000))
    n_lines = segmentation.line_count(segmentation.max_x_ahead(X, Y, Z), step_x)
    selected = segmentation.segment_union(
        X, Y, Z, segmentation.rectangles(n_lines, steps, np.float64)
    )
    frustum = (X > 0) & (np.abs(Y) < X * step_y / step_x) & (np.abs(Z) < X * step_z / step_x)
    assert not (selected & ~frustum).any()  # the staircase lies within the frustum
    assert (selected != frustum).sum() < 10
    assert frustum.sum() > 100


def test_union_refuses_mixed_dtypes():
    X, Y, Z = columns([(1, 0, 0)], np.float32)
    with pytest.raises(TypeError):
        segmentation.segment_union(X, Y, Z, segmentation.rectangles(1, (1, 1, 1), np.float64))
