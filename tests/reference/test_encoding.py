"""The reference's 16-bit encoding, by hand and back again."""

from __future__ import annotations

import numpy as np

from tests.reference import (
    encoding,
)


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
