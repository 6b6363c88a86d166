"""The spinning LiDAR: beams to rows, moments to columns, and a sensor that moves."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings

import depthwarp as dw
from depthwarp.errors import InputError
from tests.cameras.device_image import device_image
from tests.cameras.models import IDENTITY, cameras_of, moved
from tests.rendering.strategies import seeds

BEAMS = (10.0, 0.0, -10.0)


def beam_points(lidar: dw.SpinningLidar, ranges: np.ndarray) -> np.ndarray:
    """Where every beam of every column ends, as Ouster's manual states it: (rows, columns, 3).

    The head is at the angle of its column; a beam starts `origin_offset` from the axis in that
    direction, and runs at its elevation, turned from the head by its azimuth.
    """
    column, row = np.meshgrid(np.arange(lidar.width), np.arange(lidar.height))
    head = (lidar.cx - column) * 2 * np.pi / lidar.width
    own = np.zeros(lidar.height) if lidar.beam_azimuths is None else lidar.beam_azimuths
    azimuth = head + np.radians(own)[row]
    elevation = np.radians(lidar.beam_elevations)[row]
    way = ranges - lidar.origin_offset
    return np.stack(
        [
            way * np.cos(azimuth) * np.cos(elevation) + lidar.origin_offset * np.cos(head),
            way * np.sin(azimuth) * np.cos(elevation) + lidar.origin_offset * np.sin(head),
            way * np.sin(elevation),
        ],
        axis=-1,
    )


@settings(max_examples=40)
@given(camera=cameras_of("spinning"), seed=seeds)
def test_every_beam_is_drawn_in_its_own_pixel(camera, seed):
    """Points on the beams, of the manual's formula: row, column and range come back."""
    shape = camera.height, camera.width
    ranges = np.random.default_rng(seed).uniform(2, 50, shape)
    world = camera.pose.to_world(beam_points(camera, ranges)).reshape(-1, 3)
    u, v, depth, _ = camera.project(world)
    rows, columns = np.indices(shape)
    np.testing.assert_array_equal(v.reshape(shape), rows)
    away = abs(u.reshape(shape) - columns)
    assert np.minimum(away, camera.width - away).max() < 0.02
    np.testing.assert_allclose(depth.reshape(shape), ranges, atol=1e-3)


def test_the_kernel_is_within_a_hundredth_of_a_pixel(device):
    """10^5 points in a turn of 4096 columns, still and moving; printed."""
    rng = np.random.default_rng(1)
    elevations, azimuths = np.linspace(20, -25, 64), rng.uniform(-8, 8, 64)
    pose = dw.Pose.from_orientation((1, 2, 0.5), (3, -4, 50))
    still = dw.SpinningLidar(4096, tuple(elevations), pose, 100.0, tuple(azimuths), 0.03)
    moving = dataclasses.replace(still, pose_end=moved(rng, pose))
    for lidar in (still, moving):
        points = rng.uniform(-30, 30, (100_000, 3)) * (1, 1, 0.25)
        points = points[np.hypot(*points[:, :2].T) > 3].astype(np.float32)
        u, v, _, _ = lidar.project(points)
        ours = device_image(lidar, points, device).astype(np.float64)
        same = ours[1] == v
        assert same.sum() > 0.999 * np.isfinite(v).sum()  # but for some between two beams
        away = abs(ours[0] - u)[same]
        error = np.minimum(away, 4096 - away)
        seam = np.minimum(u[same] + 0.5, 4095.5 - u[same]) < 30  # a moving sensor meets it twice
        print(f"spinning, {'moving' if lidar.pose_end else 'still'}: {error[~seam].max():.5f} px")
        assert error[~seam].max() < 0.01


