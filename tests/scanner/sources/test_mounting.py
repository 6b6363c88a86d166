"""A rolled camera's pictures become upright, and a Bayer mosaic keeps its colours."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.frames import PixelFormat
from depthwarp.scanner.sources.mounting import (
    check_rotation,
    upright_format,
    upright_pixels,
    upright_size,
)
from tests.scanner.sources.pictures import BAYER, colourful, mosaic, upright

ROTATIONS = (0, 90, 180, 270)
SIZES = ((12, 10), (13, 10), (12, 11), (13, 11))  # even and odd, in all combinations


def test_a_rolled_camera_sees_up_sideways() -> None:
    """Rolled 90 degrees clockwise, the sensor's left edge is up: its pixels become row 0."""
    raw = np.array([[1, 2, 3], [4, 5, 6]], np.uint8)
    assert upright_pixels(raw, 90).tolist() == [[4, 1], [5, 2], [6, 3]]
    assert upright_pixels(raw, 180).tolist() == [[6, 5, 4], [3, 2, 1]]
    assert upright_pixels(raw, 270).tolist() == [[3, 6], [2, 5], [1, 4]]
    assert upright_size((3, 2), 90) == (2, 3)
    assert upright_size((3, 2), 180) == (3, 2)


@pytest.mark.parametrize("rotation", ROTATIONS)
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("pattern", BAYER)
def test_each_site_keeps_its_colour(
    pattern: PixelFormat, size: tuple[int, int], rotation: int
) -> None:
    """Turning the mosaic is the same as taking the mosaic, in the new pattern, of the turned."""
    bgr = colourful(*size)
    turned = upright_pixels(mosaic(bgr, pattern), rotation)
    renamed = upright_format(pattern, size, rotation)
    np.testing.assert_array_equal(turned, mosaic(upright(bgr, rotation), renamed))


@pytest.mark.parametrize("rotation", ROTATIONS)
@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("pattern", BAYER)
def test_demosaicing_commutes_with_the_turn(
    pattern: PixelFormat, size: tuple[int, int], rotation: int
) -> None:
    """OpenCV makes the same colours of a turned mosaic as of the raw one, away from borders."""
    raw = colourful(*size)[:, :, 0]
    renamed = upright_format(pattern, size, rotation)
    of_turned = cv2.demosaicing(upright_pixels(raw, rotation), _code(renamed))
    turned = upright(np.asarray(cv2.demosaicing(raw, _code(pattern)), np.uint8), rotation)
    np.testing.assert_array_equal(of_turned[2:-2, 2:-2], turned[2:-2, 2:-2])


def test_other_formats_keep_their_name() -> None:
    """Only Bayer formats depend on the turn; deep and coloured pictures are turned alike."""
    assert upright_format(PixelFormat.BGR, (3, 3), 90) is PixelFormat.BGR
    deep = np.arange(6, dtype=np.uint16).reshape(2, 3) * 10000
    assert upright_pixels(deep, 270).tolist() == np.rot90(deep, 1).tolist()
    assert upright_pixels(deep, 270).dtype == np.uint16
    bgr = colourful(5, 4)
    np.testing.assert_array_equal(upright_pixels(bgr, 90), upright(bgr, 90))


@pytest.mark.parametrize("rotation", [45, -90, 360, "90"])
def test_other_rotations_are_refused(rotation: int) -> None:
    """The message says what is possible and what was given."""
    with pytest.raises(InputError, match="must be 0, 90, 180 or 270 degrees"):
        check_rotation(rotation)


def _code(pattern: PixelFormat) -> int:
    letters = pattern.value.removeprefix("bayer_").upper()
    return int(getattr(cv2, f"COLOR_Bayer{letters}2BGR"))
