"""What the filters that look at layers promise: what they erase, and what they leave."""

from __future__ import annotations

import numpy as np
import pytest

import depthwarp as dw
from tests.filters.maps import (
    arrays_of,
    assert_maps,
    grid_of,
    make_map,
    sparse,
)
from tests.reference import layer_filters as reference


def floor_map(roll: float, width: int = 360, height: int = 240) -> dw.DepthMap:
    """A perfect floor at a grazing angle, up to 20 m; 0.4 m below a camera rolled by degrees."""
    camera = dw.PinholeCamera.from_fov((62, 45), (width, height))
    v, u = np.indices((height, width))
    angle = np.radians(roll)
    right, down = (u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy
    below = right * np.sin(angle) + down * np.cos(angle)
    with np.errstate(divide="ignore"):
        z = np.where(below > 0, 0.4 / below, 0)
    z[z > 20] = 0
    return make_map(z, camera)


def test_a_perfect_dense_map_goes_through_unchanged(device):
    """A wall with a box before it, every pixel measured: under 0.05 % change."""
    depth = np.full((240, 360), 6.0)
    depth[60:160, 100:220] = 3.0
    before = make_map(depth)
    after = dw.filters.apply(before, dw.filters.best(), device=device)
    assert (after.depth != before.depth).mean() < 0.0005


def test_what_is_seen_through_a_window_stays(device):
    """3 x 3 pixels of a wall behind one that was measured as densely: only the corners may go."""
    depth = np.full((60, 80), 3.0)
    depth[30:33, 40:43] = 6.0
    chain = [dw.filters.remove_hidden("surround")]
    erased = dw.filters.apply(make_map(depth), chain, device=device)
    kept = erased.state[30:33, 40:43] == dw.State.MEASURED
    assert kept[1].all() and kept[:, 1].all()


def test_what_is_seen_through_a_frame_stays(device):
    """A wall behind thin bars, a point every 4 pixels, 24 pixels apart: only close to them it may
    go, as behind a surface of such points it does."""
    far = np.random.default_rng(7).random((96, 96)) < 0.1
    bars, surface = np.zeros((2, 96, 96), bool)
    bars[30, 30:55:4] = bars[54, 30:55:4] = bars[30:55:4, 30] = bars[30:55:4, 54] = True
    surface[30:55:4, 30:55:4] = True
    inside = np.zeros(far.shape, bool)
    inside[38:47, 38:47] = True
    for near, least, most in ((bars, 0.0, 0.0), (surface, 0.95, 1.0)):
        depth = np.where(near, 3.0, np.where(far, 6.0, 0.0))
        chain = [dw.filters.remove_hidden("surround")]
        erased = dw.filters.apply(make_map(depth), chain, device=device)
        gone = erased.state == dw.State.ERASED
        assert least <= gone[inside & far & ~near].mean() <= most and not gone[near].any()


@pytest.mark.parametrize("roll", [0.0, 15.0, 35.0])
@pytest.mark.parametrize("share", [1.0, 0.3, 0.05, 0.01])
def test_a_perfect_slanted_floor_loses_nothing(device, share, roll):
    """At a grazing angle up to 20 m, dense or thinned out, however the camera is rolled."""
    floor = sparse(floor_map(roll), share)
    erased = dw.filters.apply(floor, [dw.filters.remove_hidden("surround")], device=device)
    assert (erased.state != dw.State.ERASED).all()


def test_companions_decide_where_a_pixel_alone_does_not(device):
    """A point of a wall in a hole of 14 px in a sparse plate before it: it goes if its companions
    lie behind the plate, and stays if they lie in the hole, too.
    """
    near = np.zeros((96, 96), bool)
    near[20:77:4, 20:77:4] = True
    near[42:55, 42:55] = False
    erase = [dw.filters.remove_hidden("surround")]

    def is_gone(companions) -> bool:
        depth = np.where(near, 3.0, 0.0)
        depth[48, 48] = 6.0
        for row, column in companions:
            depth[row, column] = 6.0
        state = dw.filters.apply(make_map(depth), erase, device=device).state
        return bool(state[48, 48] == dw.State.ERASED)

    assert is_gone([(38, 38), (38, 58), (58, 38), (58, 58)])
    assert not is_gone([(46, 46), (46, 50), (50, 46), (50, 50)])


def test_one_stray_point_erases_nothing(device):
    """1 m before a wall of which a fifth of the pixels was measured."""
    wall = sparse(make_map(np.full((120, 160), 5.0)), 0.2)
    depth = wall.depth.copy()
    depth[60, 80] = 4.0
    stray = make_map(depth, wall.camera)
    erased = dw.filters.apply(stray, [dw.filters.remove_hidden("surround")], device=device)
    assert (erased.state != dw.State.ERASED).all()


def test_strays_go_and_lines_stay(device):
    """Five points far apart and a wire, 1 m before a wall of which a fifth was measured: the points
    go, as many of the wall are nearer to each than the other points; the wire and the wall stay.
    """
    depth = sparse(make_map(np.full((120, 160), 5.0)), 0.2).depth.copy()
    strays = np.zeros(depth.shape, bool)
    strays[[46, 52, 55, 66, 70], [44, 58, 35, 48, 33]] = True
    depth[strays] = 4.0
    depth[::10, 120] = 4.0
    chain = [dw.filters.remove_hidden("surround")]
    gone = dw.filters.apply(make_map(depth), chain, device=device).state == dw.State.ERASED
    np.testing.assert_array_equal(gone, strays)


@pytest.mark.parametrize("share", [1.0, 0.4])
def test_a_pole_of_three_pixels_survives(device, share):
    """Before a wall: no pixel of it is erased, and the filled map shows it from top to bottom."""
    truth = np.full((120, 160), 6.0)
    truth[:, 80:83] = 3.0
    after = dw.filters.apply(sparse(make_map(truth), share), dw.filters.best(), device=device)
    pole = np.abs(after.depth[:, 80:83] - 3.0) < 0.01
    assert pole.any(axis=1).mean() > 0.97 and pole.mean() > 0.9


def test_what_shines_through_a_table_goes(device):
    """A wall seen through the gaps of a near plate goes, beside the plate it stays."""
    rng = np.random.default_rng(2)
    depth = np.where(rng.random((120, 160)) < 0.1, 6.0, 0)
    plate = np.zeros(depth.shape, bool)
    plate[30:90, 40:120] = rng.random((60, 80)) < 0.2
    depth[plate] = 2.0
    erased = dw.filters.apply(
        make_map(depth), [dw.filters.remove_hidden("surround")], device=device
    )
    far = depth == 6
    inside = np.zeros(depth.shape, bool)
    inside[34:86, 44:116] = True
    gone = erased.state == dw.State.ERASED
    assert gone[inside & far].mean() > 0.97
    inside[26:94, 36:124] = True
    assert gone[~inside & far].mean() < 0.01 and not gone[plate].any()


def test_pixels_of_the_largest_spacing_hide(device):
    """A screen with a point every 32 px, the farthest that is looked for, before a wall."""
    depth = np.zeros((200, 264))
    depth[4::6, 4::6] = 6.0
    depth[::32, ::32] = 3.0
    before = make_map(depth)
    after = dw.filters.apply(before, [dw.filters.remove_hidden("surround")], device=device)
    assert_maps(after, reference.surround_erase(arrays_of(before), grid_of(before), False))
    assert ((depth == 6) & (after.depth == 0)).sum() > 300


def test_planes_are_filled_exactly(device):
    """A slanted plane of which a tenth was measured: within 1 mm inside, hardly a gap."""
    camera = dw.PinholeCamera.from_fov((60, 45), (160, 120))
    v, u = np.indices((120, 160))
    truth = 1 / (0.2 + 0.0005 * (u - 80) - 0.0007 * (v - 60))
    kept = np.random.default_rng(3).random(truth.shape) < 0.1
    filled = dw.filters.apply(
        make_map(np.where(kept, truth, 0), camera), [dw.filters.fill()], device=device
    )
    inside = filled.state == dw.State.FILLED
    assert (filled.depth > 0)[8:-8, 8:-8].mean() > 0.99 and inside.mean() > 0.7
    error = np.abs(filled.depth - truth)[inside]
    assert np.median(error) < 0.001 and (error < 0.02).mean() > 0.98


def test_states_tell_inside_from_border(device):
    """Between pixels of a patch FILLED, outside it FILLED_BORDER, far from it EMPTY."""
    depth = np.zeros((60, 60))
    depth[20:41:4, 20:41:4] = 4.0
    filled = dw.filters.apply(make_map(depth), [dw.filters.fill()], device=device)
    assert (filled.state[24:37, 24:37] != dw.State.EMPTY).all()
    assert filled.state[30, 30] == dw.State.FILLED
    assert filled.state[17, 30] == dw.State.FILLED_BORDER and filled.depth[17, 30] == 4
    assert filled.state[0, 0] == dw.State.EMPTY


@pytest.mark.parametrize("method", ["paper", "surround", "cone"])
def test_a_kept_depth_counts_as_empty(device, method):
    """ERASED with its old depth and index on request; every filling then overwrites it."""
    depth = np.full((9, 9), 2.0)
    depth[4, 4] = 7.0
    options = {"side": 3} if method == "paper" else {}
    erase = dw.filters.remove_hidden(method, keep_depth=True, **options)
    kept = dw.filters.apply(make_map(depth), [erase], device=device)
    assert kept.state[4, 4] == dw.State.ERASED
    assert (kept.depth[4, 4], kept.index[4, 4]) == (7.0, 40)
    for step in [*map(dw.filters.fill, ["plane", "nearest", "push_pull"]), dw.filters.dilate()]:
        filled = dw.filters.apply(kept, [step], device=device)
        assert filled.depth[4, 4] == 2 and filled.state[4, 4] == dw.State.FILLED
    again = dw.filters.apply(kept, [dw.filters.remove_hidden(side=3)], device=device)
    assert_maps(again, arrays_of(kept))


def test_a_full_turn_goes_round(device):
    """Moving a panorama's columns round moves the result round; of a part of a turn it does not."""
    rng = np.random.default_rng(4)
    depth = np.where(rng.random((32, 64)) < 0.4, rng.choice([2.0, 6.0], (32, 64)), 0)
    pose = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))
    for azimuths, same in ((360.0, True), (180.0, False)):
        camera = dw.EquirectangularCamera(64, 32, pose, azimuths=azimuths)
        here = dw.filters.apply(make_map(depth, camera), dw.filters.best(), device=device)
        turned = make_map(np.roll(depth, 32, axis=1), camera)
        there = dw.filters.apply(turned, dw.filters.best(), device=device)
        assert np.array_equal(np.roll(here.depth, 32, axis=1), there.depth) == same