def test_a_row_is_the_nearest_beam(device):
    """Half-way between two beams rows change; half a step outside the outermost ones they end."""
    lidar = dw.SpinningLidar(8, (0.0, 10.0, -10.0), IDENTITY)
    elevation = np.radians([14.9, 15.1, 5.1, 4.9, -4.9, -5.1, -14.9, -15.1])
    points = np.stack([np.cos(elevation), 0 * elevation, np.sin(elevation)], axis=1)
    points = points.astype(np.float32)
    _, v, _, valid = lidar.project(points)
    np.testing.assert_array_equal(v, [1, np.nan, 1, 0, 0, 2, 2, np.nan])
    np.testing.assert_array_equal(valid, np.isfinite(v))
    np.testing.assert_array_equal(device_image(lidar, points, device)[1][valid], v[valid])
    assert dw.render(dw.PointCloud(points), lidar, device=device).stats.outside == 2


@pytest.mark.parametrize("zero", [-1000.0, -1.0, 0.0, 3.2, 15.0, 16.0, 777.0])
def test_azimuth_zero_is_a_column_of_the_turn(device, zero):
    """Any column, counted on over several turns; nothing is lost at the seam."""
    lidar = dw.SpinningLidar(16, BEAMS, IDENTITY, azimuth_zero=zero)
    azimuth = np.linspace(-np.pi, np.pi, 1000)
    points = np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], axis=1).astype(np.float32)
    depth_map = dw.render(dw.PointCloud(points), lidar, device=device)
    assert depth_map.stats.outside == 0 and (depth_map.depth[1] > 0).all()
    u, _, _, valid = lidar.project(points[499:501])
    assert valid.all()
    expected = (zero % 16 + 0.5) % 16 - 0.5
    assert np.abs((u - expected + 8) % 16 - 8).max() < 0.01


def test_it_turns_clockwise_seen_from_above():
    """Columns after that of azimuth 0 see what is to the right."""
    lidar = dw.SpinningLidar(360, BEAMS, IDENTITY)
    u, _, _, _ = lidar.project(np.array([[5.0, 0, 0], [0, -5, 0], [0, 5, 0]]))
    np.testing.assert_allclose(u, [179.5, 269.5, 89.5])


def test_inside_the_beams_origins_nothing_is_seen(device):
    """Nearer to the axis than the beams start: outside, at the very centre too near."""
    lidar = dw.SpinningLidar(16, BEAMS, IDENTITY, origin_offset=0.03)
    points = np.float32([[0.02, 0, 0], [0, 0, 1], [0, 0, 0], [0.5, 0, 0]])
    stats = dw.render(dw.PointCloud(points), lidar, device=device).stats
    assert (stats.outside, stats.too_near, stats.drawn) == (2, 1, 1)
    assert lidar.project(points)[3].tolist() == [False, False, False, True]


# --- a sensor that moves ---


def test_a_moving_sensor_by_hand(device):
    """1 m ahead a turn: what it meets in the last quarter is nearer by three quarters of that."""
    end = dw.Pose.from_orientation((1, 0, 0), (0, 0, 0))
    lidar = dw.SpinningLidar(400, BEAMS, IDENTITY, azimuth_zero=300.0, pose_end=end)
    points = np.float32([[10, 0, 0]])
    u, v, depth, valid = lidar.project(points)
    assert (u[0], v[0], valid[0]) == (pytest.approx(300), 1, True)
    assert depth[0] == pytest.approx(10 - 0.75)
    depth_map = dw.render(dw.PointCloud(points), lidar, device=device)
    assert depth_map.depth[1, 300] == pytest.approx(9.25, abs=1e-5)


@settings(max_examples=20)
@given(seed=seeds)
def test_each_column_sees_from_its_own_pose(seed):
    """A beam's point of column k, placed by the pose of k of n in a turn, is drawn in column k."""
    rng = np.random.default_rng(seed)
    pose = dw.Pose.from_orientation(rng.uniform(-3, 3, 3), rng.uniform(-180, 180, 3))
    end = moved(rng, pose)
    lidar = dw.SpinningLidar(90, BEAMS, pose, 20.0, None, 0.03, end)
    still = dataclasses.replace(lidar, pose_end=None)
    ranges = rng.uniform(1.5, 40, (3, 90))
    rotations, centers = lidar.column_poses
    np.testing.assert_allclose(rotations[0], pose.rotation, atol=1e-12)
    np.testing.assert_allclose(
        centers, pose.center_world + np.outer(np.arange(90) / 90, end.center_world - centers[0])
    )
    camera_points = beam_points(still, ranges)[:, 3:-3]  # not at the seam, which it meets twice
    world = np.einsum("kji,rkj->rki", rotations[3:-3], camera_points) + centers[3:-3]
    u, v, depth, _ = lidar.project(world.reshape(-1, 3))
    np.testing.assert_allclose(u.reshape(3, -1), np.tile(np.arange(3, 87), (3, 1)), atol=2e-3)
    np.testing.assert_array_equal(v.reshape(3, -1), np.indices((3, 84))[0])
    np.testing.assert_allclose(depth.reshape(3, -1), ranges[:, 3:-3], atol=1e-4)


