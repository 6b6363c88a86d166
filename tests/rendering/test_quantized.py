"""Quantized clouds: each coordinate within the bound, in as few bytes as that allows."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.errors import InputError
from depthwarp_kernels.point_source import BLOCK
from tests.cameras.models import IDENTITY
from tests.rendering.clumps import clumps
from tests.rendering.quantizing import BOUNDS, assert_quantized, planes_of, three_kinds
from tests.rendering.test_prepared import room


def decoded(chunks: dw.PreparedCloud) -> np.ndarray:
    """The finite points in the order of the blocks, from the words: the NumPy twin, float32."""
    source = chunks.source
    first, second, third = (
        words.numpy().reshape(-1, BLOCK) for words in (source.first, source.second, source.third)
    )
    blocks = []
    for block, box in enumerate(source.boxes.numpy()):
        word, more = first[block], second[min(box["second"], len(second) - 1)]
        if box["planes"] == 1:
            steps = [word >> shift & 1023 for shift in (0, 10, 20)]
        elif box["planes"] == 2:
            low, high = 2**21 - 1, 2**32 - 2**21
            steps = [word & low, more & low, word >> 21 | (more & high) >> 10]
        else:
            blocks.append(np.stack([word, more, third[box["third"]]], axis=1).view(np.float32))
            continue
        grid = np.stack(steps, axis=1).astype(np.float32)
        blocks.append(box["low"] + grid * box["step"])
    return np.concatenate([np.zeros((0, 3), np.float32), *blocks])[: chunks.finite]


# --- the bound ---


@settings(max_examples=60)
@given(data=st.data())
def test_every_coordinate_keeps_the_bound(data):
    """Clumps of every size and place, flat ones, single points, from 1e-30 m to where floats end.

    A NumPy twin reads the same points from the words, and each block's sphere holds them.
    """
    points = data.draw(clumps(IDENTITY))
    chunks = assert_quantized(points, data.draw(st.sampled_from(BOUNDS)))
    rows = chunks.source.original.numpy()[: chunks.finite]
    drawn = chunks.points_world()[rows]
    with np.errstate(over="ignore", under="ignore"):
        np.testing.assert_array_equal(decoded(chunks).view(np.uint32), drawn.view(np.uint32))
    for block, (*center, radius) in enumerate(chunks.source.spheres.numpy().astype(np.float64)):
        part = drawn[block * BLOCK : (block + 1) * BLOCK].astype(np.float64)
        # Squares of less than 1e-19 m are 0 in float32; culling adds more than that.
        assert np.sqrt(((part - center) ** 2).sum(axis=1)).max() <= radius + 1e-18


@settings(max_examples=30)
@given(
    offset=st.sampled_from([0.0, 1e3, 5e5, 5e6, 1e8]),
    size=st.sampled_from([0.0, 0.5, 30.0, 4e3, 1e5]),
    max_error=st.sampled_from(BOUNDS),
    seed=st.integers(0, 99),
)
def test_blocks_far_from_the_origin(offset, size, max_error, seed):
    """Map coordinates, where neighbouring float32 lie up to 8 m apart: all rounding counts."""
    rng = np.random.default_rng(seed)
    shift = np.array([offset, -0.7 * offset, 0.1 * offset])
    points = (rng.uniform(-0.5, 0.5, (3 * BLOCK, 3)) * size + shift).astype(np.float32)
    assert_quantized(points, max_error)


@pytest.mark.parametrize("axes", [(0,), (1, 2), (0, 1, 2)])
@pytest.mark.parametrize("value", [0.0, -0.0, 1.7, 4_649_776.5])
def test_flat_blocks_are_exact_across_themselves(axes, value):
    """A wall has no extent on an axis: that coordinate is kept whatever the bound is."""
    points = np.abs(room(1024)) + np.float32(0.5)
    points[:, list(axes)] = value
    chunks = assert_quantized(points, 0.01)
    np.testing.assert_array_equal(chunks.points_world()[:, list(axes)], points[:, list(axes)])
    assert chunks.bytes_per_point == 4


@settings(max_examples=30)
@given(side=st.floats(1e-3, 1e5), offset=st.sampled_from([0.0, 10.0, 1e4]), seed=st.integers(0, 99))
def test_blocks_take_as_few_bytes_as_their_size_allows(side, offset, seed):
    """4 bytes while half a step of 1/1023 of the block is safely within the bound, 8 of 1/2^21."""
    rng = np.random.default_rng(seed)
    points = (rng.uniform(0, side, (4 * BLOCK, 3)) + offset).astype(np.float32)
    chunks = assert_quantized(points, 0.001)
    inner = chunks.points_world()[chunks.source.original.numpy()].reshape(-1, BLOCK, 3)
    half = np.ptp(inner, axis=1).max(axis=1).astype(np.float64) / 2
    rounding = 4 * np.spacing(np.abs(points).max())
    planes = planes_of(chunks)
    assert (planes[1.01 * half / 1023 + rounding < 0.001] == 1).all()
    assert (planes[1.01 * half / (2**21 - 1) + rounding < 0.001] <= 2).all()
    # Not fewer either: the points are many and random, so some lie in the middle of a step.
    assert (planes[0.9 * half / 1023 - rounding > 0.001] > 1).all()


@settings(max_examples=60)
@given(ratio=st.floats(0.98, 1.02), kind=st.sampled_from([1, 2]), seed=st.integers(0, 9999))
def test_blocks_about_as_long_as_a_bound_allows(ratio, kind, seed):
    """One axis of a block decides alone, by a hair: the bound holds on either side.

    Steps of 21 bits are so fine that float32 adds up to a quarter to half of one.
    """
    rng = np.random.default_rng(seed)
    half_step = rng.choice([1e-4, 0.001, 0.3])
    steps, rounding = {1: (1023, 1.01), 2: (2**21 - 1, 1.3)}[kind]
    sides = rng.permutation([2 * half_step * steps, half_step, 0.0])
    points = (rng.uniform(0, 1, (BLOCK, 3)) * sides).astype(np.float32)
    points[0], points[1] = 0, sides
    assert planes_of(assert_quantized(points, rounding * half_step)).tolist() == [kind]
    assert planes_of(assert_quantized(points, 0.95 * half_step)).tolist() == [kind + 1]
    assert_quantized(points, ratio * half_step)


@pytest.mark.parametrize(("max_error", "planes"), [(0.5 + 1e-6, 1), (0.5 - 1e-12, 2)])
def test_a_bound_between_two_float32(max_error, planes):
    """A point in the middle of a step moves by exactly half of it, to the last bit of a bound."""
    points = np.zeros((BLOCK, 3), np.float32)
    points[:, 1] = np.linspace(0, 1023, BLOCK)
    points[7, 1] = 100.5
    chunks = assert_quantized(points, max_error)
    assert planes_of(chunks).tolist() == [planes]


# --- what it says and refuses ---


def test_without_a_bound_nothing_is_lost():
    """The default keeps all bits, and gives them back in the caller's order."""
    points = three_kinds()
    chunks = dw.PointCloud(points).prepare(device="cpu")
    finite = np.isfinite(points).all(axis=1)
    drawn = chunks.points_world()
    np.testing.assert_array_equal(drawn[finite].view(np.uint32), points[finite].view(np.uint32))
    assert np.isnan(drawn[~finite]).all()
    assert chunks.max_error is None and chunks.bytes_per_point == 12


