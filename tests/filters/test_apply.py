"""Filters on finished maps: batches, where results are written, and what is refused."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

import depthwarp as dw
from depthwarp.errors import InputError
from depthwarp.filters import applying
from tests.filters.maps import arrays_of, assert_maps, make_map, sparse

POSE = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))
LENSES = [
    dw.PinholeCamera.from_fov((60, 45), (40, 30)),
    dw.EquirectangularCamera(40, 30, POSE),
    dw.PinholeCamera.from_fov((60, 45), (24, 18)),
    dw.OrthographicCamera(0.01, 40, 30, POSE),
    dw.PinholeCamera.from_fov((20, 15), (24, 18)),
]
NAMES = ["a", "b", "c", "d", "e"]


def batch_of(share: float, names=None) -> dw.DepthMaps:
    """Two layers in the gaps of one another, through lenses of two sizes and several kinds."""
    rng = np.random.default_rng(8)
    maps = []
    for camera in LENSES:
        shape = camera.size[::-1]
        depth = np.where(rng.random(shape) < 0.5, 2.0, 5.0) + rng.normal(0, 0.01, shape)
        maps.append(sparse(make_map(depth, camera), share))
    return dw.DepthMaps(maps, names)


# --- batches ---


@pytest.mark.parametrize("chain", [dw.filters.best(), dw.filters.paper(), ()])
@pytest.mark.parametrize("tile_bytes", [1, 1 << 26])
def test_a_view_of_a_batch_is_as_alone(device, chain, tile_bytes, monkeypatch):
    """In order, of any sizes and lenses, with names and metadata; however many fit together."""
    monkeypatch.setattr(applying, "TILE_BYTES", tile_bytes)
    batch = batch_of(0.3, NAMES)
    before = [[array.copy() for array in arrays_of(one)] for one in batch]
    result = dw.filters.apply(batch, chain, device=device)
    assert isinstance(result, dw.DepthMaps) and result.names == tuple(NAMES)
    for ours, theirs, old in zip(result, batch, before, strict=True):
        alone = dw.filters.apply(theirs, chain, device=device)
        assert_maps(ours, arrays_of(alone))
        assert_maps(theirs, old)
        assert ours.camera is theirs.camera and ours.filters == alone.filters
        assert len(ours.filters) == len(chain)


def test_views_of_one_size_are_filtered_together(device):
    """One set of device maps for each size, in the order of the views, unless they take too much
    memory together."""

    class Counting:
        scratch_bytes = 0

        def __init__(self):
            self.shapes = []

        def build(self, maps):
            self.shapes.append(maps.depth.shape)
            assert maps.grids.shape == maps.depth.shape[:1]
            return lambda: None

    counting = Counting()
    dw.filters.apply(batch_of(0.3), [counting], device=device)
    assert sorted(counting.shapes) == [(2, 18, 24), (3, 30, 40)]


def test_views_of_a_batch_own_their_arrays(device):
    """To keep one view does not keep the memory of all."""
    result = dw.filters.apply(batch_of(0.3), dw.filters.best(), device=device)
    assert all(array.base is None for one in result for array in arrays_of(one))


def test_what_a_rendered_batch_gives_can_be_filtered(device):
    """The same as with filters at once; a batch without views stays one."""
    points = np.random.default_rng(9).uniform((2, -1, -1), (4, 1, 1), (3000, 3))
    cloud, rig = dw.PointCloud(points), dict(zip(NAMES, LENSES[:3], strict=False))
    plain = dw.render_batch(cloud, rig, device=device)
    expected = dw.render_batch(cloud, rig, filters=dw.filters.best(), device=device)
    result = dw.filters.apply(plain, dw.filters.best(), device=device)
    for ours, theirs in zip(result, expected, strict=True):
        assert_maps(ours, arrays_of(theirs))
        assert ours.filters == theirs.filters
    assert len(dw.filters.apply(plain[:0], dw.filters.best(), device=device)) == 0


# --- where results are written ---


def test_a_result_is_written_where_it_is_wanted(device):
    """Into the arrays of another map, or of the map itself; what does not fit is refused."""
    wall = sparse(make_map(np.full((60, 80), 4.0)), 0.3)
    expected = dw.filters.apply(wall, dw.filters.best(), device=device)
    out = make_map(np.zeros((60, 80)))
    result = dw.filters.apply(wall, dw.filters.best(), device=device, out=out)
    assert all(a is b for a, b in zip(arrays_of(result), arrays_of(out), strict=True))
    assert_maps(out, arrays_of(expected))
    assert result.filters == expected.filters and (wall.depth == 0).mean() > 0.6
    dw.filters.apply(wall, dw.filters.best(), device=device, out=wall)
    assert_maps(wall, arrays_of(expected))
    small = make_map(np.zeros((60, 79)))
    with pytest.raises(InputError, match=r"out.depth must be .* of shape \(60, 80\), got .*79"):
        dw.filters.apply(wall, dw.filters.best(), device=device, out=small)


def test_a_batch_is_written_where_it_is_wanted(device):
    """Into another batch, or the batch itself in another order; the metadata is in the result."""
    chain = dw.filters.best()
    batch = batch_of(0.3, NAMES)[:2]
    expected = dw.filters.apply(batch, chain, device=device)
    out = dw.DepthMaps([make_map(np.zeros((30, 40))) for _ in batch])
    for place in (out, dw.DepthMaps([batch[1], batch[0]])):
        result = dw.filters.apply(batch, chain, device=device, out=place)
        for ours, there, theirs in zip(result, place, expected, strict=True):
            assert all(a is b for a, b in zip(arrays_of(ours), arrays_of(there), strict=True))
            assert_maps(there, arrays_of(theirs))
            assert (ours.filters, there.filters) == (theirs.filters, ())
        assert result.names == ("a", "b")


def test_an_out_of_another_kind_is_refused():
    """A batch for a map, a map for a batch, another number of views, or no map; then nothing is
    written, nor when one view of several does not fit."""
    batch = batch_of(1.0)[:2]
    one, old = batch[0], batch.depth

    def refused(maps, out, message) -> None:
        with pytest.raises(InputError, match=message):
            dw.filters.apply(maps, dw.filters.paper(), out=out)

    refused(one, batch, "^out must be a dw.DepthMap as maps is, got DepthMaps$")
    refused(one, one.depth, "^out must be a dw.DepthMap as maps is, got ndarray$")
    refused(batch, one, "^out must be a dw.DepthMaps of 2 views as maps is, got DepthMap$")
    refused(batch, batch[:1], "^out must be a dw.DepthMaps of 2 views as maps is, got 1 views$")
    refused(batch, dw.DepthMaps([one, one]), r"^out\[0\].(\w+) and out\[1\].\1 share memory")
    rows = np.zeros((45, 40), np.float32)
    lower, upper = (replace(one, depth=rows[top : top + 30]) for top in (0, 15))
    own = replace(upper, index=one.index.copy(), state=one.state.copy())
    refused(batch, dw.DepthMaps([lower, own]), r"^out\[0\].depth and out\[1\].depth share memory")
    small = dw.DepthMaps([one, make_map(np.zeros((30, 39)))])
    refused(batch, small, r"^out\[1\].depth must be .* of shape \(30, 40\), got .*39")
    refused(one, replace(one, state=None), r"^out.state must be .* \(30, 40\), got None")
    read_only = make_map(np.zeros((30, 40)))
    read_only.index.flags.writeable = False
    refused(one, read_only, r"^out.index must be writable, .* got read-only int32")
    np.testing.assert_array_equal(batch.depth, old)


def test_a_chain_applied_twice_is_not_the_same_as_once(device):
    """What was filled counts as measured for the next removal."""
    chain = [dw.filters.remove_hidden(side=3), dw.filters.fill("nearest", radius=1)]
    once = dw.filters.apply(make_map([[2.0, 0.0, 0.0, 7.0]]), chain, device=device)
    assert once.depth.tolist() == [[2, 2, 7, 7]]
    twice = dw.filters.apply(once, chain, device=device)
    assert twice.depth.tolist() == [[2, 2, 2, 7]]
    assert twice.filters == (*once.filters, *once.filters)


def test_an_erased_pixel_that_is_filled_reads_as_filled(device):
    """The state tells what was done last, as its docstring says."""
    depth = np.full((9, 9), 2.0)
    depth[4, 4] = 7.0
    chain = [dw.filters.remove_hidden("surround"), dw.filters.fill()]
    erased = dw.filters.apply(make_map(depth), chain[:1], device=device)
    filled = dw.filters.apply(make_map(depth), chain, device=device)
    assert (erased.state[4, 4], filled.state[4, 4]) == (dw.State.ERASED, dw.State.FILLED)
    assert all(f"{state.name}: " in (dw.State.__doc__ or "") for state in dw.State)


# --- what is refused ---


@pytest.mark.parametrize("kind", ["ndarray", "list", "None"])
def test_what_is_no_map_is_refused(kind):
    """An array, a list of maps, nothing; the message says what to pass."""
    good = make_map(np.ones((4, 5)))
    maps = {"ndarray": good.depth, "list": [good, good], "None": None}[kind]
    with pytest.raises(InputError, match=f"^maps must be a dw.DepthMap .* got {kind}: pass what"):
        dw.filters.apply(maps, dw.filters.best())


@pytest.mark.parametrize("name", ["depth", "index", "state"])
def test_maps_without_an_array_are_refused(name):
    """None, or a list, where an array belongs; of a batch with the view's number or name."""
    good = make_map(np.ones((4, 5)))
    none = replace(good, **{name: None})
    with pytest.raises(InputError, match=rf"^{name} must be an array .*\(4, 5\), got None$"):
        dw.filters.apply(none, dw.filters.best())
    with pytest.raises(InputError, match=f"^{name} must be an array .*, got list$"):
        dw.filters.apply(replace(good, **{name: [[1]]}), dw.filters.best())
    for names, view in ((None, "1"), (["left", "right"], "'right'")):
        with pytest.raises(InputError, match=f"^view {view}: {name} must be an array"):
            dw.filters.apply(dw.DepthMaps([good, none], names), dw.filters.best())


