"""Real LiDAR sweeps seen through a calibrated camera, counted by someone else's arithmetic."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import depthwarp as dw


@pytest.mark.parametrize(
    "name", ["testing_000000", "testing_000002", "testing_000007", "training_000008"]
)
def test_as_many_points_as_the_calibration_file_says(device, shared_data: Path, name):
    """The count of points in the image that stands in the file, from its own 3 x 4 matrix.

    `project` gives it exactly; the kernel, in float32, but for points at the image's border.
    """
    folder = shared_data / "kitti"
    if not (folder / f"{name}.bin").is_file():
        pytest.skip(f"no real scan on this machine: there is no file {name}.bin in {folder}")
    calibration = json.loads((folder / f"{name}_calib.json").read_text())
    cloud = dw.read(folder / f"{name}.bin")
    assert len(cloud) == calibration["points"]
    camera = dw.PinholeCamera.from_matrix(
        calibration["K_camera2"],
        (calibration["width"], calibration["height"]),
        optical_from_world=calibration["T_camera2_from_lidar"],
    )
    _, _, _, valid = camera.project(cloud.points_world)
    expected = calibration["check_points_in_image_pixel_centres_integer"]
    assert valid.sum() == expected
    depth_map = dw.render(cloud, camera, depth="z", max_range=math.inf, device=device)
    stats = depth_map.stats
    assert abs(stats.drawn + stats.hidden - expected) <= 3
    assert stats.behind == len(cloud) - calibration["check_points_with_positive_w"]
    assert stats.drawn == np.count_nonzero(depth_map.depth) > 0.8 * expected


@pytest.mark.parametrize("name", ["testing_000000", "training_000008"])
def test_lidar_points_are_where_the_devkits_formula_puts_them(device, shared_data: Path, name):
    """x = P2 R0_rect Tr_velo_to_cam X of the whole sweep: pixels, depth, winners; none behind."""
    folder = shared_data / "kitti"
    if not (folder / f"{name}.bin").is_file():
        pytest.skip(f"no real scan on this machine: there is no file {name}.bin in {folder}")
    calibration = json.loads((folder / f"{name}_calib.json").read_text())
    cloud = dw.read(folder / f"{name}.bin")
    size = calibration["width"], calibration["height"]
    camera = dw.PinholeCamera.from_matrix(
        calibration["K_camera2"], size, optical_from_world=calibration["T_camera2_from_lidar"]
    )
    formula = (
        np.array(calibration["P2_3x4"])
        @ np.array(calibration["R0_rect_4x4"])
        @ np.array(calibration["Tr_velo_to_cam_4x4"])
    )
    points = np.column_stack([cloud.points_world, np.ones(len(cloud))]).astype(np.float64)
    x, y, w = formula @ points.T
    u, v, depth, valid = camera.project(cloud.points_world, depth="z")
    ahead = w > 0
    np.testing.assert_array_equal(np.isfinite(u), ahead)
    np.testing.assert_allclose(depth[ahead], w[ahead], atol=1e-5)
    near = ahead & (abs(x) < 3000 * w) & (abs(y) < 3000 * w)  # beside the camera u has no end
    # The files' rotations are written to 7 digits: K T is P2 R0 Tr but for that.
    np.testing.assert_allclose(u[near], (x / w)[near], atol=5e-3)
    np.testing.assert_allclose(v[near], (y / w)[near], atol=5e-3)

    depth_map = dw.render(cloud, camera, depth="z", max_range=math.inf, device=device)
    rows, columns = np.nonzero(depth_map.index >= 0)
    winners = depth_map.index[rows, columns]
    assert ahead[winners].all() and valid[winners].mean() > 0.999
    assert (abs((x / w)[winners] - columns) < 0.51).all()
    assert (abs((y / w)[winners] - rows) < 0.51).all()
    np.testing.assert_allclose(depth_map.depth[rows, columns], w[winners], rtol=1e-5)
    # By the formula alone: the nearest point of each pixel.
    place = np.where(valid, np.floor(v + 0.5) * size[0] + np.floor(u + 0.5), -1).astype(np.int64)
    nearest = np.full(size[0] * size[1], np.inf)
    np.minimum.at(nearest, place[valid], w[valid])
    expected = np.where(np.isfinite(nearest), nearest, 0).reshape(size[1], size[0])
    same = np.isclose(depth_map.depth, expected, rtol=1e-5).mean()
    print(f"{name}: {same:.4%} of the pixels are those of the formula, {len(winners)} are drawn")
    assert same > 0.9999
