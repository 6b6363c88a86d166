"""The paper's erase and dilation: the kernels against the loops, and dilation against OpenCV."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.checks import MAX_SIDE
from depthwarp.encodings import encode_depth, get_encoding
from depthwarp.errors import DeviceError, InputError
from tests.reference import filters as reference
from tests.rendering.strategies import seeds

SIDES = st.one_of(st.sampled_from([1, 2, 3, 10, 21]), st.integers(1, 21))
SHAPES = st.one_of(
    st.sampled_from([(1, 1), (1, 12), (12, 1), (2, 2)]),
    st.tuples(st.integers(1, 14), st.integers(1, 14)),
)
DENSITIES = st.sampled_from([0.0, 0.05, 0.3, 0.8, 1.0])
METHODS = ["paper", "nearest"]


def make_map(depth: np.ndarray, index=None, state=None, max_range: float = 15.0) -> dw.DepthMap:
    """A depth map of arrays; by default measured, with the pixels' numbers as winners."""
    depth = np.asarray(depth, np.float32)
    drawn = depth > 0
    if index is None:
        index = np.where(drawn, np.arange(depth.size).reshape(depth.shape), -1)
    if state is None:
        state = np.where(drawn, dw.State.MEASURED, dw.State.EMPTY)
    camera = dw.PinholeCamera.from_fov((60, 45), depth.shape[::-1])
    count = int(drawn.sum())
    stats = dw.RenderStats(count, 0, 0, 0, 0, 0, 0, count)
    return dw.DepthMap(
        depth,
        np.asarray(index, np.int32),
        np.asarray(state, np.uint8),
        camera,
        "range",
        0.0,
        max_range,
        stats,
    )


@st.composite
def depth_maps(draw: st.DrawFn) -> dw.DepthMap:
    """Maps of any size, empty to full, with ties of depth and index, and all four states."""
    shape = draw(SHAPES)
    rng = np.random.default_rng(draw(seeds))
    depth = rng.uniform(0.01, 15, shape)
    levels = draw(st.sampled_from([0, 2, 5]))
    if levels:  # few different depths: ties, and differences that repeat
        depth = rng.choice(rng.uniform(0.01, 15, levels), shape)
    drawn = rng.random(shape) < draw(DENSITIES)
    depth = np.where(drawn, depth, 0).astype(np.float32)
    points = draw(st.sampled_from([3, 10**6]))
    index = np.where(drawn, rng.integers(0, points, shape), -1)
    state = np.where(
        drawn,
        rng.choice([dw.State.MEASURED, dw.State.FILLED], shape),
        rng.choice([dw.State.EMPTY, dw.State.ERASED], shape),
    )
    return make_map(depth, index, state)


@st.composite
def thresholds(draw: st.DrawFn, depth: np.ndarray) -> float:
    """Usual ones, and the exact float32 difference of two pixels with the floats beside it."""
    found = np.unique(depth[depth > 0])[:20]
    if len(found) < 2 or draw(st.booleans()):
        return draw(st.sampled_from([0.5, 1e-50, 1e-3, 3.0, 1e9]))
    near, far = sorted(draw(st.permutations(found.tolist()))[:2])
    difference = np.float32(far) - np.float32(near)
    way = draw(st.sampled_from([-np.inf, 0.0, np.inf]))
    return float(np.nextafter(difference, np.float32(way)) if way else difference)


def arrays_of(depth_map: dw.DepthMap):
    """The three maps, as the loops take and return them."""
    return depth_map.depth, depth_map.index, depth_map.state


def assert_maps(depth_map: dw.DepthMap, expected) -> None:
    """The same depth bits, winners and states."""
    depth, index, state = expected
    np.testing.assert_array_equal(depth_map.depth.view(np.uint32), depth.view(np.uint32))
    np.testing.assert_array_equal(depth_map.index, index)
    np.testing.assert_array_equal(depth_map.state, state)
    for ours, theirs in zip(arrays_of(depth_map), expected, strict=True):
        assert ours.dtype == theirs.dtype and ours.shape == theirs.shape


