"""Options of filters and maps without anything to filter: what is taken, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest

import depthwarp as dw
from depthwarp.errors import CapacityError, InputError
from depthwarp.filters.pyramid import check_cells
from tests.filters.maps import (
    arrays_of,
    assert_maps,
    make_map,
)


@pytest.mark.parametrize(
    "chain", [["surround", "plane"], ["cone", "nearest"], ["paper", "push_pull"]]
)
@pytest.mark.parametrize("shape", [(1, 1), (1, 5), (3, 2), (17, 40)])
def test_empty_maps_and_single_pixels_stay(device, chain, shape):
    """Nothing to erase and nothing to fill with; and one pixel is kept as it is."""
    steps = [dw.filters.remove_hidden(chain[0]), dw.filters.fill(chain[1])]
    empty = make_map(np.zeros(shape))
    assert_maps(dw.filters.apply(empty, steps, device=device), arrays_of(empty))
    depth = np.zeros(shape)
    depth[0, 0] = 2.0
    one = dw.filters.apply(make_map(depth), steps, device=device)
    assert one.depth[0, 0] == 2 and one.state[0, 0] == dw.State.MEASURED
    assert np.isin(one.depth, [0, 2]).all()


def test_unknown_methods_and_foreign_options_are_refused():
    """The message says which there are, also of a method with one option or none."""
    with pytest.raises(InputError, match="'plane', 'nearest', 'push_pull', got 'spline'"):
        dw.filters.fill("spline")
    with pytest.raises(InputError, match="has no threshold: its options are keep_depth$"):
        dw.filters.remove_hidden("surround", threshold=0.5)
    with pytest.raises(InputError, match="no side: its options are radius, angle, keep_depth$"):
        dw.filters.remove_hidden("cone", side=3)
    with pytest.raises(InputError, match="method 'plane' has no radius: it has no options$"):
        dw.filters.fill(radius=3)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: dw.filters.remove_hidden("cone", radius=0),
            "radius must be .* from 1 to 31 pixels",
        ),
        (
            lambda: dw.filters.remove_hidden("cone", radius=32),
            "radius must be .* from 1 to 31 pixels",
        ),
        (lambda: dw.filters.remove_hidden("cone", angle=0.0), "angle must be"),
        (lambda: dw.filters.remove_hidden("cone", angle=90.0), "angle must be below 90"),
        (lambda: dw.filters.fill("nearest", radius=0), "radius must be .* from 1 to 1024 pixels"),
        (
            lambda: dw.filters.fill("nearest", radius=1025),
            "radius must be .* from 1 to 1024 pixels",
        ),
        (lambda: dw.filters.fill("nearest", radius=2.5), "radius must be .*, got 2.5"),
        (lambda: dw.filters.fill("nearest", radius=True), "radius must be .*, got True"),
        (lambda: dw.filters.dilate(side=True), "side must be .*, got True"),
        (lambda: dw.filters.NearestFill(math.nan), "radius must be .*, got nan"),
    ],
)
def test_values_out_of_range_are_refused(make, message):
    """With the name, what is expected and what was given."""
    with pytest.raises(InputError, match=f"^{message}"):
        make()


def test_whole_numbers_are_stored_as_such():
    """A side or radius may be written 2.0 or come from NumPy: the filter is that of 2."""
    for two in (2.0, np.int64(2)):
        assert repr(dw.filters.dilate(side=two)) == repr(dw.filters.dilate(side=2))
        for method, name in (("paper", "side"), ("cone", "radius")):
            made = dw.filters.remove_hidden(method, **{name: two})
            assert repr(made) == repr(dw.filters.remove_hidden(method, **{name: 2}))
        assert repr(dw.filters.fill("nearest", radius=two)) == "NearestFill(radius=2)"


@pytest.mark.parametrize("method", ["paper", "surround", "cone"])
def test_whether_the_depth_is_kept_is_true_or_false(method):
    """Of Python or NumPy; a number, a word or None is refused, also by the classes."""
    kept = dw.filters.remove_hidden(method, keep_depth=np.True_)
    assert repr(kept) == repr(dw.filters.remove_hidden(method, keep_depth=True))
    for value in (3, 1, 0, 1.0, "no", None):
        message = f"^keep_depth must be one of True, False, got {value!r}$"
        with pytest.raises(InputError, match=message):
            dw.filters.remove_hidden(method, keep_depth=value)
        with pytest.raises(InputError, match=message):
            type(kept)(keep_depth=value)


def test_an_image_with_more_cells_than_can_be_counted_is_refused():
    """Where a number of 32 bits ends, before anything is computed."""
    with pytest.raises(CapacityError, match="got 65536 x 65536: render in tiles"):
        check_cells([(65536, 65536)], 1)
    with pytest.raises(CapacityError, match="got 2 of 30000 x 30000: render one after the other"):
        check_cells([(30000, 30000)], 2)
    check_cells([(30000, 30000)], 1)