def test_it_says_how_many_bytes_a_point_takes():
    """Three blocks in 4 bytes and a part of one in 12; the words take no more than that."""
    chunks = dw.PointCloud(room(3 * BLOCK + 1)).prepare(device="cpu", max_error=0.05)
    assert repr(chunks) == "PreparedCloud(1537 points in 4 blocks, 6.0 bytes a point, on cpu)"
    assert chunks.max_error == 0.05
    words = (chunks.source.first, chunks.source.second, chunks.source.third)
    assert sum(array.size for array in words) * 4 == 6 * 4 * BLOCK


@pytest.mark.parametrize("value", [0.0, -1e-3, math.nan, math.inf, "x", [0.1], True])
def test_a_bound_that_is_none_is_refused(value):
    """A number above 0 and finite; `None`, not 0, is the word for exact."""
    with pytest.raises(InputError, match="max_error must be a finite number above 0 m, got"):
        dw.PointCloud(room(3)).prepare(device="cpu", max_error=value)


def test_packing_uses_all_cores_alike(monkeypatch):
    """The same words whatever number of threads packs them."""
    made = []
    for cores in (1, 2, 5):
        monkeypatch.setattr("depthwarp.prepared.launching.usable_cores", lambda cores=cores: cores)
        made.append(dw.PointCloud(three_kinds()).prepare(device="cpu", max_error=1e-4).source)
    for other in made[1:]:
        for name in ("first", "second", "third", "spheres"):
            ours, theirs = getattr(other, name).numpy(), getattr(made[0], name).numpy()
            np.testing.assert_array_equal(ours.view(np.uint32), theirs.view(np.uint32))
