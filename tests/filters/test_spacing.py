"""Own-layer spacing on images wider than a word of pixels, against the loop."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

import depthwarp as dw
from depthwarp.filters.maps import DeviceMaps, device_grids
from depthwarp.filters.pyramid import Pyramid
from tests.filters.maps import make_map
from tests.reference.layers import Grid, spacing_of

SHAPE = (40, 107)


def spacing(depth_map: dw.DepthMap, device: str) -> np.ndarray:
    """What the kernels find."""
    arrays = [
        wp.array(getattr(depth_map, name)[None], dtype=kind, device=device)
        for name, kind in (("depth", wp.float32), ("index", wp.int32), ("state", wp.uint8))
    ]
    pyramid = Pyramid(DeviceMaps(*arrays, grids=device_grids([depth_map.camera], device)))
    pyramid.build()
    return pyramid.spacing.numpy()[0]


@pytest.mark.parametrize("azimuths", [360.0, 90.0])
@pytest.mark.parametrize("share", [0.004, 0.03, 0.5])
def test_rings_of_every_size_across_words_and_the_seam(device, azimuths, share):
    """Two walls with gaps of a pixel to tens of pixels; the ends of a full turn are neighbours."""
    rng = np.random.default_rng(8)
    depth = np.where(rng.random(SHAPE) < 0.5, 2.0, 5.0)
    depth[rng.random(SHAPE) >= share] = 0
    depth[20, ::7] = 3.0  # along a line
    pose = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))
    camera = dw.EquirectangularCamera(*SHAPE[::-1], pose, azimuths=azimuths)
    depth_map = make_map(depth, camera)
    grid = Grid(*camera.pixel_pitch, wraps=camera.wraps)
    expected, lines = spacing_of(depth_map.depth, depth_map.state, grid)
    assert expected.max() > 2 and 0 < lines.sum() < (expected > 0).sum()
    found = spacing(depth_map, device)
    np.testing.assert_array_equal(found & 63, expected)
    np.testing.assert_array_equal(found & 64 != 0, lines)


def test_companions_across_the_seam_are_those_inside(device):
    """Two that lie equally near, one of them beyond the seam: the same is taken as elsewhere."""
    depth = np.zeros((20, 64))
    depth[[10, 9, 8, 11, 7, 7], [62, 62, 62, 62, 0, 59]] = 2.0
    pose = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))
    camera = dw.EquirectangularCamera(64, 20, pose)
    grid = Grid(*camera.pixel_pitch, wraps=camera.wraps)
    inside = spacing(make_map(np.roll(depth, 32, axis=1), camera), device)
    across = make_map(depth, camera)
    np.testing.assert_array_equal(np.roll(inside, -32, axis=1), spacing(across, device))
    rings, lines = spacing_of(across.depth, across.state, grid)
    np.testing.assert_array_equal(spacing(across, device), rings + 64 * lines)
    assert rings[10, 62] == 3
