"""The references against truths small enough to check by hand (and cv2.dilate for the dilation)."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from tests.reference import (
    encoding,
    filters,
    precision,
    projection,
    range_view_shape,
    rotation,
    segmentation,
    zbuffer,
)

DTYPES = [np.float32, np.float64]
NAN, INF = math.nan, math.inf


def columns(points, dtype):
    """The X, Y, Z arrays of a list of points."""
    return tuple(np.array(points, dtype=dtype).T)


# --- precision ---


def test_mixed_dtypes_are_refused():
    with pytest.raises(TypeError, match="float32"):
        precision.common_dtype(np.zeros(1, np.float32), np.zeros(1, np.float64))


def test_rounding_is_to_nearest_even_and_overflow_is_infinite():
    assert precision.rounded(1.0 + 2.0**-24, np.float32) == 1.0
    assert precision.rounded(1e300, np.float32) == np.inf
    assert precision.rounded([0.1, 0.2], np.float32).dtype == np.float32


# --- rotation ---


def test_quarter_turns_are_passive():
    """The frame turns: after +90 degrees about Z the camera looks along the world's +Y."""
    x, y, z = np.eye(3)
    np.testing.assert_allclose(rotation.rotation_z(90) @ y, x, atol=1e-15)
    np.testing.assert_allclose(rotation.rotation_z(90) @ x, -y, atol=1e-15)
    np.testing.assert_allclose(rotation.rotation_x(90) @ z, y, atol=1e-15)
    np.testing.assert_allclose(rotation.rotation_y(90) @ x, z, atol=1e-15)


