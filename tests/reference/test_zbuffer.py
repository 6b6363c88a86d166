"""The reference's Z-buffer: depths, winners and counts small enough to check by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.reference import (
    projection,
    zbuffer,
)
from tests.reference.points import DTYPES, INF, NAN, columns


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