# --- kernel == loop ---


@given(data=st.data(), depth_map=depth_maps(), side=SIDES)
def test_erase_is_the_loop(device, data, depth_map, side):
    """Any map, side and threshold, the difference of two pixels included: the very same maps."""
    threshold = data.draw(thresholds(depth_map.depth))
    step = dw.filters.remove_hidden("paper", side=side, threshold=threshold)
    erased = dw.filters.apply(depth_map, [step], device=device)
    assert_maps(erased, reference.erase(*arrays_of(depth_map), side=side, threshold=threshold))


@pytest.mark.parametrize("method", METHODS)
@given(depth_map=depth_maps(), side=SIDES)
def test_dilation_is_the_loop(device, method, depth_map, side):
    """Either surface grows as the loop lets it; ties go to the lowest index; states are kept."""
    grown = dw.filters.apply(depth_map, [dw.filters.dilate(method, side=side)], device=device)
    assert_maps(grown, reference.dilate(*arrays_of(depth_map), side=side, grow=method))


@given(depth_map=depth_maps(), side=SIDES)
def test_dilation_is_that_of_opencv_on_the_16_bit_image(device, depth_map, side):
    """Growing metres and encoding them is `cv2.dilate` with its default anchor, as in the paper."""
    encoding = get_encoding("range16", 15.0)
    grown = dw.filters.apply(depth_map, [dw.filters.dilate(side=side)], device=device)
    np.testing.assert_array_equal(
        encode_depth(grown.depth, encoding, device=device),
        cv2.dilate(
            encode_depth(depth_map.depth, encoding, device=device),
            np.ones((side, side), np.uint8),
        ),
    )


@pytest.mark.parametrize("seed", range(3))
def test_the_papers_chain_on_a_rendered_map(device, seed):
    """`filters=paper()` on a cloud is the loops' erase, then their dilation, on the plain map."""
    rng = np.random.default_rng(seed)
    wall = np.stack([np.full(1500, 6.0), *rng.uniform(-4, 4, (2, 1500))], axis=1)
    table = np.stack([rng.uniform(2, 2.2, 900), *rng.uniform(-0.7, 0.7, (2, 900))], axis=1)
    cloud = dw.PointCloud(np.concatenate([wall, table]))
    view = dw.RangeView((0, 0, 0), (0, 0, 0), (60, 50), q_line=0.05, q_depth_map=0.1)
    plain = dw.render(cloud, view, device=device)
    expected = reference.dilate(*reference.erase(*arrays_of(plain)))
    filtered = dw.render(cloud, view, filters=dw.filters.paper(), device=device)
    assert_maps(filtered, expected)
    assert_maps(dw.filters.apply(plain, dw.filters.paper(), device=device), expected)
    states = set(np.unique(filtered.state).tolist())
    assert {dw.State.MEASURED, dw.State.FILLED} <= states
    assert (reference.erase(*arrays_of(plain))[2] == dw.State.ERASED).sum() > 50
    # The counts tell of the splat, before the filters.
    assert filtered.stats == plain.stats
    assert plain.stats.drawn == (plain.state == dw.State.MEASURED).sum()


@given(data=st.data(), depth_map=depth_maps())
def test_a_chain_is_its_steps_one_after_the_other(device, data, depth_map):
    """Up to four filters in any order: the loops in that order, and `apply` step by step."""
    steps, expected, single = [], arrays_of(depth_map), depth_map
    for _ in range(data.draw(st.integers(0, 4))):
        side = data.draw(st.integers(1, 6))
        name = data.draw(st.sampled_from(["erase", *METHODS]))
        if name == "erase":
            steps.append(dw.filters.remove_hidden(side=side, threshold=1.0))
            expected = reference.erase(*expected, side=side, threshold=1.0)
        else:
            steps.append(dw.filters.dilate(name, side=side))
            expected = reference.dilate(*expected, side=side, grow=name)
        single = dw.filters.apply(single, steps[-1:], device=device)
    assert_maps(dw.filters.apply(depth_map, steps, device=device), expected)
    assert_maps(single, expected)


