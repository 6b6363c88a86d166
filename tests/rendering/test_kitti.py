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