@pytest.mark.parametrize("name", ["depth", "index", "state"])
def test_maps_of_another_size_are_refused(name):
    """A state map that does not fit its depth map, for one."""
    good = make_map(np.ones((4, 5)))
    bad = replace(good, **{name: getattr(good, name)[:3]})
    with pytest.raises(InputError, match=rf"^{name} must be an array .*\(4, 5\), got \(3, 5\)$"):
        dw.filters.apply(bad, dw.filters.best())


@pytest.mark.parametrize(
    ("name", "dtype", "message"),
    [
        ("depth", np.int32, r"^depth must be an array of floats \[m\], got int32$"),
        ("depth", np.complex64, r"^depth must be an array of floats \[m\], got complex64$"),
        ("depth", "U3", r"^depth must be an array of floats \[m\], got <U3$"),
        ("index", np.float64, "^index must be an array of integers, got float64$"),
        ("state", np.float32, "^state must be an array of integers, got float32$"),
        ("state", bool, "^state must be an array of integers, got bool$"),
    ],
)
def test_arrays_of_another_kind_are_refused(name, dtype, message):
    """Nothing is converted in silence."""
    good = make_map(np.ones((4, 5)))
    with pytest.raises(InputError, match=message):
        dw.filters.apply(replace(good, **{name: getattr(good, name).astype(dtype)}), [])


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("camera", None, "^camera must be a camera, got None$"),
        ("kind", "depth", "^kind must be one of 'range', 'z', got 'depth'$"),
    ],
)
def test_maps_that_say_nothing_of_their_lens_are_refused(name, value, message):
    """Filters need to know it; in a batch the message names the view."""
    bad = replace(make_map(np.ones((4, 5))), **{name: value})
    with pytest.raises(InputError, match=message):
        dw.filters.apply(bad, [])
    with pytest.raises(InputError, match="^view 1: must be a dw.DepthMap, got int$"):
        dw.filters.apply(dw.DepthMaps([make_map(np.ones((4, 5))), 7]), [])