def test_yaw_is_applied_first_then_pitch_then_roll():
    """Facing +Y (yaw 90), then nose down (pitch 90): the camera looks along the world's -Z."""
    r = rotation.camera_from_world((0, 90, 90))
    np.testing.assert_allclose(r @ [0, 0, -1], [1, 0, 0], atol=1e-15)
    r = rotation.camera_from_world((10, 20, 30))
    np.testing.assert_allclose(r @ r.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(r) == pytest.approx(1.0)
    assert r[0, 2] == pytest.approx(-math.sin(math.radians(20)))
    assert r.dtype == np.float64


@pytest.mark.parametrize("dtype", DTYPES)
def test_the_two_readings_of_the_position(dtype):
    """World: R (p - P_C). Rotated: R p - P_C. They agree when nothing is turned."""
    quarter = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    point, position = np.array([[1.0, 2.0, 3.0]]), (0.5, 0.25, 1.0)
    world = rotation.to_camera_world_position(point, quarter, position, dtype)
    rotated = rotation.to_camera_rotated_position(point, quarter, position, dtype)
    assert [c.item() for c in world] == [1.75, -0.5, 2.0]
    assert [c.item() for c in rotated] == [1.5, -1.25, 2.0]
    assert all(c.dtype == dtype for c in (*world, *rotated))

    unturned = [
        reading(point, np.eye(3), position, dtype)
        for reading in (rotation.to_camera_world_position, rotation.to_camera_rotated_position)
    ]
    np.testing.assert_array_equal(*unturned)


def test_products_are_rounded_before_they_are_added():
    """a * a is 1 + 2^-11 + 2^-24: float32 drops the last bit, a fused multiply-add would not."""
    a = 1.0 + 2.0**-12
    r = np.array([[a, -1.0, 0.0]] * 3)
    point = np.array([[a, 1.0 + 2.0**-11, 0.0]])
    X, _, _ = rotation.to_camera(point, r, (0, 0, 0), (0, 0, 0), np.float32)
    assert X.item() == 0.0
    X, _, _ = rotation.to_camera(point, r, (0, 0, 0), (0, 0, 0), np.float64)
    assert X.item() == 2.0**-24


def test_sums_go_from_left_to_right():
    """In float32 (2^24 + 1) + 1 stays at 2^24; another order would give 2^24 + 2."""
    point = np.array([[2.0**24, 1.0, 1.0]])
    X, _, _ = rotation.to_camera(point, np.ones((3, 3)), (0, 0, 0), (0, 0, 0), np.float32)
    assert X.item() == 2.0**24


def test_position_is_rounded_first():
    """0.1 rounded to float32 twice is the same number, so the difference is exactly zero."""
    X, Y, Z = rotation.to_camera([[0.1, 0.1, 0.1]], np.eye(3), (0.1,) * 3, (0,) * 3, np.float32)
    assert (X.item(), Y.item(), Z.item()) == (0.0, 0.0, 0.0)


def test_points_that_are_not_finite_flow_through():
    X, Y, Z = rotation.to_camera(
        [[NAN, 0, 0], [INF, 0, 0], [1e30, 0, 0]], np.eye(3), (0, 0, 0), (0, 0, 0), np.float32
    )
    assert np.isnan(X[0])
    assert X[1] == np.inf and np.isnan(Y[1])
    assert np.isfinite([X[2], Y[2], Z[2]]).all()


# --- range view and segmentation ---


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
    """GEOMETRY's closed form, by brute force, with coordinates on the borders themselves."""
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


# --- projection ---


def test_trigonometry_is_a_pinhole_of_focal_depth_plane_over_q():
    rng = np.random.default_rng(3)
    X = rng.uniform(0.3, 10, 20000)
    Y, Z = X * rng.uniform(-1, 1, (2, 20000))
    plane, q, width, height = 6.27, 0.01, 724, 662
    trigonometric = projection.project_trigonometric(X, Y, Z, plane, q, width, height)
    focal = plane / q
    pinhole = projection.project_pinhole(
        X, Y, Z, focal, focal, (width - 1) / 2, (height - 1) / 2, np.float64
    )
    np.testing.assert_allclose(trigonometric, pinhole, rtol=0, atol=1e-9)


def test_trigonometry_by_hand():
    """A point 1 left of and 1 above one that is 2 ahead meets a plane at 4 at (2, 2)."""
    u, v = projection.project_trigonometric([2.0], [1.0], [1.0], 4.0, 0.1, 101, 81)
    assert u[0] == pytest.approx(50 - 20) and v[0] == pytest.approx(40 - 20)
    u, v = projection.project_trigonometric([2.0], [0.0], [0.0], 4.0, 0.1, 100, 80)
    assert (u[0], v[0]) == (49.5, 39.5)


def test_the_other_reading_of_the_second_triangle_is_the_same_line():
    """Figure 10 names (D_PD, d_z, D_PDH): D_PDH drawn upright instead of level changes nothing."""
    rng = np.random.default_rng(4)
    X = rng.uniform(0.3, 10, 100)
    Y, Z = X * rng.uniform(-1, 1, (2, 100))
    _, v = projection.project_trigonometric(X, Y, Z, 5.0, 0.01, 100, 100)
    phi_z = np.arctan2(Z, X)
    d_pdh = 5.0 / np.cos(phi_z)
    np.testing.assert_allclose(v, 49.5 - d_pdh * np.sin(phi_z) / 0.01, rtol=0, atol=1e-9)


def test_depth_map_size_and_border_rays():
    """The depth plane's own border is the image's border: u = -0.5 and W - 0.5."""
    steps = segmentation.steps((60, 60), 0.01)
    plane, half_width, half_height = segmentation.depth_plane(627, steps)
    width, height = projection.depth_map_size(half_width, half_height, 0.01)
    assert (width, height) == (627, 724)
    u, v = projection.project_trigonometric(
        [plane, plane],
        [half_width, -half_width],
        [half_height, -half_height],
        plane,
        0.01,
        627,
        724,
    )
    np.testing.assert_allclose(u, [-0.5, 626.5], atol=0.5)  # the size is rounded to whole pixels
    np.testing.assert_allclose(v, [-0.5, 723.5], atol=0.5)


def test_pinhole_rounds_each_operation():
    rng = np.random.default_rng(5)
    X, Y, Z = rng.uniform(0.5, 5, (3, 200)).astype(np.float32)
    f = np.float32
    u, v = projection.project_pinhole(X, Y, Z, 501.3, 499.7, 319.5, 239.5, f)
    assert u.dtype == v.dtype == f
    for i in range(200):
        assert u[i] == f(319.5) - f(f(501.3) * f(Y[i] / X[i]))
        assert v[i] == f(239.5) - f(f(499.7) * f(Z[i] / X[i]))


@pytest.mark.parametrize("dtype", DTYPES)
def test_pixel_centres_are_integers(dtype):
    u = np.array([-0.5, -0.51, 0.0, 0.49, 0.5, 3.49, 3.5, NAN, INF, -INF], dtype=dtype)
    zero = np.zeros_like(u)
    column, row = projection.pixel(u, zero)
    assert column.dtype == row.dtype == dtype
    np.testing.assert_array_equal(column, [0, -1, 0, 0, 1, 3, 4, NAN, INF, -INF])
    expected = [True, False, True, True, True, True, False, False, False, False]
    assert projection.inside(u, zero, 4, 1).tolist() == expected
    assert projection.inside(zero, u, 1, 4).tolist() == expected


def test_pixel_of_the_number_below_one_half():
    """In float32 the sum 0.49999997 + 0.5 rounds to 1: the rule is the sum's, not the ideal's."""
    below = np.nextafter(np.float32(0.5), np.float32(0))
    column, _ = projection.pixel(np.array([below]), np.array([below]))
    assert column.item() == 1.0


def test_pinhole_of_points_without_a_picture():
    X, Y, Z = columns([(0, 1, 0), (0, 0, 0), (NAN, 1, 1), (1e-38, 1e38, 0)], np.float32)
    u, v = projection.project_pinhole(X, Y, Z, 100, 100, 50, 50, np.float32)
    assert not projection.inside(u, v, 101, 101).any()


# --- Z-buffer ---


def test_depth_kinds_by_hand():
    X, Y, Z = columns([(2, 3, 6)], np.float32)
    assert zbuffer.depth_range(X, Y, Z, np.float32).item() == 7.0
    assert zbuffer.depth_z(X, Y, Z, np.float32).item() == 2.0
    assert zbuffer.depth_range(X, Y, Z, np.float32).dtype == np.float32


def test_range_rounds_each_operation():
    rng = np.random.default_rng(6)
    X, Y, Z = rng.uniform(-5, 5, (3, 200)).astype(np.float32)
    f = np.float32
    depths = zbuffer.depth_range(X, Y, Z, f)
    for i in range(200):
        squares = f(f(f(X[i] * X[i]) + f(Y[i] * Y[i])) + f(Z[i] * Z[i]))
        assert depths[i] == f(math.sqrt(squares))  # the double root rounds once more, harmlessly


def render(points, dtype=np.float32, **options):
    """A 3 x 3 picture with focal length 1: Y / X and Z / X are the offsets from the centre."""
    X, Y, Z = columns(points, dtype)
    u, v = projection.project_pinhole(X, Y, Z, 1, 1, 1, 1, dtype)
    column, row = projection.pixel(u, v)
    options = {"depth_kind": "z"} | options
    return zbuffer.render_loop(X, Y, Z, column, row, width=3, height=3, **options)


@pytest.mark.parametrize("dtype", DTYPES)
def test_left_and_up_are_low_columns_and_rows(dtype):
    depth, index, counts = render([(2, 2, 0), (3, 0, 3)], dtype)
    assert depth.tolist() == [[0, 3, 0], [2, 0, 0], [0, 0, 0]]
    assert index.tolist() == [[-1, 1, -1], [0, -1, -1], [-1, -1, -1]]
    assert depth.dtype == np.float32 and index.dtype == np.int32
    assert counts["drawn"] == counts["total"] == 2


def test_nearest_wins_in_any_order():
    points = [(5, 0, 0), (2, 0, 0), (4, 0, 0)]
    for order, winner in [((0, 1, 2), 1), ((1, 0, 2), 0), ((2, 0, 1), 2)]:
        depth, index, counts = render([points[i] for i in order])
        assert (depth[1, 1], index[1, 1]) == (2, winner)
        assert (counts["drawn"], counts["hidden"]) == (1, 2)


def test_lowest_index_wins_a_tie():
    """Two points of one range and one pixel; in float64 a difference below float32 is a tie too."""
    depth, index, counts = render([(4, 0, 0), (3, 0, 0.125), (3, 0.125, 0)], depth_kind="range")
    assert index[1, 1] == 1
    assert (counts["drawn"], counts["hidden"]) == (1, 2)
    _, index, _ = render([(3 + 1e-12, 0, 0), (3, 0, 0)], np.float64)
    assert index[1, 1] == 0


def test_every_point_is_counted_once_in_the_first_category():
    points = [
        (NAN, 0, 0),
        (1, 0, -INF),
        (-INF, 0, 0),
        (0, 0, 0),  # behind: X <= 0
        (-0.0, 1, 1),
        (-99, 0, 0),  # behind, before too far
        (1, 2, 0),  # outside
        (99, 990, 0),  # outside, before too far
        (16, 0, 0),  # too far
        (0.25, 0, 0),  # too near
        (15, 0, 0),  # on the limit: drawn, then hidden by the next
        (0.5, 0, 0),  # on the limit: drawn
    ]
    _, index, counts = render(points, min_range=0.5, max_range=15.0)
    assert counts == {
        "total": 12,
        "not_finite": 3,
        "behind": 3,
        "outside": 2,
        "too_near": 1,
        "too_far": 1,
        "hidden": 1,
        "drawn": 1,
    }
    assert index[1, 1] == 11
    assert sum(counts.values()) == 2 * counts["total"]


def test_limits_are_float32_and_too_far_is_asked_first():
    """float32(0.1) is more than 0.1: a float32 point at "0.1" is on both limits, not beyond one."""
    _, _, counts = render([(0.1, 0, 0)], min_range=0.1, max_range=0.1)
    assert counts["drawn"] == 1
    _, _, counts = render([(5, 0, 0)], min_range=10, max_range=1)
    assert (counts["too_far"], counts["too_near"]) == (1, 0)


def test_depth_that_rounds_to_zero_is_too_near():
    """Zero means empty, so a point so near that its depth is 0 cannot be drawn."""
    _, _, counts = render([(1e-30, 0, 0)], depth_kind="range")  # its square underflows in float32
    assert counts["too_near"] == 1
    _, _, counts = render([(1e-60, 0, 0)], np.float64)  # float32 of it is 0
    assert counts["too_near"] == 1


def test_points_that_are_not_selected_are_outside():
    points = [(2, 0, 0), (3, 0, 0), (-1, 0, 0), (NAN, 0, 0), (99, 0, 0)]
    selected = np.array([False, True, False, False, False])
    _, index, counts = render(points, selected=selected)
    assert index[1, 1] == 1
    assert {name: n for name, n in counts.items() if n} == {
        "total": 5,
        "not_finite": 1,
        "behind": 1,
        "outside": 2,
        "drawn": 1,
    }


def test_depth_kind_decides_the_winner():
    """The point beside the axis has less depth along it, but more range."""
    points = [(2, 0, 0), (1.9, 0.9, 0)]
    assert render(points, depth_kind="z")[1][1, 1] == 1
    assert render(points, depth_kind="range")[1][1, 1] == 0


def test_no_points_give_an_empty_map():
    depth, index, counts = render(np.empty((0, 3)))
    assert not depth.any() and (index == -1).all() and not any(counts.values())


# --- 16-bit encoding ---


def test_range16_by_hand():
    depth = np.array([[0.0, 15.0, 7.5, 1e-6, 15.5, 3.0]], dtype=np.float32)
    image = encoding.encode_range16(depth, 15.0)
    assert image.dtype == np.uint16
    assert image.tolist() == [[0, 65535, 32768, 1, 0, 13107]]  # 32767.5 goes to the even number


def test_range16_rounds_ties_to_even():
    """With a full scale of 65535 m the image is the rounded depth itself."""
    depth = np.array([0.25, 0.5, 1.5, 2.5, 3.5, 65535.0], dtype=np.float32)
    assert encoding.encode_range16(depth, 65535.0).tolist() == [1, 1, 2, 2, 4, 65535]


def test_range16_comes_back_within_half_a_step():
    depth = np.linspace(0.001, 15, 5000, dtype=np.float32)
    back = encoding.decode_range16(encoding.encode_range16(depth, 15.0), 15.0)
    assert back.dtype == np.float32
    assert np.abs(back - depth).max() <= 15 / 65535 / 2 + 1e-6
    assert encoding.decode_range16(np.zeros(1, np.uint16), 15.0).item() == 0.0


def test_range16_takes_the_float32_of_its_own_limit():
    """float32(0.1) is more than 0.1, but it is the limit that the renderer used."""
    assert encoding.encode_range16(np.array([0.1], np.float32), 0.1).tolist() == [65535]


# --- filters ---


def maps(depth):
    """Depth, index and state maps of a depth picture; indices count the pixels."""
    depth = np.array(depth, dtype=np.float32)
    index = np.where(depth > 0, np.arange(depth.size).reshape(depth.shape), -1).astype(np.int32)
    return depth, index, filters.measured_state(depth)


def test_window_of_side_10_leans_left_and_up():
    rows, cols = filters.window(20, 30, 10, 100, 100)
    assert (cols.start, cols.stop - 1) == (15, 24)
    assert (rows.start, rows.stop - 1) == (25, 34)
    assert filters.window(0, 99, 3, 100, 100) == (slice(98, 100), slice(0, 2))
    assert filters.window(4, 5, 1, 100, 100) == (slice(5, 6), slice(4, 5))


def test_even_window_leans_as_that_of_opencv():
    """The window reads u - 5 .. u + 4, so a single pixel grows to u - 4 .. u + 5."""
    image = np.zeros((30, 30), np.uint16)
    image[15, 14] = 7
    rows, cols = np.nonzero(cv2.dilate(image, np.ones((10, 10), np.uint8)))
    assert (cols.min(), cols.max(), rows.min(), rows.max()) == (10, 19, 11, 20)


@pytest.mark.parametrize("side", [1, 2, 3, 4, 5, 10, 11])
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (8, 1), (5, 7), (13, 12), (24, 20)])
def test_paper_dilation_is_that_of_opencv(shape, side):
    rng = np.random.default_rng([7, side, *shape])
    image = rng.integers(1, 65536, shape).astype(np.uint16)
    image[rng.random(shape) < 0.9] = 0
    depth, _, state = filters.dilate(*maps(image), side=side)
    expected = cv2.dilate(image, np.ones((side, side), np.uint8))
    np.testing.assert_array_equal(depth, expected)
    np.testing.assert_array_equal(state != filters.EMPTY, expected > 0)


