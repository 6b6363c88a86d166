"""What a plane fill does where no surface surrounds a pixel."""

from __future__ import annotations

import numpy as np

import depthwarp as dw
from tests.filters.maps import make_map


def filled(depth: np.ndarray, device: str, camera: dw.Camera | None = None) -> dw.DepthMap:
    """The map after filling."""
    depth_map = make_map(depth) if camera is None else make_map(depth, camera)
    return dw.filters.apply(depth_map, [dw.filters.fill()], device=device)


def test_a_slanted_surface_goes_on_at_its_border(device):
    """Beside a patch of a slanted plane, a tenth of it measured: its depths go on, where those of
    the nearest pixels are more wrong by a fifth.
    """
    camera = dw.PinholeCamera.from_fov((60, 45), (160, 120))
    v, u = np.indices((120, 160))
    plane = 1 / (0.25 + 0.0006 * (u - 80) + 0.0008 * (v - 60))
    patch = np.zeros(plane.shape, bool)
    patch[30:90, 40:120] = np.random.default_rng(6).random((60, 80)) < 0.1
    depth = np.where(patch, plane, 0)
    after = filled(depth, device, camera)
    nearest = dw.filters.apply(make_map(depth, camera), [dw.filters.fill("nearest")], device=device)
    border = after.state == dw.State.FILLED_BORDER
    assert border.sum() > 500
    ours, theirs = (np.abs(one.depth - plane)[border].mean() for one in (after, nearest))
    assert ours < 0.85 * theirs


def test_what_lies_between_near_and_far_stays_empty(device):
    """Halfway between a near and a far surface a pixel is left empty; beside a sample it is filled,
    and so is all of it where the two are of one depth.
    """
    for far, is_filled in ((6.0, False), (2.0, True)):
        depth = np.zeros((48, 60))
        depth[8:41:4, 8:21:4], depth[8:41:4, 28:49:4] = 2.0, far
        camera = dw.PinholeCamera.from_fov((6, 5), (60, 48))
        after = filled(depth, device, camera)
        gap = after.state[12:37, 24:26]
        assert (gap != dw.State.EMPTY).all() if is_filled else (gap == dw.State.EMPTY).all()
        np.testing.assert_array_equal(after.depth[12:37:4, 21], 2.0)
        np.testing.assert_array_equal(after.depth[12:37:4, 29], far)


def test_a_thin_pole_is_filled_across(device):
    """A pole of 3 px with a gap of a row between its points: whole, though the wall is far."""
    depth = np.full((40, 40), 20.0)
    depth[:, 18:21] = 0
    depth[::2, 18:21] = 2.0
    depth[1::4, :18] = depth[1::4, 21:] = 0
    after = filled(depth, device)
    np.testing.assert_array_equal(after.depth[:, 18:21], 2.0)
