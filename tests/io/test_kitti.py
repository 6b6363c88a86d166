"""KITTI sweeps: float32 rows of four, and sizes that cannot be."""

from __future__ import annotations

import struct

import numpy as np
import pytest

import depthwarp as dw
from depthwarp.errors import FileFormatError, InputError


def test_rows_of_four(scratch):
    rows = [(1.5, -2.0, 3.0, 0.25), (4.0, 5.0, 6.0, 1.0)]
    cloud = dw.read(scratch("sweep.bin", b"".join(struct.pack("<4f", *row) for row in rows)))
    np.testing.assert_array_equal(cloud.points_world, [[1.5, -2, 3], [4, 5, 6]])
    assert list(cloud.attributes) == ["intensity"]
    assert cloud.attributes["intensity"].dtype == np.float32
    np.testing.assert_array_equal(cloud.attributes["intensity"], [0.25, 1.0])


def test_one_point_and_an_offset(scratch):
    cloud = dw.read(scratch("one.bin", struct.pack("<4f", 1, 2, 3, 4)), offset=(1, 1, 1))
    np.testing.assert_array_equal(cloud.points_world, [[0, 1, 2]])


@pytest.mark.parametrize("size", [1, 15, 17, 40])
def test_a_size_that_is_no_multiple_of_16(scratch, size):
    message = f"{size} bytes are not a multiple of 16.*{size // 16} whole points"
    with pytest.raises(FileFormatError, match=message):
        dw.read(scratch("cut.bin", b"\0" * size))


def test_a_nuscenes_sweep_is_not_taken_for_kitti(scratch):
    with pytest.raises(InputError, match="nuScenes.*5 columns"):
        dw.read(scratch("sweep.pcd.bin", b"\0" * 80))


@pytest.mark.parametrize(
    ("name", "count", "extent"),
    [
        ("kitti/testing_000000.bin", 125_635, (157.49, 69.37, 9.05)),
        ("kitti/testing_000002.bin", 115_604, (158.71, 139.21, 11.64)),
        ("kitti/testing_000007.bin", 115_236, (154.49, 124.91, 10.97)),
        ("kitti/training_000008.bin", 17_238, (73.95, 36.7, 6.47)),
    ],
)
def test_real_sweeps(real_file, name, count, extent):
    cloud = dw.read(real_file(name))
    assert len(cloud) == count
    np.testing.assert_allclose(np.ptp(cloud.points_world, axis=0), extent, atol=0.006)
    intensity = cloud.attributes["intensity"]
    assert intensity.min() >= 0.0 and intensity.max() <= 1.0