@pytest.mark.parametrize("side", [3, 10])
def test_paper_dilation_commutes_with_the_encoding(side):
    """Growing metres and encoding them is dilating the 16-bit image, as the paper does."""
    rng = np.random.default_rng(8)
    metres = rng.uniform(0.01, 15, (25, 30)) * (rng.random((25, 30)) < 0.1)
    depth, index, state = maps(metres)
    grown, _, _ = filters.dilate(depth, index, state, side=side)
    np.testing.assert_array_equal(
        encoding.encode_range16(grown, 15.0),
        cv2.dilate(encoding.encode_range16(depth, 15.0), np.ones((side, side), np.uint8)),
    )


def test_nearest_dilation_is_an_erosion_over_what_is_not_empty():
    rng = np.random.default_rng(9)
    image = (rng.integers(1, 60000, (18, 15)) * (rng.random((18, 15)) < 0.1)).astype(np.uint16)
    depth, _, _ = filters.dilate(*maps(image), side=4, grow="nearest")
    eroded = cv2.erode(
        np.where(image > 0, image, 65535).astype(np.uint16), np.ones((4, 4), np.uint8)
    )
    np.testing.assert_array_equal(depth, np.where(eroded == 65535, 0, eroded))


def test_dilation_by_hand():
    depth, index, state = maps([[2, 0, 5, 0, 0, 0, 0]])
    state[0, 5] = filters.ERASED
    grown = filters.dilate(depth, index, state, side=3)
    assert grown[0].tolist() == [[2, 5, 5, 5, 0, 0, 0]]
    assert grown[1].tolist() == [[0, 2, 2, 2, -1, -1, -1]]
    assert grown[2].tolist() == [[1, 2, 1, 2, 0, 3, 0]]  # ERASED stays where nothing grows into it
    grown = filters.dilate(depth, index, state, side=3, grow="nearest")
    assert grown[0].tolist() == [[2, 2, 5, 5, 0, 0, 0]]
    assert grown[1].tolist() == [[0, 0, 2, 2, -1, -1, -1]]
    assert depth.tolist() == [[2, 0, 5, 0, 0, 0, 0]]  # the input is left alone


