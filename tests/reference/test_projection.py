"""The reference's two projections and its pixels, by hand and against each other."""

from __future__ import annotations

import numpy as np
import pytest

from tests.reference import (
    projection,
    segmentation,
)
from tests.reference.points import DTYPES, INF, NAN, columns


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