# --- by hand ---


def test_the_order_of_filters_matters(device):
    """Erase then dilate fills the hole with the far wall's neighbour; the other way it stays."""
    depth_map = make_map([[1.0, 9.0, 9.0]])
    erase, grow = dw.filters.remove_hidden(side=3), dw.filters.dilate(side=3)
    one = dw.filters.apply(depth_map, [erase, grow], device=device)
    other = dw.filters.apply(depth_map, [grow, erase], device=device)
    assert one.depth.tolist() == [[1, 9, 9]]
    assert one.state.tolist() == [[dw.State.MEASURED, dw.State.FILLED, dw.State.MEASURED]]
    assert other.depth.tolist() == [[9, 9, 9]]


def test_an_erased_pixel_says_so(device):
    """Depth 0, index -1, state ERASED; the nearer pixel stays as it was."""
    erased = dw.filters.apply(make_map([[2.0, 3.0]]), [dw.filters.remove_hidden()], device=device)
    assert erased.depth.tolist() == [[2, 0]]
    assert erased.index.tolist() == [[0, -1]]
    assert erased.state.tolist() == [[dw.State.MEASURED, dw.State.ERASED]]


def test_a_difference_of_exactly_the_threshold_stays(device):
    """Strictly more than the threshold is erased."""
    step = dw.filters.remove_hidden(threshold=0.5)
    stays = dw.filters.apply(make_map([[2.0, 2.5]]), [step], device=device)
    goes = dw.filters.apply(
        make_map([[2.0, np.nextafter(np.float32(2.5), np.float32(3))]]), [step], device=device
    )
    assert stays.depth.tolist() == [[2, 2.5]] and goes.depth.tolist() == [[2, 0]]


@pytest.mark.parametrize("side", [10, 9])
def test_the_window_leans_as_opencvs(device, side):
    """A single pixel reaches side // 2 - 1 (even) or side // 2 left and up, side // 2 right, down.

    A pixel's window runs from u - side // 2; so what one pixel grows to is the mirror image.
    """
    depth = np.zeros((31, 31))
    depth[15, 15] = 3.0
    grown = dw.filters.apply(make_map(depth), [dw.filters.dilate(side=side)], device=device)
    rows, columns = np.nonzero(grown.depth)
    low, high = 15 - (side - 1) // 2, 15 + side // 2
    assert (rows.min(), rows.max(), columns.min(), columns.max()) == (low, high, low, high)
    assert len(rows) == side * side and (grown.index[grown.depth > 0] == 15 * 31 + 15).all()

    depth = np.full((31, 31), 9.0)
    depth[15, 15] = 3.0
    erased = dw.filters.apply(make_map(depth), [dw.filters.remove_hidden(side=side)], device=device)
    gone = np.argwhere(erased.state == dw.State.ERASED)
    assert len(gone) == side * side - 1
    assert gone.min() == low and gone.max() == high


def test_the_papers_dilation_grows_the_farther_surface(device):
    """A near pixel beside a far one becomes far; with `nearest` it is the other way round."""
    depth_map = make_map([[2.0, 5.0, 0.0]])
    paper = dw.filters.apply(depth_map, [dw.filters.dilate("paper", side=3)], device=device)
    nearest = dw.filters.apply(depth_map, [dw.filters.dilate("nearest", side=3)], device=device)
    assert paper.depth.tolist() == [[5, 5, 5]] and paper.index.tolist() == [[1, 1, 1]]
    assert nearest.depth.tolist() == [[2, 2, 5]] and nearest.index.tolist() == [[0, 0, 1]]
    filled, measured = dw.State.FILLED, dw.State.MEASURED
    assert paper.state.tolist() == [[filled, measured, filled]]
    assert nearest.state.tolist() == [[measured, filled, filled]]