def test_dilation_replaces_a_measured_pixel():
    depth, index, state = maps([[2, 5]])
    assert [m.tolist() for m in filters.dilate(depth, index, state, side=3)] == [
        [[5, 5]],
        [[1, 1]],
        [[filters.FILLED, filters.MEASURED]],
    ]


@pytest.mark.parametrize("grow", ["paper", "nearest"])
def test_dilation_gives_a_tie_to_the_lowest_index(grow):
    depth = np.array([[4, 0, 4]], np.float32)
    index = np.array([[9, -1, 3]], np.int32)
    grown = filters.dilate(depth, index, filters.measured_state(depth), side=3, grow=grow)
    assert grown[1].tolist() == [[9, 3, 3]]  # the first window does not reach index 3
    grown = filters.dilate(depth, index, filters.measured_state(depth), side=5, grow=grow)
    assert grown[1].tolist() == [[3, 3, 3]]
    assert grown[2].tolist() == [[filters.FILLED, filters.FILLED, filters.MEASURED]]


def test_dilation_refills_an_erased_pixel():
    depth, index, state = maps([[3, 0]])
    state[0, 1] = filters.ERASED
    assert filters.dilate(depth, index, state, side=3)[2].tolist() == [[1, filters.FILLED]]


def test_unknown_growth_is_refused():
    with pytest.raises(ValueError, match="farthest"):
        filters.dilate(*maps([[1]]), grow="farthest")


