"""Own-layer spacing on images wider than a word of pixels, against the loop."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

import depthwarp as dw
from depthwarp.filters.pyramid import Pyramid
from tests.filters.maps import device_maps, make_map
from tests.reference.layers import Grid, Spacing, spacing_of

SHAPE = (40, 107)


def spacing_bits(depth_map: dw.DepthMap, device: str, *, extents: bool = True) -> np.ndarray:
    """What the kernels find."""
    pyramid = Pyramid(device_maps([depth_map], device))
    pyramid.reading(extents=extents)()
    return pyramid.spacing.numpy()[0].astype(int)


def bits_of(spacing: Spacing) -> np.ndarray:
    """The same, of what the loop finds."""
    return spacing.own + 64 * spacing.line + 256 * (4 * spacing.extent).astype(int)


def turned(depth: np.ndarray, azimuths: float = 360.0) -> tuple[dw.DepthMap, Grid]:
    """A map of a camera that looks round."""
    pose = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))
    camera = dw.EquirectangularCamera(*depth.shape[::-1], pose, azimuths=azimuths)
    return make_map(depth, camera), Grid(*camera.pixel_pitch, wraps=camera.wraps)


def two_walls(share: float, seed: int = 8) -> np.ndarray:
    """Depths of two walls, mingled, of which a share of the pixels was measured."""
    rng = np.random.default_rng(seed)
    depth = np.where(rng.random(SHAPE) < 0.5, 2.0, 5.0)
    depth[rng.random(SHAPE) >= share] = 0
    depth[20, ::7] = 3.0  # along a line
    depth[[24, 30, 36], 10:90:2] = 3.0  # rows of a surface
    return depth


@pytest.mark.parametrize("azimuths", [360.0, 90.0])
@pytest.mark.parametrize("share", [0.004, 0.03, 0.5])
def test_rings_of_every_size_across_words_and_the_seam(device, azimuths, share):
    """Two walls with gaps of a pixel to tens of pixels; the ends of a full turn are neighbours."""
    depth_map, grid = turned(two_walls(share), azimuths)
    expected = spacing_of(depth_map.depth, depth_map.state, grid)
    assert expected.own.max() > 2 and 0 < expected.line.sum() < (expected.own > 0).sum()
    assert (expected.extent[30, 14:86:2] >= 5).all()  # the way to what is beside the row
    np.testing.assert_array_equal(spacing_bits(depth_map, device), bits_of(expected))
    alone = spacing_bits(depth_map, device, extents=False)
    np.testing.assert_array_equal(alone, expected.own)


def test_companions_across_the_seam_are_those_inside(device):
    """Two that lie equally near, one of them beyond the seam: the same is taken as elsewhere."""
    depth = np.zeros((20, 64))
    depth[[10, 9, 8, 11, 7, 7], [62, 62, 62, 62, 0, 59]] = 2.0
    inside = spacing_bits(turned(np.roll(depth, 32, axis=1))[0], device)
    across, grid = turned(depth)
    found = spacing_bits(across, device)
    np.testing.assert_array_equal(np.roll(inside, -32, axis=1), found)
    expected = spacing_of(across.depth, across.state, grid)
    np.testing.assert_array_equal(found, bits_of(expected))
    assert expected.own[10, 62] == 3


@pytest.mark.parametrize("share", [0.01, 0.1, 0.6])
def test_what_is_renewed_after_erasing_is_what_is_found_anew(device, share):
    """Spacing and areas after some pixels are gone, from those before and from the map alone."""
    before, _ = turned(two_walls(share))
    gone = np.random.default_rng(3).random(SHAPE) < 0.1
    gone[:, 50:80] = True
    bits = np.zeros((*SHAPE[:1], 4, 32), bool)
    bits.reshape(SHAPE[0], -1)[:, : SHAPE[1]] = gone & (before.depth > 0)
    erased = np.packbits(bits, axis=-1, bitorder="little").view(np.uint32)[None, ..., 0]

    pyramid = Pyramid(device_maps([before], device))
    pyramid.reading(extents=True)()
    wp.copy(pyramid.words, wp.array(pyramid.words.numpy() & ~erased, device=device))
    pyramid.leaving_out(wp.array(erased, dtype=wp.uint32, device=device))()
    after, _ = turned(np.where(gone, 0, before.depth))
    anew = Pyramid(device_maps([after], device))
    anew.reading(extents=False)()
    np.testing.assert_array_equal(pyramid.spacing.numpy(), anew.spacing.numpy())
    np.testing.assert_array_equal(pyramid.cells.numpy(), anew.cells.numpy())