@pytest.mark.parametrize("method", METHODS)
def test_a_window_larger_than_the_map(device, method):
    """The largest side that is taken: one winner for the whole map."""
    depth_map = make_map(np.arange(1, 13).reshape(3, 4))
    grown = dw.filters.apply(depth_map, [dw.filters.dilate(method, side=MAX_SIDE)], device=device)
    assert set(grown.depth.ravel()) == {12.0 if method == "paper" else 1.0}
    erased = dw.filters.apply(depth_map, [dw.filters.remove_hidden(side=MAX_SIDE)], device=device)
    assert erased.depth.sum() == 1


def test_a_side_of_one_changes_nothing(device):
    """A window that holds only its pixel."""
    depth_map = make_map(np.random.default_rng(0).uniform(1, 9, (7, 5)))
    steps = [dw.filters.remove_hidden(side=1), *(dw.filters.dilate(m, side=1) for m in METHODS)]
    assert_maps(dw.filters.apply(depth_map, steps, device=device), arrays_of(depth_map))


def test_the_papers_chain_has_the_papers_numbers():
    """10 px and 0.5 m, then 10 px."""
    erase, grow = dw.filters.paper()
    assert (erase.side, erase.threshold) == (10, 0.5)
    assert (grow.method, grow.side) == ("paper", 10)
    assert (erase, grow) == (dw.filters.remove_hidden(), dw.filters.dilate())


# --- what apply promises ---


@given(depth_map=depth_maps())
def test_apply_leaves_its_input_unchanged(device, depth_map):
    """A new map of its own memory, also without any filter; camera, bounds and counts as before."""
    before = [array.copy() for array in arrays_of(depth_map)]
    for steps in ([], dw.filters.paper()):
        result = dw.filters.apply(depth_map, steps, device=device)
        for ours, theirs, old in zip(arrays_of(result), arrays_of(depth_map), before, strict=True):
            assert not np.shares_memory(ours, theirs)
            np.testing.assert_array_equal(theirs, old)
        assert result.camera == depth_map.camera and result.stats == depth_map.stats
        assert (result.kind, result.max_range) == (depth_map.kind, depth_map.max_range)


def test_an_erased_map_keeps_its_empty_pixels(device):
    """A map without a point comes back as it was."""
    depth_map = make_map(np.zeros((4, 5)))
    filtered = dw.filters.apply(depth_map, dw.filters.paper(), device=device)
    assert_maps(filtered, arrays_of(depth_map))


# --- bad input ---


@pytest.mark.parametrize("side", [0, -1, 1.5, MAX_SIDE + 1, 10**12, math.nan, math.inf, "ten"])
def test_a_side_that_is_no_whole_number_of_pixels_is_refused(side):
    """From 1 to about a million; the message gives the limits and the value."""
    for make in (dw.filters.remove_hidden, dw.filters.dilate):
        with pytest.raises(InputError, match=f"^side must be a whole number.*got {side}"):
            make(side=side)


@pytest.mark.parametrize("threshold", [0.0, -0.5, math.nan, math.inf])
def test_a_threshold_that_is_not_positive_is_refused(threshold):
    """A finite number above zero."""
    with pytest.raises(InputError, match="^threshold must be"):
        dw.filters.remove_hidden(threshold=threshold)


def test_an_unknown_method_is_refused():
    """The message lists the methods."""
    with pytest.raises(
        InputError, match="method must be one of 'paper', 'surround', 'cone', got 'density'"
    ):
        dw.filters.remove_hidden("density")
    with pytest.raises(InputError, match="method must be one of 'paper', 'nearest', got 'far'"):
        dw.filters.dilate("far")


def test_a_device_that_is_not_there_is_refused():
    """As in rendering."""
    with pytest.raises(DeviceError, match="cuda:99"):
        dw.filters.apply(make_map([[1.0]]), [], device="cuda:99")