def test_erase_by_hand():
    """Strictly more than the threshold, and only a nearer neighbour erases."""
    depth, index, state = maps([[1.0, 1.5, 1.75, 0.0, 9.0]])
    erased = filters.erase(depth, index, state, side=3, threshold=0.5)
    assert erased[0].tolist() == [[1.0, 1.5, 1.75, 0.0, 9.0]]
    erased = filters.erase(depth, index, state, side=5, threshold=0.5)
    assert erased[0].tolist() == [[1.0, 1.5, 0.0, 0.0, 0.0]]
    assert erased[1].tolist() == [[0, 1, -1, -1, -1]]
    assert erased[2].tolist() == [[1, 1, 3, 0, 3]]
    assert depth.tolist() == [[1.0, 1.5, 1.75, 0.0, 9.0]]


def test_erase_reads_the_map_as_it_was():
    """The middle pixel goes, and still erases the last one."""
    depth, index, state = maps([[1, 2, 3]])
    assert filters.erase(depth, index, state, side=3)[0].tolist() == [[1, 0, 0]]


def test_erase_window_leans_left():
    """Side 2 reads columns u - 1 and u: a nearer pixel to the right is not seen."""
    assert filters.erase(*maps([[1, 9]]), side=2)[0].tolist() == [[1, 0]]
    assert filters.erase(*maps([[9, 1]]), side=2)[0].tolist() == [[9, 1]]
    assert filters.erase(*maps([[1], [9]]), side=2)[0].tolist() == [[1], [0]]


def test_erase_difference_is_float32():
    """1.3 - 1.0 is 0.29999995 in float32: not more than float32(0.3)."""
    depth, index, state = maps([[1.0, 1.3]])
    assert filters.erase(depth, index, state, side=3, threshold=0.3)[0][0, 1] > 0
    just_less = float(np.nextafter(np.float32(1.3) - np.float32(1.0), np.float32(0)))
    assert filters.erase(depth, index, state, side=3, threshold=just_less)[0][0, 1] == 0
