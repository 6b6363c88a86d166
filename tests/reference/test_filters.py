"""The reference's dilation against cv2.dilate, and its erasing by hand."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from tests.reference import (
    encoding,
    filters,
)


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