@pytest.mark.parametrize("index", [1 << 31, (1 << 32) - 1, -2])
def test_an_index_that_is_none_is_refused(index):
    """What an int32 cannot hold would become another point."""
    good = make_map(np.ones((4, 5)))
    wide = good.index.astype(np.int64)
    wide[1, 2] = index
    with pytest.raises(InputError, match=rf"^index must be .*, got {index} at \[1, 2\]$"):
        dw.filters.apply(replace(good, index=wide), [])


def test_wide_types_are_taken_and_given_back(device):
    """As the maps of another program may come: the same values, and in `out` the same types."""
    wall = sparse(make_map(np.full((30, 40), 4.0)), 0.3)
    expected = dw.filters.apply(wall, dw.filters.best(), device=device)
    wide = replace(
        wall,
        depth=wall.depth.astype(np.float64),
        index=wall.index.astype(np.int64),
        state=wall.state.astype(np.int16),
    )
    assert_maps(dw.filters.apply(wide, dw.filters.best(), device=device), arrays_of(expected))
    written = dw.filters.apply(wide, dw.filters.best(), device=device, out=wide)
    assert [array.dtype for array in arrays_of(written)] == [np.float64, np.int64, np.int16]
    assert_maps(written, arrays_of(expected))
    narrow = replace(wall, index=wall.index.astype(np.uint32).clip(0, 9))
    with pytest.raises(InputError, match="^out.index must hold all that int32 does, got uint32$"):
        dw.filters.apply(narrow, dw.filters.best(), out=narrow)


