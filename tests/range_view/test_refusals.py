"""Views that have no depth plane, parameters out of range, and sizes beyond what is possible."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import depthwarp as dw
from depthwarp.errors import CapacityError, InputError
from depthwarp.range_view import MAX_LINES
from tests.range_view.views import PAPER


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