def test_the_outermost_beams_of_a_sensor_that_pitches(device):
    """What no beam reaches from the middle of the turn is met in its own column all the same."""
    end = dw.Pose.from_orientation((0, 0, 0), (0, 4, 0))
    beams = tuple(np.linspace(2, -2, 9).tolist())
    lidar = dw.SpinningLidar(90, beams, IDENTITY, azimuth_zero=80.0, pose_end=end)
    world = lidar.unproject(np.full((9, 90), 10.0))
    from_the_middle = dataclasses.replace(
        lidar, pose_end=None, pose=dw.Pose.from_orientation((0, 0, 0), (0, 2, 0))
    )
    points = world[:, 70:87].reshape(-1, 3).astype(np.float32)
    assert not from_the_middle.project(points)[3].all()
    assert lidar.project(points)[3].all()
    depth_map = dw.render(dw.PointCloud(points), lidar, device=device)
    assert (depth_map.depth[:, 70:87] > 0).all() and depth_map.stats.drawn == len(points)


def test_a_sensor_at_rest_is_a_still_one(device):
    """`pose_end` equal to `pose`: the same winners as without."""
    pose = dw.Pose.from_orientation((1, 2, 3), (10, 20, 30))
    still = dw.SpinningLidar(64, tuple(np.linspace(30, -30, 16)), pose)
    moving = dataclasses.replace(still, pose_end=pose)
    points = np.random.default_rng(3).uniform(-8, 8, (3000, 3)).astype(np.float32)
    maps = [dw.render(dw.PointCloud(points), lidar, device=device) for lidar in (still, moving)]
    assert (maps[0].index == maps[1].index).mean() > 0.999
    np.testing.assert_allclose(maps[0].depth, maps[1].depth, atol=1e-5)


@given(seed=seeds)
@settings(max_examples=20)
def test_another_place_takes_the_motion_along(seed):
    """`with_pose`: seen from the sensor, its way and its turn are the same as before."""
    rng = np.random.default_rng(seed)
    first, second = (
        dw.Pose.from_orientation(rng.uniform(-3, 3, 3), rng.uniform(-180, 180, 3)) for _ in "ab"
    )
    lidar = dw.SpinningLidar(16, BEAMS, first, pose_end=moved(rng, first))
    points = rng.uniform(-9, 9, (40, 3))
    there = lidar.with_pose(second)
    assert there.pose == second
    same = second.to_world(first.to_camera(points))
    for ours, theirs in zip(lidar.project(points), there.project(same), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-6)
    assert dataclasses.replace(lidar, pose_end=None).with_pose(second).pose_end is None


# --- bad input ---


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"beam_elevations": (1.0,)}, "at least two"),
        ({"beam_elevations": (1.0, 1.0)}, "different"),
        ({"beam_elevations": (1.0, 90.0)}, "below 90"),
        ({"beam_elevations": (1.0, math.nan)}, "beam_elevations"),
        ({"width": 1}, "at least 2 columns"),
        ({"width": 0}, "size must be"),
        ({"azimuth_zero": math.inf}, "azimuth_zero"),
        ({"beam_azimuths": (1.0, 2.0)}, "beam_azimuths"),
        ({"beam_azimuths": (1.0, 2.0, 31.0)}, "within 30 degrees"),
        ({"origin_offset": -0.1}, "origin_offset"),
        ({"origin_offset": math.nan}, "origin_offset"),
    ],
)
def test_numbers_that_are_no_sensor_are_refused(changes, message):
    """Each by name."""
    with pytest.raises(InputError, match=message):
        dw.SpinningLidar(**({"width": 16, "beam_elevations": BEAMS, "pose": IDENTITY} | changes))


