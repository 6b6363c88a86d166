"""The benchmark's scenes: the same fields give the same points, in the order that they name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import depthwarp as dw
from benchmarks.real_scenes import KitchenScene
from benchmarks.scene_catalogue import SCENES, chosen_scenes
from benchmarks.scenes import RoomScene, ScanScene
from depthwarp.errors import InputError

MADE = [name for name, kind in SCENES.items() if kind.usual_counts != (0,)]
REAL = [name for name in SCENES if name not in MADE]


def in_view(scene, points):
    """Share of the points that fall into the image, by the camera's own reference."""
    return float(scene.camera().project(points)[3].mean())


@pytest.mark.parametrize("name", MADE)
def test_a_scene_gives_the_same_points_twice(name):
    """Same fields, same bits; another seed, other points where a scene is random."""
    scene = SCENES[name](3001)
    points = scene.points_world()
    assert points.shape == (3001, 3) and points.dtype == np.float32
    assert np.array_equal(points, scene.points_world())
    other = replace(scene, seed=1).points_world()
    assert np.array_equal(points, other) == (scene.made_order == "scan")


@pytest.mark.parametrize("name", MADE)
def test_orders_hold_the_same_points(name):
    """Shuffled and sorted are the made points, moved; sorted neighbours lie nearer together."""
    made = SCENES[name](3001)
    points = made.points_world()
    shuffled = replace(made, order="shuffled").points_world()
    in_space = replace(made, order="sorted").points_world()
    for moved in (shuffled, in_space):
        assert not np.array_equal(moved, points)
        assert np.array_equal(np.unique(moved, axis=0), np.unique(points, axis=0))
    steps = [np.linalg.norm(np.diff(p, axis=0), axis=1).mean() for p in (in_space, shuffled)]
    assert steps[0] < steps[1] / 4


@pytest.mark.parametrize("name", MADE)
def test_a_camera_sees_a_part_of_its_scene(name):
    """Each view, also of those all round, has points inside the image and points outside."""
    scene = SCENES[name](3001)
    points = scene.points_world()
    assert 0.02 < in_view(scene, points) < 0.7
    cameras = scene.cameras(5)
    assert cameras[0] == scene.camera() and len(set(cameras)) == 5
    for camera in cameras:
        assert camera.project(points)[3].mean() > 0.02


def test_a_scan_is_dense_where_the_scanner_is_near():
    """All points lie on the room's faces; a far piece of the ceiling gets fewer of them."""
    scene = ScanScene(200_000)
    points = scene.points_world()
    from_face = np.minimum(points, np.float32(scene.room_m) - points).min(axis=1)
    assert np.abs(from_face).max() < 1e-5
    ceiling = points[points[:, 2] > scene.room_m[2] - 1e-5, :2]

    def points_round(x, y):
        return int((np.linalg.norm(ceiling - np.float32([x, y]), axis=1) < 0.5).sum())

    x, y, _ = scene.scanner_m
    assert points_round(x, y) > 4 * points_round(x + 2.5, y) > 100


def test_scenes_are_chosen_by_name():
    """Given numbers of points hold for made scenes; an unknown name is refused with those known."""
    scenes = chosen_scenes(["room", "kitti"], [100, 200], "shuffled")
    assert [scene.name for scene in scenes] == ["room", "room", "kitti"]
    assert [scene.point_count for scene in scenes[:2]] == [100, 200]
    assert {scene.order for scene in scenes} == {"shuffled"}
    assert chosen_scenes(["furnished"], [], "made")[0].point_count == 200_000
    with pytest.raises(InputError, match=r"no scene 'rom'.*room, uniform"):
        chosen_scenes(["rom"], [], "made")


@pytest.mark.parametrize("name", [name for name in REAL if name != "kitchen"])
def test_real_scenes_are_there_or_say_why_not(name, shared_data, monkeypatch):
    """A real cloud has finite points, some in view; without its file the scene says so."""
    scene = SCENES[name](0)
    assert scene.missing is None
    points = scene.points_world()
    assert len(points) > 100_000 and np.isfinite(points).all()
    assert in_view(scene, points) > 0.02
    monkeypatch.setattr("benchmarks.real_scenes.DATA", shared_data / "nowhere")
    assert "nowhere" in scene.missing


def test_the_kitchen_is_fused_in_one_frame(shared_data, monkeypatch):
    """From the first Kinect's place the points of another frame lie on the surfaces of its own."""
    frames = KitchenScene()._frames()
    assert len(frames) == 40 and KitchenScene().cameras(41)[40] == frames[0][0]
    depths = []
    for frame in (0, 1):
        monkeypatch.setattr(KitchenScene, "_frames", lambda self, frame=frame: [frames[frame]])
        cloud = dw.PointCloud(KitchenScene().points_world())
        depths.append(dw.render(cloud, frames[0][0], depth="z", device="cpu").depth)
    both = (depths[0] > 0) & (depths[1] > 0)
    assert (depths[0] > 0).mean() > 0.85 and both.mean() > 0.4
    assert np.median(np.abs(depths[0] - depths[1])[both]) < 0.03


def test_the_room_is_that_of_the_results_that_are_kept():
    """The points with which all kept results were measured have not moved."""
    points = RoomScene(1000).points_world()
    assert points[0].tolist() == pytest.approx([4.4530935, 0.0650382, 2.7])
    assert points.sum(axis=0, dtype=np.float64).tolist() == pytest.approx(
        [2991.95168, 2473.22853, 1334.10971], abs=1e-4
    )
