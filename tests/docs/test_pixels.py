"""The sentences of `docs/conventions.md` under "Pixels"."""

from __future__ import annotations

import numpy as np
import pytest

import depthwarp as dw
from tests.docs.sentences import (
    ORIGIN,
    SQUARE,
    drawn,
    pixel,
    says,
)


@says("Column u grows to the right and row v grows downwards.")
def test_directions_of_pixels():
    """A point to the right and below has a larger u and v than the axis."""
    u, v = pixel(SQUARE, (2, -0.2, -0.4))
    assert u > 5 and v > 5


@says("Pixel centres are at whole numbers: the centre of the upper left pixel is (0, 0).")
def test_pixel_centres():
    """The ray of (0, 0) falls into the middle of the first pixel."""
    ray = SQUARE.directions(0, 0)
    depth_map = drawn(SQUARE, tuple(2 * ray))
    assert depth_map.depth[0, 0] == pytest.approx(2)
    corner = dw.PinholeCamera.from_fov((90, 90), (11, 11))
    assert corner.cx == 5 and corner.directions(5, 5).tolist() == [1, 0, 0]


@says("An image spans u from -0.5, which is inside, to width - 0.5, which is outside.")
def test_span():
    """Points on both borders."""
    camera = dw.PinholeCamera(1.0, 1.0, 0.0, 0.0, 3, 1, ORIGIN)
    valid = camera.project(np.array([[1, 0.5, 0], [1, -2.5, 0], [1, -2.4999, 0]]))[3]
    assert valid.tolist() == [True, False, True]


@says("A point falls into the pixel (floor(u + 0.5), floor(v + 0.5)).")
def test_rounding():
    """Halves go up, also where rounding to even would not."""
    camera = dw.PinholeCamera(1.0, 1.0, 0.0, 0.0, 4, 4, ORIGIN)
    depth_map = drawn(camera, (1, -0.5, -1.5))
    assert np.argwhere(depth_map.depth).tolist() == [[2, 1]]


@says("Arrays are indexed [row, column] and have the shape (height, width).")
def test_arrays():
    """A wide image; a point at the right border."""
    camera = dw.PinholeCamera(2.0, 2.0, 3.0, 1.0, 7, 3, ORIGIN)
    depth_map = drawn(camera, (1, -1.5, 0))
    assert depth_map.depth.shape == depth_map.index.shape == depth_map.state.shape == (3, 7)
    assert depth_map.depth[1, 6] > 0


@says("Sizes are (width, height).")
def test_sizes():
    """As OpenCV has them."""
    camera = dw.PinholeCamera.from_fov((60, 45), (7, 3))
    assert camera.size == (7, 3) == (camera.width, camera.height)
