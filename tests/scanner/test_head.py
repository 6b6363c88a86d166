"""The simulated head: where its points lie, what it does not see, and the demo's numbers."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from depthwarp.cloud import PointCloud
from depthwarp.errors import InputError
from depthwarp.scanner.head import FRAMES_A_STEP, RotatingHead
from depthwarp.scanner.room import Box, Room, furnished_room

POSITION = (1.8, 5.15, 1.25)
HEAD = RotatingHead(POSITION, frames=90)
FLOOR = Box("floor", (0.0, 0.0, -0.5), (100.0, 100.0, 1.0), (200, 100, 50))


@pytest.fixture(scope="module")
def demo_cloud() -> PointCloud:
    return RotatingHead(POSITION).scan(furnished_room(), seed=1)


def ranges(cloud: PointCloud, position: tuple[float, float, float] = POSITION) -> np.ndarray:
    return np.linalg.norm(cloud.points_world.astype(np.float64) - position, axis=1)


def test_without_noise_a_floor_is_met_at_height_over_sine():
    head = RotatingHead((0.0, 0.0, 1.0), frames=4, points_a_frame=3, range_noise=0.0)
    cloud = head.scan(Room((FLOOR,)), seed=0)
    # Of elevations -45, 0 and 45 degrees only the first meets the floor, 1 m ahead.
    expected = [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]]
    np.testing.assert_allclose(cloud.points_world, expected, atol=1e-6)
    assert cloud.attributes["frame"].tolist() == [0, 1, 2, 3]
    assert cloud.attributes["angle"].tolist() == [0, 90, 180, 270]
    brightness = 0.6 + 0.4 * math.sqrt(0.5)
    expected_color = [int(channel * brightness) for channel in FLOOR.color]
    assert cloud.attributes["color"].tolist() == [expected_color] * 4


def test_every_point_lies_within_six_sigma_of_a_surface_along_its_ray():
    room = furnished_room()
    cloud = HEAD.scan(room, seed=3)
    measured = ranges(cloud)
    elevation = np.degrees(np.arcsin((cloud.points_world[:, 2] - POSITION[2]) / measured))
    ray = np.rint((elevation + 45) * 79 / 90).astype(int)
    rays = HEAD.directions(HEAD.angles())[80 * cloud.attributes["frame"] + ray]
    exact, _ = room.cast(POSITION, rays)
    error = measured - exact
    assert np.abs(error).max() < 6 * HEAD.range_noise
    assert np.sqrt(np.mean(error**2)) == pytest.approx(HEAD.range_noise, rel=0.05)
    np.testing.assert_allclose(cloud.points_world, POSITION + measured[:, None] * rays, atol=2e-6)


def test_rays_fill_the_fan_and_the_turn():
    rays = HEAD.directions(HEAD.angles()).reshape(90, 80, 3)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=2), 1.0)
    elevation = np.degrees(np.arcsin(rays[0, :, 2]))
    np.testing.assert_allclose(elevation, np.linspace(-45, 45, 80))
    azimuth = np.degrees(np.arctan2(rays[:, 0, 1], rays[:, 0, 0])) % 360
    np.testing.assert_allclose(azimuth, np.arange(90) * 4.0, atol=1e-9)


def test_attributes_match_the_points():
    cloud = HEAD.scan(furnished_room(), seed=0)
    frame, angle = cloud.attributes["frame"], cloud.attributes["angle"]
    assert (frame.dtype, angle.dtype) == (np.int32, np.float32)
    assert cloud.attributes["color"].shape == (len(cloud), 3)
    assert cloud.attributes["color"].dtype == np.uint8
    assert (np.diff(frame) >= 0).all()
    assert np.bincount(frame).max() <= 80
    np.testing.assert_array_equal(angle, frame * np.float32(4.0))
    offset = cloud.points_world - np.array(POSITION, np.float32)
    turned = np.degrees(np.arctan2(offset[:, 1], offset[:, 0]))
    np.testing.assert_allclose((turned - angle + 180) % 360, 180, atol=1e-3)


def test_the_seed_decides_the_cloud():
    room = furnished_room()
    first, again, other = (HEAD.scan(room, seed=seed) for seed in (5, 5, 6))
    np.testing.assert_array_equal(first.points_world, again.points_world)
    assert not np.array_equal(first.points_world, other.points_world)


def test_nothing_beyond_the_maximum_range():
    walls = tuple(
        Box("wall", (side * 20.0, 0.0, 0.0), (10.0, 80.0, 80.0), (9, 9, 9)) for side in (-1, 1)
    )
    middle = replace(HEAD, position=(0.0, 0.0, 0.0), range_noise=0.0)
    assert len(middle.scan(Room(walls), seed=0)) == 0  # no ray is level: all are longer than 15 m
    near = replace(HEAD, position=(0.5, 0.0, 0.0)).scan(Room(walls), seed=0)
    assert 0 < ranges(near, (0.5, 0.0, 0.0)).max() <= 15.0
    assert near.points_world[:, 0].min() > 0


def test_a_grazing_ray_returns_nothing():
    position = (0.0, 0.0, 0.1)
    head = RotatingHead(position, frames=1, points_a_frame=900, range_noise=0.0)
    cloud = head.scan(Room((FLOOR,)), seed=0)
    farthest = float(ranges(cloud, position).max())
    limit = 0.1 / math.sin(math.radians(3.0))
    assert 0.95 * limit < farthest <= limit
    grazing = replace(head, min_incidence=0.0).scan(Room((FLOOR,)), seed=0)
    assert ranges(grazing, position).max() > 2 * limit


def test_an_empty_room_gives_an_empty_cloud():
    cloud = HEAD.scan(Room(()), seed=0)
    assert len(cloud) == 0
    assert cloud.attributes["color"].shape == (0, 3)


def test_progress_ends_at_the_last_frame():
    seen: list[tuple[int, int]] = []
    head = RotatingHead(POSITION, frames=2 * FRAMES_A_STEP + 1, points_a_frame=1)
    head.scan(Room((FLOOR,)), seed=0, progress=lambda done, total: seen.append((done, total)))
    assert [done for done, _ in seen] == [FRAMES_A_STEP, 2 * FRAMES_A_STEP, head.frames]
    assert {total for _, total in seen} == {head.frames}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"position": (0.0, 0.0)}, "position"),
        ({"position": (0.0, 0.0, math.inf)}, "position"),
        ({"frames": 0}, "frames"),
        ({"points_a_frame": 0}, "points_a_frame"),
        ({"frames": 10**9}, "rays"),
        ({"fan": 0.0}, "fan"),
        ({"fan": 180.0}, "fan"),
        ({"fan": math.nan}, "fan"),
        ({"max_range": 0.0}, "max_range"),
        ({"max_range": math.inf}, "max_range"),
        ({"range_noise": -1.0}, "range_noise"),
        ({"range_noise": math.nan}, "range_noise"),
        ({"min_incidence": 90.0}, "min_incidence"),
        ({"min_incidence": math.nan}, "min_incidence"),
    ],
)
def test_bad_settings_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        replace(HEAD, **change)


def test_a_head_inside_the_furniture_is_refused():
    head = replace(HEAD, position=(1.85, 7.05, 0.73))
    with pytest.raises(InputError, match="inside the table"):
        head.scan(furnished_room(), seed=0)


def test_the_demo_scan_gives_the_papers_columns(demo_cloud):
    farthest = float(demo_cloud.points_world[:, 1].max()) - 3.3
    assert math.ceil(farthest / (0.01 * math.cos(math.radians(30)))) == 724
    assert 300_000 < len(demo_cloud) < 320_000
    wall = np.abs(demo_cloud.points_world[:, 1] - 9.5555) < 6 * 0.003
    assert wall.sum() > 10_000


@pytest.mark.parametrize("name", ["table", "chair", "door", "cupboard"])
def test_the_demo_scan_sees_the_furniture(demo_cloud, name):
    points = demo_cloud.points_world[::5].astype(np.float64)
    rays = points - POSITION
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    room = furnished_room()
    _, surface = room.cast(POSITION, rays)
    names = np.array([box.name for box in room.boxes])
    assert np.sum(names[surface // 6] == name) > 200
