"""Point clouds: what is accepted, what is refused, and selecting points with their attributes."""

from __future__ import annotations

import math

import numpy as np
import pytest

import depthwarp as dw
from depthwarp.cloud import MAX_POINTS, to_float32_points
from depthwarp.errors import InputError

POINTS = np.arange(15, dtype=np.float32).reshape(5, 3)


def test_points_and_attributes_are_kept():
    """float32 points without a copy; attributes by name, in order, with their dtype."""
    attributes = {
        "color": np.arange(15, dtype=np.uint8).reshape(5, 3),
        "ring": np.arange(5, dtype=np.uint16),
        "label": np.array(["a", "b", "c", "d", "e"]),
    }
    cloud = dw.PointCloud(POINTS, attributes)
    assert len(cloud) == 5
    assert np.shares_memory(cloud.points_world, POINTS)
    assert list(cloud.attributes) == ["color", "ring", "label"]
    for name, values in attributes.items():
        assert cloud.attributes[name].dtype == values.dtype
        np.testing.assert_array_equal(cloud.attributes[name], values)


def test_attributes_may_be_lists():
    """They become arrays."""
    cloud = dw.PointCloud(POINTS, {"ring": [1, 2, 3, 4, 5]})
    assert cloud.attributes["ring"].tolist() == [1, 2, 3, 4, 5]


def test_any_layout_of_memory_becomes_rows():
    """Columns, slices and reversed views: C-contiguous float32, the same numbers."""
    large = np.arange(60, dtype=np.float32).reshape(10, 6)
    for points in (large[::2, 1:4], np.asfortranarray(POINTS), POINTS[::-1]):
        cloud = dw.PointCloud(points)
        assert cloud.points_world.flags.c_contiguous
        np.testing.assert_array_equal(cloud.points_world, points)


def test_float64_points_are_rounded():
    """Room-sized coordinates lose less than a micrometre; NaN and infinities are kept."""
    points = np.array([[0.1, -20.3, 3.0], [math.nan, math.inf, -math.inf]])
    cloud = dw.PointCloud(points)
    assert cloud.points_world.dtype == np.float32
    np.testing.assert_array_equal(cloud.points_world, points.astype(np.float32))


def test_map_coordinates_are_refused():
    """float32 would move a UTM coordinate by centimetres: the message says so, and the remedy."""
    with pytest.raises(InputError, match=r"would move a point by 0\.\d+ m; subtract an offset"):
        dw.PointCloud(np.array([[0.0, 0.0, 0.0], [500_000.123, 5_400_000.456, 80.0]]))
    with pytest.raises(InputError, match="move a point by inf"):
        dw.PointCloud(np.array([[1e300, 0.0, 0.0]]))
    assert len(dw.PointCloud(np.array([[500_000.0, 5_400_000.0, 80.0]]))) == 1  # these are exact


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((4, 2), np.float32),
        np.zeros((3, 4), np.float32),
        np.zeros(3, np.float32),
        np.zeros((2, 2, 3), np.float32),
        np.float32(1),
        [],
    ],
    ids=str,
)
def test_points_of_another_shape_are_refused(points):
    """(N, 3); the message gives the shape."""
    with pytest.raises(InputError, match=r"points_world must have shape \(N, 3\), got"):
        dw.PointCloud(points)


@pytest.mark.parametrize("dtype", [np.int32, np.float16, np.complex128, np.uint8, object, bool])
def test_points_of_another_type_are_refused(dtype):
    """float32 or float64, never a silent conversion; the message gives the type."""
    with pytest.raises(InputError, match="must be float32 or float64, got"):
        dw.PointCloud(np.zeros((4, 3), dtype))


def test_more_points_than_an_index_can_count_are_refused():
    """The winner index is int32. A view of one point, repeated, costs no memory."""
    many = np.broadcast_to(np.zeros((1, 3), np.float32), (MAX_POINTS + 1, 3))
    with pytest.raises(InputError, match="split it"):
        to_float32_points(many)


@pytest.mark.parametrize("values", [np.zeros(4), np.zeros(6), np.zeros((3, 5)), np.float32(1)])
def test_an_attribute_of_another_length_is_refused(values):
    """One row a point; the message names the attribute and both numbers."""
    with pytest.raises(InputError, match=r"attribute 'ring' must have 5 rows.*got shape"):
        dw.PointCloud(POINTS, {"ring": values})


def test_an_attribute_called_points_is_refused():
    """The file formats keep the coordinates under that name."""
    with pytest.raises(InputError, match="'points' is taken"):
        dw.PointCloud(POINTS, {"points": np.zeros(5)})


def test_selecting_keeps_attributes():
    """By mask, by index array and by slice: the points with their rows."""
    cloud = dw.PointCloud(POINTS, {"ring": np.arange(5), "color": np.arange(15).reshape(5, 3)})
    for selection in (cloud.attributes["ring"] > 2, np.array([4, 0, 0]), slice(1, None, 2)):
        part = cloud[selection]
        np.testing.assert_array_equal(part.points_world, POINTS[selection])
        np.testing.assert_array_equal(part.attributes["ring"], np.arange(5)[selection])
        np.testing.assert_array_equal(
            part.attributes["color"], cloud.attributes["color"][selection]
        )
    assert len(cloud[np.zeros(5, bool)]) == 0


def test_no_points_and_one_point():
    """Both are clouds."""
    assert len(dw.PointCloud(np.empty((0, 3), np.float32), {"ring": np.empty(0)})) == 0
    assert len(dw.PointCloud(np.ones((1, 3)))) == 1


def test_a_cloud_is_not_iterated():
    """A loop over rows of a cloud is a mistake; the message names the array."""
    with pytest.raises(TypeError, match="points_world"):
        iter(dw.PointCloud(POINTS))


def test_repr_is_short():
    """The number of points and the attributes' names, not the numbers."""
    assert repr(dw.PointCloud(POINTS)) == "PointCloud(5 points; no attributes)"
    cloud = dw.PointCloud(POINTS, {"ring": np.arange(5), "time": np.arange(5)})
    assert repr(cloud) == "PointCloud(5 points; ring, time)"
