"""Depth as 16-bit numbers: the kernel against the reference, the other encodings by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from depthwarp.encodings import Encoding, decode_depth, encode_depth, get_encoding
from depthwarp.errors import InputError
from tests.reference import encoding as reference
from tests.rendering.strategies import seeds

MAX_RANGES = st.one_of(st.sampled_from([15.0, 0.1, 65535.0, 1e-3, 120.0]), st.floats(1e-3, 1e4))


def encode(depth, name, device, max_range: float = 15.0) -> list[int]:
    """The numbers of a row of depths."""
    depth = np.array([depth], np.float32)
    return encode_depth(depth, get_encoding(name, max_range), device=device)[0].tolist()


@given(seed=seeds, max_range=MAX_RANGES)
def test_range16_is_the_references(device, seed, max_range):
    """The paper's quantization: the same integers, for depths anywhere, at 0 and at the limit."""
    rng = np.random.default_rng(seed)
    limit = np.float32(max_range)
    depth = rng.uniform(0, limit, (20, 15)).astype(np.float32)
    depth[depth > limit] = limit
    # Halves between two integers, and the floats beside them.
    halves = ((rng.integers(0, 65535, 100) + 0.5) / 65535 * max_range).astype(np.float32)
    depth.ravel()[:100] = np.nextafter(halves, rng.choice(np.float32([0, 1e9]), 100))
    depth.ravel()[100:150] = halves[:50]
    depth.ravel()[150:170] = limit * np.float32(1e-6)
    depth = np.minimum(depth, limit)
    depth[0], depth[1] = 0, limit
    values = encode_depth(depth, get_encoding("range16", max_range), device=device)
    assert values.dtype == np.uint16
    np.testing.assert_array_equal(values, reference.encode_range16(depth, max_range))
    np.testing.assert_array_equal(values == 0, depth == 0)


@given(seed=seeds)
def test_range16_is_the_references_on_halves(device, seed):
    """A full scale chosen so that a depth falls on k + 0.5: the order of operations decides."""
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.5, 10, (10, 1, 1)).astype(np.float32)
    for pixel, k in zip(depth, rng.integers(0, 65535, 10), strict=True):
        max_range = float(pixel[0, 0]) * 65535 / (k + 0.5)
        values = encode_depth(pixel, get_encoding("range16", max_range), device=device)
        np.testing.assert_array_equal(values, reference.encode_range16(pixel, max_range))


@pytest.mark.parametrize(("name", "factor"), [("millimetres", 1000.0), ("kitti", 256.0)])
@given(seed=seeds)
def test_the_usual_encodings_are_rounded_products(device, name, factor, seed):
    """round(depth * factor), halves to the even number, nothing that is not empty becomes 0."""
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0, 65535 / factor, (10, 10)).astype(np.float32)
    depth[0] = (rng.integers(0, 65000, 10) + 0.5) / factor
    depth[1] = 0
    expected = np.rint(depth.astype(np.float64) * factor)
    expected[(depth > 0) & (expected == 0)] = 1
    values = encode_depth(depth, get_encoding(name, 15.0), device=device)
    np.testing.assert_array_equal(values, expected.astype(np.uint16))


def test_encodings_by_hand(device):
    """Empty is 0, the smallest depth 1; 15 m, 65.535 m and 255.996 m are 65535."""
    assert encode([0, 15, 7.5, 1e-6, 3], "range16", device) == [0, 65535, 32768, 1, 13107]
    assert encode([0, 2, 0.25, 1e-6, 65.535], "millimetres", device) == [0, 2000, 250, 1, 65535]
    assert encode([0, 2, 0.25, 1e-6, 255.996], "kitti", device) == [0, 512, 64, 1, 65535]
    # Halves go to the even number: 1.5 / 256, 2.5 / 256 and 3.5 / 256 are exact floats.
    assert encode([1.5 / 256, 2.5 / 256, 3.5 / 256, 0.5 / 256], "kitti", device) == [2, 2, 4, 1]


def test_a_limit_that_float32_rounds_up_is_still_full_scale(device):
    """float32(0.1) is more than 0.1, but it is the limit that the renderer drew to."""
    assert encode([0.1], "range16", device, max_range=0.1) == [65535]


@pytest.mark.parametrize(
    ("name", "deep", "largest"),
    [("range16", 15.001, "15.000"), ("millimetres", 65.536, "65.535"), ("kitti", 256.0, "255.996")],
)
def test_a_depth_that_does_not_fit_is_an_error(device, name, deep, largest):
    """Never wrapped, never dropped: the message says the limit, how many pixels, and what to do."""
    depth = np.array([[1.0, deep, deep + 100, 0.0]], np.float32)
    with pytest.raises(InputError, match=f"'{name}'.*{largest} m, 2 pixels are farther.*max_range"):
        encode_depth(depth, get_encoding(name, 15.0), device=device)
    with pytest.raises(InputError, match="1 pixels"):
        encode_depth(np.array([[math.inf]], np.float32), get_encoding(name, 15.0), device=device)


@pytest.mark.parametrize("name", ["range16", "millimetres", "kitti"])
def test_decoding_comes_back_within_half_a_step(device, name):
    """And 0 comes back as 0."""
    encoding = get_encoding(name, 15.0)
    depth = np.linspace(0, 15, 5000, dtype=np.float32).reshape(50, 100)
    back = decode_depth(encode_depth(depth, encoding, device=device), encoding)
    assert back.dtype == np.float32 and back[0, 0] == 0
    step = encoding.divisor / encoding.factor
    assert np.abs(back - depth).max() <= step / 2 + 1e-6
    assert encoding.largest == pytest.approx(65535 * step)


def test_range16_decodes_as_the_reference():
    """image / 65535 * max_range, in float64, then float32."""
    values = np.arange(65536, dtype=np.uint16).reshape(256, 256)
    np.testing.assert_array_equal(
        decode_depth(values, get_encoding("range16", 15.0)), reference.decode_range16(values, 15.0)
    )


def test_any_layout_of_memory_is_encoded(device):
    """A part of a larger map, or a map in column order, gives the same numbers."""
    depth = np.random.default_rng(0).uniform(0, 15, (40, 60)).astype(np.float32)
    encoding = get_encoding("range16", 15.0)
    whole = encode_depth(depth, encoding, device=device)
    for part in (np.s_[::2, ::3], np.s_[5:20, 7:30]):
        np.testing.assert_array_equal(
            encode_depth(depth[part], encoding, device=device), whole[part]
        )
    in_columns = np.asfortranarray(depth)
    np.testing.assert_array_equal(encode_depth(in_columns, encoding, device=device), whole)


def test_an_unknown_encoding_is_refused():
    """The message lists the encodings."""
    with pytest.raises(InputError, match="'range16', 'millimetres', 'kitti', got 'inches'"):
        get_encoding("inches", 15.0)


@pytest.mark.parametrize("max_range", [math.inf, math.nan])
def test_range16_needs_a_range(max_range):
    """Without a largest depth there is no full scale; the others do not need one."""
    with pytest.raises(InputError, match="finite max_range"):
        get_encoding("range16", max_range)
    assert get_encoding("millimetres", max_range) == Encoding("millimetres", 1.0, 1000.0)
