"""Real depth pictures, unprojected and rendered again: the same picture, and the next one."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

import depthwarp as dw


@pytest.fixture(scope="module")
def living_room(shared_data: Path) -> tuple[Path, dict]:
    """Folder and description of the recording."""
    folder = shared_data / "rgbd_livingroom"
    if not (folder / "frames.json").is_file():
        pytest.skip(f"no real depth pictures on this machine: there is no {folder}/frames.json")
    return folder, json.loads((folder / "frames.json").read_text())


def frame(living_room: tuple[Path, dict], place: int) -> tuple[dw.PinholeCamera, np.ndarray]:
    """Camera and depth [mm] of a frame."""
    folder, entries = living_room
    entry = entries["frames"][place]
    millimetres = cv2.imread(str(folder / entry["depth"]), cv2.IMREAD_UNCHANGED)
    size = entries["width"], entries["height"]
    optical_from_world = np.linalg.inv(entry["T_world_from_camera"])
    camera = dw.PinholeCamera.from_matrix(entries["K"], size, optical_from_world=optical_from_world)
    return camera, millimetres


def cloud_of(camera: dw.PinholeCamera, millimetres: np.ndarray) -> dw.PointCloud:
    """The points of a frame."""
    points = camera.unproject(millimetres / 1000.0, "z")
    return dw.PointCloud(points[np.isfinite(points[..., 0])].astype(np.float32))


@pytest.mark.parametrize("place", [0, 5])
def test_a_frame_in_its_own_camera_is_itself(device, living_room, place):
    """Pixel for pixel, after rounding to millimetres."""
    camera, millimetres = frame(living_room, place)
    depth_map = dw.render(cloud_of(camera, millimetres), camera, depth="z", device=device)
    np.testing.assert_array_equal(np.rint(depth_map.depth * 1000), millimetres)
    assert depth_map.stats.hidden == depth_map.stats.outside == 0


def test_a_frame_agrees_with_the_next_one(device, living_room):
    """Seen from the next pose: the median difference is a millimetre, the unit of the files."""
    for place in range(0, 9, 4):
        camera, millimetres = frame(living_room, place)
        following, expected = frame(living_room, place + 1)
        depth_map = dw.render(cloud_of(camera, millimetres), following, depth="z", device=device)
        both = (depth_map.depth > 0) & (expected > 0)
        difference = abs(depth_map.depth[both] * 1000 - expected[both])
        print(
            f"frame {place} in the next pose: {both.mean():.0%} of the pixels, median difference "
            f"{np.median(difference):.2f} mm, 90 % below {np.percentile(difference, 90):.1f} mm"
        )
        assert both.mean() > 0.3
        assert np.median(difference) < 3
