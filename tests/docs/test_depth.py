"""The sentences of `docs/conventions.md` under "Depth"."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import depthwarp as dw
from depthwarp.errors import InputError
from tests.docs.sentences import (
    ORIGIN,
    SQUARE,
    drawn,
    says,
)

POINT = (3.0, 1.5, 1.0)
LENGTH = np.float32(3.5)


@says("The range is the distance from the camera's centre.")
def test_range():
    """3, 1.5, 1 is 3.5 away."""
    assert drawn(SQUARE, POINT).depth.max() == LENGTH


@says("The z depth is the distance along the optical axis.")
def test_z():
    """3, 1.5, 1 is 3 ahead."""
    assert drawn(SQUARE, POINT, depth="z").depth.max() == 3


@says(
    "A fisheye or double sphere camera has z depth up to 85 degrees from its axis, and draws by z "
    "nothing beyond."
)
def test_z_of_wide_lenses():
    """84 and 86 degrees to the left: both by range, one by z; the pixel beyond has no point."""
    fisheye = dw.FisheyeCamera(60.0, 60.0, 100.0, 20.0, 201, 41, ORIGIN)
    spheres = dw.DoubleSphereCamera(60.0, 60.0, 100.0, 20.0, 0.1, 0.6, 201, 41, ORIGIN)
    inside, beyond = ((np.cos(a), np.sin(a), 0) for a in np.radians((84, 86)))
    for camera in (fisheye, spheres):
        assert drawn(camera, inside, beyond).stats.drawn == 2
        stats = drawn(camera, inside, beyond, depth="z").stats
        assert (stats.drawn, stats.behind) == (1, 1)
        assert camera.project(np.array([inside, beyond]), "z")[3].tolist() == [True, False]
        row, column = np.argwhere(drawn(camera, beyond).depth)[0]
        assert np.isnan(camera.unproject(np.ones((41, 201)), "z")[row, column]).all()


@says("Of an orthographic camera both depths are the distance from the image's plane.")
def test_orthographic_depth():
    """3, 1.5, 1 is 3 before the plane."""
    camera = dw.OrthographicCamera(0.5, 11, 11, ORIGIN)
    for kind in ("range", "z"):
        assert drawn(camera, POINT, depth=kind).depth.max() == 3


@says(
    "The range of a spinning LiDAR is the way along the beam, and that of its origin from the axis."
)
def test_lidar_range():
    """A beam that starts 0.1 m from the axis, level and 30 degrees up."""
    lidar = dw.SpinningLidar(64, (30.0, 0.0), ORIGIN, origin_offset=0.1)
    up = (0.1 + 2 * np.cos(np.pi / 6), 0.0, 2 * np.sin(np.pi / 6))
    depth_map = drawn(lidar, (2.1, 0, 0), up)
    np.testing.assert_allclose(depth_map.depth.max(axis=1), (2.1, 2.1), rtol=1e-6)


@says("Panoramas and spinning LiDARs have no z depth, and asking for it is an error.")
def test_no_z():
    """The message says what to use."""
    for camera in (
        dw.EquirectangularCamera.looking((8, 4)),
        dw.CylindricalCamera.looking((8, 4)),
        dw.SpinningLidar(8, (1.0, -1.0), ORIGIN),
    ):
        with pytest.raises(InputError, match="depth='range'"):
            drawn(camera, POINT, depth="z")


@says("Depths are float32 and in metres.")
def test_units():
    """A point 2 m ahead."""
    depth = drawn(SQUARE, (2, 0, 0)).depth
    assert depth.dtype == np.float32 and depth[5, 5] == 2


@says("An empty pixel has depth 0, index -1 and the state EMPTY.")
def test_empty():
    """All but the one that is drawn."""
    depth_map = drawn(SQUARE, (2, 0, 0))
    empty = np.ones((11, 11), bool)
    empty[5, 5] = False
    assert (depth_map.depth[empty] == 0).all() and (depth_map.index[empty] == -1).all()
    assert (depth_map.state[empty] == dw.State.EMPTY).all()
    assert depth_map.state[5, 5] == dw.State.MEASURED


@says("A depth map holds no NaN and no infinity.")
def test_finite():
    """Points that are not finite, or overflow, leave nothing."""
    bad = [(np.nan, 0, 0), (np.inf, 0, 0), (3e38, 3e38, 3e38), (2, -np.inf, 0)]
    depth_map = drawn(SQUARE, *bad, (2, 0, 0), max_range=np.inf)
    assert np.isfinite(depth_map.depth).all() and depth_map.stats.drawn == 1


@says("The nearest point of a pixel wins, and of equally near ones the first of the cloud.")
def test_nearest():
    """Three points on one ray, two of them alike."""
    depth_map = drawn(SQUARE, (4, 0, 0), (2, 0, 0), (2, 0, 0))
    assert depth_map.depth[5, 5] == 2 and depth_map.index[5, 5] == 1


@says("A point farther than `max_range`, by default 15 m, is not drawn.")
def test_max_range():
    """15 m is, a little more is not."""
    assert drawn(SQUARE, (15, 0, 0)).stats.drawn == 1
    assert drawn(SQUARE, (np.nextafter(np.float32(15), 16), 0, 0)).stats.too_far == 1
    assert drawn(SQUARE, (20, 0, 0), max_range=20.0).stats.drawn == 1


@says("Of a 16-bit PNG the value 65535 is `max_range` and 0 is empty.")
def test_png(tmp_path):
    """A point at the greatest range, one at half of it."""
    path = tmp_path / "depth.png"
    drawn(SQUARE, (15, 0, 0), (4.5, 6, 0), (1.0, 0.5, 0.5), max_range=15.0).save(path)
    values = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert values.dtype == np.uint16 and values.max() == values[5, 5] == 65535
    assert np.count_nonzero(values) == 2