@pytest.mark.parametrize("depth", [np.nan, np.inf, -3.0, 1e39, 1e-40])
def test_what_is_no_depth_is_refused(depth):
    """Nor what is none as a float32; the message says what an empty pixel holds."""
    values = np.ones((4, 5))
    values[2, 3] = depth
    bad = replace(make_map(np.ones((4, 5))), depth=values)
    message = rf"m, got {re.escape(f'{depth:g}')} at \[2, 3\]: an empty pixel has depth 0"
    with pytest.raises(InputError, match=message):
        dw.filters.apply(bad, dw.filters.best())


@pytest.mark.parametrize(
    ("depth", "state", "message"),
    [
        (2.0, 99, r"values of dw.State, got 99 at \[2, 3\]"),
        (0.0, dw.State.MEASURED, r"got MEASURED with depth 0 at \[2, 3\]"),
        (0.0, dw.State.FILLED_BORDER, r"got FILLED_BORDER with depth 0 at \[2, 3\]"),
        (2.5, dw.State.EMPTY, r"got EMPTY with depth 2.5 at \[2, 3\]"),
    ],
)
def test_states_that_contradict_the_depth_are_refused(depth, state, message):
    """And those that mean nothing; an erased pixel may hold its depth or none."""
    depths, states = np.ones((4, 5)), np.full((4, 5), dw.State.MEASURED)
    depths[0, :2], states[0, :2] = (0.0, 3.0), dw.State.ERASED
    dw.filters.apply(make_map(depths, state=states), dw.filters.best())
    depths[2, 3], states[2, 3] = depth, state
    with pytest.raises(InputError, match=message):
        dw.filters.apply(make_map(depths, state=states), dw.filters.best())


class NoBuild:
    """Looks like a filter, but does nothing."""

    scratch_bytes = 0


class NoScratch:
    """A filter that does not say what memory it takes."""

    def build(self, maps):
        """A step that does nothing."""
        return lambda: None


@pytest.mark.parametrize(
    ("item", "message"),
    [
        (dw.filters.PlaneFill, r"got the class PlaneFill: make one of it, PlaneFill\(\)"),
        (dw.filters.fill, r"got the function fill: call it, fill\(\)$"),
        (NoBuild(), "got .*NoBuild.* which has no method build: .*dw.filters.Filter"),
        (NoScratch(), "got .*NoScratch.* which has no number scratch_bytes: .*dw.filters.Filter"),
        ("best", "got 'best', which has no number scratch_bytes"),
        (
            dw.filters.paper(),
            r"which has no number .* dw.filters.paper\(\) are whole lists",
        ),
    ],
)
def test_what_is_no_filter_is_refused(item, message):
    """By its place in the chain, in applying as in rendering."""
    chain = [dw.filters.fill(), item]
    expected = rf"^filters\[1\] must be a filter.* {message}"
    with pytest.raises(InputError, match=expected):
        dw.filters.apply(make_map(np.ones((4, 5))), chain)
    with pytest.raises(InputError, match=expected):
        dw.filters.check_filters(chain)


@pytest.mark.parametrize("scratch", [math.nan, math.inf, -1])
def test_working_memory_that_is_none_is_refused(scratch):
    """It says how many views are filtered together."""
    one = NoBuild()
    one.scratch_bytes, one.build = scratch, lambda maps: None
    with pytest.raises(InputError, match=r"^filters\[0\] must have scratch_bytes from 0 on"):
        dw.filters.apply(make_map(np.ones((4, 5))), [one])


def test_a_filter_by_itself_is_no_list():
    """Nor is a name or a class."""
    for filters in (dw.filters.fill(), "best", dw.filters.PlaneFill):
        with pytest.raises(InputError, match="^filters must be a list of filters"):
            dw.filters.check_filters(filters)