def test_z_depth_is_refused():
    """A LiDAR has no optical axis."""
    lidar = dw.SpinningLidar(16, BEAMS, IDENTITY)
    with pytest.raises(InputError, match="optical axis"):
        lidar.project(np.ones((1, 3)), depth="z")


@pytest.mark.parametrize(
    ("yaw", "way", "distance"),
    [(60, 2, 2), (-60, 2, 2), (60, 0, 2), (0, 2, 2), (60, 2, 30), (90, 0, 5), (0, 3, 1.5)],
)
def test_fast_motions_come_back(device, yaw, way, distance):
    """Away from the seam every pixel that is unprojected is projected to itself; printed."""
    worst = 0.0
    beams = tuple(np.linspace(15, -25, 8).tolist())
    offsets = tuple(np.linspace(-3, 3, 8).tolist())
    start = dw.Pose.from_orientation((0, 0, 0), (0, 0, 20))
    for heading in np.radians((20, 110, 200, 290)):
        place = (way * np.cos(heading), way * np.sin(heading), 0)
        end = dw.Pose.from_orientation(place, (0, 0, 20 + yaw))
        lidar = dw.SpinningLidar(1024, beams, start, None, offsets, 0.03, end)
        points = lidar.unproject(np.full((8, 1024), distance))[:, 210:814].reshape(-1, 3)
        u, v, depth, valid = lidar.project(points)
        rows, columns = np.indices((8, 604))
        assert valid.all()
        np.testing.assert_array_equal(v, rows.ravel())
        np.testing.assert_allclose(depth, distance, atol=1e-3)
        worst = max(worst, np.abs(u - 210 - columns.ravel()).max())
        device_u = device_image(lidar, points.astype(np.float32), device)[0]
        assert np.abs(device_u - 210 - columns.ravel()).max() < 0.02
    print(f"{yaw} degrees and {way} m a turn at {distance} m: {worst:.5f} px")
    assert worst < 0.01


def test_a_sensor_that_turns_against_its_spin_misses_a_part(device):
    """It turns left by 60 degrees a turn: in the gap nothing is drawn, all else once."""
    end = dw.Pose.from_orientation((0, 0, 0), (0, 0, 60))
    lidar = dw.SpinningLidar(360, BEAMS, IDENTITY, pose_end=end)
    azimuth = np.radians(np.arange(0, 360, 0.5))
    points = 5 * np.stack([np.cos(azimuth), np.sin(azimuth), 0 * azimuth], axis=1)
    u, _, _, valid = lidar.project(points.astype(np.float32))
    assert valid.sum() == pytest.approx(600, abs=2)  # of 720: 300 degrees
    assert len(np.unique(np.floor(u[valid] + 0.5))) == 360
    depth_map = dw.render(dw.PointCloud(points.astype(np.float32)), lidar, device=device)
    assert depth_map.stats.outside == pytest.approx(120, abs=2)
    assert depth_map.stats.too_near == depth_map.stats.not_finite == 0
    np.testing.assert_allclose(depth_map.depth[1][depth_map.depth[1] > 0], 5, atol=1e-4)


def test_a_sensor_that_turns_with_its_spin_sees_a_part_twice():
    """It turns right by 60 degrees a turn: every point has one column, which does see it."""
    end = dw.Pose.from_orientation((0, 0, 0), (0, 0, -60))
    lidar = dw.SpinningLidar(360, BEAMS, IDENTITY, pose_end=end)
    world = lidar.unproject(np.full((3, 360), 5.0))[1]
    u, _, depth, valid = lidar.project(world)
    assert valid.all()
    np.testing.assert_allclose(depth, 5, rtol=1e-5)
    # The column found is the point's own, or the other one in which it is seen.
    seen = world[np.floor(u + 0.5).astype(int)]
    np.testing.assert_allclose(seen, world, atol=0.1)
    twice = np.abs(u - np.arange(360)) > 1
    assert 40 < np.count_nonzero(twice) < 80
