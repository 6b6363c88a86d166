"""Real LiDAR sweeps, rendered through the sensor's own model: its native range image comes back."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import depthwarp as dw

SWEEPS = {"os0_32": "os0_32", "os0_128_street": "os0_128_street", "os1_128_seq_0": "os1_128_seq"}


class Sweep:
    """A sweep as the sensor took it: columns are moments, before rows were set straight.

    Attributes:
        entries: Its description.
        ranges: Native range image [m], 0 = no return, shape (rows, columns).
        points: Of each pixel, in the sensor's frame [m].
        azimuth_zero: Column of azimuth 0, from the far points.
    """

    def __init__(self, folder: Path, name: str, description: str) -> None:
        for path in (folder / f"{name}.npz", folder / f"{description}.json"):
            if not path.is_file():
                pytest.skip(f"no real sweep on this machine: there is no file {path}")
        self.entries = json.loads((folder / f"{description}.json").read_text())
        data = np.load(folder / f"{name}.npz")
        rows, columns = data["range_mm"].shape
        moments = (np.arange(columns) + np.array(self.entries["pixel_shift_by_row"])[:, None]) % (
            columns
        )
        self.ranges = data["range_mm"][np.arange(rows)[:, None], moments] / 1000.0
        self.points = data["xyz"][np.arange(rows)[:, None], moments]
        self.height_of_origin = self.entries["lidar_to_sensor_transform_mm"][2][3] / 1000
        far = self.ranges > 5
        azimuth = np.arctan2(self.points[..., 1], self.points[..., 0])
        turn = azimuth + np.radians(self.entries["beam_azimuth_angles_deg"])[:, None]
        turn = turn + np.arange(columns) * 2 * np.pi / columns
        self.azimuth_zero = float(np.angle(np.exp(1j * turn[far]).mean()) * columns / 2 / np.pi)

    def lidar(self, sensor: dw.Pose | None = None, sensor_end: dw.Pose | None = None):
        """The sensor's model; poses are of the sensor's frame, whose origin is below the beams'."""
        poses = [None if pose is None else self._beams_pose(pose) for pose in (sensor, sensor_end)]
        return dw.SpinningLidar(
            self.ranges.shape[1],
            tuple(self.entries["beam_altitude_angles_deg"]),
            poses[0] or self._beams_pose(dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))),
            azimuth_zero=self.azimuth_zero,
            beam_azimuths=tuple(-np.array(self.entries["beam_azimuth_angles_deg"])),
            origin_offset=self.entries["lidar_origin_to_beam_origin_mm"] / 1000,
            pose_end=poses[1],
        )

    def _beams_pose(self, sensor: dw.Pose) -> dw.Pose:
        up = sensor.to_world(np.array([0.0, 0.0, self.height_of_origin]))
        return dw.Pose(sensor.camera_from_world, tuple(up.tolist()))

    @property
    def cloud(self) -> dw.PointCloud:
        """All returns."""
        return dw.PointCloud(self.points[self.ranges > 0])


@pytest.mark.parametrize("name", SWEEPS)
def test_every_return_is_in_its_own_beam(shared_data: Path, name):
    """Row and column of every return, its range to a millimetre; printed."""
    sweep = Sweep(shared_data / "ouster", name, SWEEPS[name])
    u, v, depth, valid = sweep.lidar().project(sweep.cloud.points_world)
    rows, columns = np.nonzero(sweep.ranges > 0)
    np.testing.assert_array_equal(v, rows)
    assert valid.all()
    width = sweep.ranges.shape[1]
    away = abs((u - columns + width / 2) % width - width / 2)
    difference = abs(depth - sweep.ranges[rows, columns])
    print(
        f"{name}: {len(rows)} returns, columns at most {away.max():.3f} px off, ranges at most "
        f"{difference.max() * 1000:.2f} mm, azimuth 0 at {sweep.azimuth_zero % width:.2f}"
    )
    assert away.max() < 0.2 and difference.max() < 0.001


@pytest.mark.parametrize("name", SWEEPS)
def test_the_native_range_image_comes_back(device, shared_data: Path, name):
    """The returns, rendered as points, fill the pixels of the file's range image; printed."""
    sweep = Sweep(shared_data / "ouster", name, SWEEPS[name])
    depth_map = dw.render(sweep.cloud, sweep.lidar(), max_range=500, device=device)
    native = sweep.ranges
    same = ((depth_map.depth > 0) == (native > 0)).mean()
    both = (depth_map.depth > 0) & (native > 0)
    difference = abs(depth_map.depth - native)[both]
    print(
        f"{name}: {same:.3%} of the pixels agree on whether there is a return; ranges differ by "
        f"{np.median(difference) * 1000:.3f} mm (median), {difference.max() * 1000:.2f} mm at most"
    )
    assert same == 1
    assert difference.max() < 0.001
    again = dw.render(depth_map.unproject(), sweep.lidar(), max_range=500, device=device)
    np.testing.assert_array_equal(again.depth > 0, depth_map.depth > 0)
    np.testing.assert_allclose(again.depth, depth_map.depth, atol=2e-4)


def test_the_next_sweep_through_the_moving_model(device, shared_data: Path):
    """Sweep 0, each column placed by its own pose, seen by the sensor that drives on; printed.

    At even speed both sweeps are distorted alike, so the still model does as well here: what the
    recording can show is that the moving one brings its own distortion back.
    """
    folder = shared_data / "ouster"
    first, second = (Sweep(folder, f"os1_128_seq_{k}", "os1_128_seq") for k in (0, 1))
    poses = [
        dw.Pose(tuple(map(tuple, world[:3, :3].T.tolist())), tuple(world[:3, 3].tolist()))
        for world in np.array(first.entries["T_world_from_sensor_per_frame"])
    ]
    medians = {}
    for motion in ("still", "moving"):
        ends = poses[1:] if motion == "moving" else (None, None)
        ours, following = first.lidar(poses[0], ends[0]), second.lidar(poses[1], ends[1])
        points = ours.unproject(first.ranges)
        cloud = dw.PointCloud(points[np.isfinite(points[..., 0])].astype(np.float32))
        depth_map = dw.render(cloud, following, max_range=500, device=device)
        both = (depth_map.depth > 0) & (second.ranges > 0)
        medians[motion] = float(np.median(abs(depth_map.depth - second.ranges)[both]))
        print(
            f"sweep 0 seen as sweep 1, {motion}: {both.mean():.0%} of the pixels, median "
            f"difference {medians[motion] * 1000:.1f} mm"
        )
    assert max(medians.values()) < 0.05
