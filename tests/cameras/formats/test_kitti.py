"""KITTI's calibration files, against the development kit's formula P R0_rect Tr x."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import depthwarp as dw
from depthwarp.errors import FileFormatError, InputError

SIZE = (1242, 375)

K = np.array([[721.5377, 0, 609.5593], [0, 721.5377, 172.854], [0, 0, 1]])

P = {
    "P0": np.column_stack([K, [0, 0, 0]]),
    "P1": np.column_stack([K, [-387.5744, 0, 0]]),
    "P2": np.column_stack([K, [44.85728, 0.2163791, 0.002745884]]),
    "P3": np.column_stack([K, [-339.5242, 2.199936, 0.002729905]]),
}
R0 = np.array(
    [
        [9.999239e-01, 9.837760e-03, -7.445048e-03],
        [-9.869795e-03, 9.999421e-01, -4.278459e-03],
        [7.402527e-03, 4.351614e-03, 9.999631e-01],
    ]
)
TR = np.array(
    [
        [7.533745e-03, -9.999714e-01, -6.166020e-04, -4.069766e-03],
        [1.480249e-02, 7.280733e-04, -9.998902e-01, -7.631618e-02],
        [9.998621e-01, 7.523790e-03, 1.480755e-02, -2.717806e-01],
    ]
)

RAW = """calib_time: 09-Jan-2012 13:57:47
corner_dist: 9.950000e-02
S_00: 1.392000e+03 5.120000e+02
K_00: 9.842439e+02 0.000000e+00 6.900000e+02 0 9.808141e+02 2.331966e+02 0 0 1
D_00: -3.728755e-01 2.037299e-01 2.219027e-03 1.383707e-03 -7.233722e-02
R_00: 1 0 0 0 1 0 0 0 1
T_00: 2.573699e-16 -1.059758e-16 1.614870e-16
S_rect_00: 1.242000e+03 3.750000e+02
R_rect_00: {R0}
P_rect_00: {P0}
S_rect_02: 6.210000e+02 1.880000e+02
P_rect_02: {P2}
"""


def text_of(matrix):
    """A matrix as in the files, row by row."""
    return " ".join(repr(value) for value in np.ravel(matrix).tolist())


def calibration(matrices=None, R0=R0, TR=TR):
    """A benchmark's file."""
    lines = [f"{name}: {text_of(matrix)}" for name, matrix in (matrices or P).items()]
    lines += [f"R0_rect: {text_of(R0)}", f"Tr_velo_to_cam: {text_of(TR)}"]
    return "\n".join([*lines, f"Tr_imu_to_velo: {text_of(np.eye(4)[:3])}"]) + "\n\n"


def devkit(matrix, points, R0=R0, TR=TR):
    """Pixels and w of points in the LiDAR's frame, as the development kit computes them."""
    rectified, lidar = np.eye(4), np.eye(4)
    rectified[:3, :3], lidar[:3] = R0, TR
    x, y, w = matrix @ rectified @ lidar @ np.column_stack([points, np.ones(len(points))]).T
    return np.column_stack([x / w, y / w]), w


def check(camera, matrix, points, R0=R0, TR=TR):
    """Pixels and depths of all points ahead are the development kit's; nothing behind is drawn."""
    expected, w = devkit(matrix, points, R0, TR)
    u, v, depth, valid = camera.project(points, "z")
    ahead = w > 0.1
    assert ahead.sum() > 100
    tolerance = {"rtol": 1e-9, "atol": 1e-9}
    np.testing.assert_allclose(np.column_stack([u, v])[ahead], expected[ahead], **tolerance)
    np.testing.assert_allclose(depth[ahead], w[ahead], rtol=0, atol=1e-9)
    assert not valid[w < 0].any()


@pytest.fixture
def points() -> np.ndarray:
    """Points all around a LiDAR [m]."""
    return np.random.default_rng(4).uniform(-40, 40, (2000, 3)) * (1, 1, 0.1)


@pytest.mark.parametrize("name", P)
def test_every_camera_projects_as_the_development_kit(tmp_path, points, name):
    """The fourth column is the baseline, its third entry too."""
    path = tmp_path / "calib.txt"
    path.write_text(calibration())
    rig = dw.cameras.load_rig(path, size=SIZE)
    assert rig.names == tuple(P)
    camera = dw.cameras.load(path, name, size=SIZE)
    assert camera == rig[name] and camera.size == SIZE
    np.testing.assert_array_equal(camera.K, K)
    check(camera, P[name], points)


def test_the_baseline_is_exact(tmp_path):
    """With no rotation: camera 1 stands 387.5744 / 721.5377 m to the right of camera 0."""
    path = tmp_path / "calib.txt"
    axes = np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0]])
    path.write_text(calibration(R0=np.eye(3), TR=axes))
    rig = dw.cameras.load_rig(path, size=SIZE)
    np.testing.assert_array_equal(rig["P0"].pose.center_world, (0, 0, 0))
    right = rig["P1"].pose.center_world
    np.testing.assert_allclose(right, (0, -387.5744 / 721.5377, 0), rtol=0, atol=1e-15)
    shift = (44.85728 - 609.5593 * 0.002745884) / 721.5377
    drop = (0.2163791 - 172.854 * 0.002745884) / 721.5377
    expected = (-0.002745884, shift, drop)  # X forward, Y left, Z up
    np.testing.assert_allclose(rig["P2"].pose.center_world, expected, rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    "name", ["testing_000000", "testing_000002", "testing_000007", "training_000008"]
)
def test_real_sweeps_fall_where_the_development_kit_puts_them(tmp_path, shared_data: Path, name):
    """The matrices of real frames in a file, a real sweep: every pixel, and the count in view."""
    folder = shared_data / "kitti"
    if not (folder / f"{name}.bin").is_file():
        pytest.skip(f"no real scan on this machine: there is no file {name}.bin in {folder}")
    entries = json.loads((folder / f"{name}_calib.json").read_text())
    matrix = np.array(entries["P2_3x4"])
    R0, TR = np.array(entries["R0_rect_4x4"])[:3, :3], np.array(entries["Tr_velo_to_cam_4x4"])[:3]
    path = tmp_path / "calib.txt"
    path.write_text(calibration({"P2": matrix}, R0, TR))
    camera = dw.cameras.load(path, size=(entries["width"], entries["height"]))
    points = dw.read(folder / f"{name}.bin").points_world.astype(np.float64)
    check(camera, matrix, points, R0, TR)
    expected = entries["check_points_in_image_pixel_centres_integer"]
    assert camera.project(points)[3].sum() == expected


def test_the_names_of_other_benchmarks(tmp_path, points):
    """Odometry says Tr and has no R0_rect; tracking leaves out colons."""
    path = tmp_path / "calib.txt"
    tracking = calibration().replace("R0_rect:", "R_rect").replace("Tr_velo_to_cam:", "Tr_velo_cam")
    path.write_text(tracking)
    check(dw.cameras.load(path, "P3", size=SIZE), P["P3"], points)
    lines = calibration().replace("Tr_velo_to_cam", "Tr").splitlines()
    path.write_text("\n".join(line for line in lines if not line.startswith("R0")))
    check(dw.cameras.load(path, "P3", size=SIZE), P["P3"], points, R0=np.eye(3))


def test_projection_matrices_alone_are_in_the_first_cameras_frame(tmp_path):
    """The odometry benchmark's grey sequences: the world has camera 0's optical axes."""
    path = tmp_path / "calib.txt"
    path.write_text("\n".join(calibration().splitlines()[:4]))
    rig = dw.cameras.load_rig(path, size=SIZE)
    np.testing.assert_array_equal(rig["P0"].pose.optical_from_world, np.eye(4))
    # With fewer than four of them, the file was cut short: the LiDAR's frame got lost.
    path.write_text("\n".join(calibration().splitlines()[:3]))
    with pytest.raises(FileFormatError, match="no entry 'Tr_velo_to_cam or"):
        dw.cameras.load_rig(path, size=SIZE)


def test_the_raw_datas_file_holds_sizes(tmp_path):
    """Each camera has its own; the world is camera 0's frame before rectification."""
    path = tmp_path / "calib_cam_to_cam.txt"
    path.write_text(RAW.format(R0=text_of(R0), P0=text_of(P["P0"]), P2=text_of(P["P2"])))
    rig = dw.cameras.load_rig(path)
    assert {name: camera.size for name, camera in rig.items()} == {
        "P0": (1242, 375),
        "P2": (621, 188),
    }
    points = np.random.default_rng(5).uniform(-20, 20, (1000, 3))
    check(rig["P2"], P["P2"], points, R0, np.eye(4)[:3])
    with pytest.raises(InputError, match="1242 x 375 pixels by the file, size says 640 x 480"):
        dw.cameras.load_rig(path, size=(640, 480))


def test_a_missing_size_has_a_remedy(tmp_path):
    """The error names the argument and gives an example."""
    path = tmp_path / "calib.txt"
    path.write_text(calibration())
    with pytest.raises(InputError, match=r"no image size: give size=\(width, height\).*1242, 375"):
        dw.cameras.load(path, "P2")


def test_what_is_written_is_read_back(tmp_path, points):
    """Equal lenses, poses to 1e-12; other names become P0, P1, ..."""
    path, again = tmp_path / "calib.txt", tmp_path / "again.txt"
    path.write_text(calibration())
    rig = dw.cameras.load_rig(path, size=SIZE)
    stereo = dw.cameras.Rig(("left", "right"), rig.cameras[2:])
    for given, names in ((rig, tuple(P)), (stereo, ("P0", "P1"))):
        dw.cameras.save(given, again, format="kitti")
        back = dw.cameras.load_rig(again, size=SIZE)
        assert back.names == names
        for name, camera in zip(names, given.cameras, strict=True):
            assert back[name].with_pose(camera.pose) == camera
            np.testing.assert_allclose(
                back[name].pose.optical_from_world,
                camera.pose.optical_from_world,
                rtol=0,
                atol=1e-12,
            )
    check(dw.cameras.load(again, "P1", size=SIZE), P["P3"], points)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("P2: 721.5377", "P2: 0.0", "fx must be a finite number above 0"),
        ("P2: 721.5377", "P2: nan", "finite"),
        ("P2: 721.5377", "P2: 721.5377x", "could not convert"),
        ("P2: 721.5377 0.0", "P2: 721.5377 3", "skew"),
        ("P2: 721.5377 ", "P2: ", "P2 must be 12 numbers, got 11"),
        ("R0_rect: 0.9999239", "R0_rect: 0.9", "R0_rect: .* not a rotation .* by 0.19"),
        ("R0_rect: ", "R0_rect: 1 ", "R0_rect must be 9 numbers, got 10"),
        ("Tr_velo_to_cam", "Tr_to_cam", "no entry 'Tr_velo_to_cam or Tr_velo_cam or Tr'"),
    ],
)
def test_bad_content_is_refused(tmp_path, old, new, message):
    """The message names the file and the entry."""
    path = tmp_path / "bad.txt"
    assert old in calibration()
    path.write_text(calibration().replace(old, new))
    with pytest.raises(FileFormatError, match=message) as caught:
        dw.cameras.load(path, "P2", size=SIZE)
    assert "bad.txt" in str(caught.value)


def test_what_the_format_cannot_hold_is_refused(tmp_path):
    """Cameras that are not parallel (by how much), distortion, more than four."""
    one = dw.PinholeCamera.from_matrix(K, SIZE)
    turned = one.with_pose(dw.Pose.from_orientation((0, 0, 0), (0, 0, 1)))
    ahead = one.with_pose(dw.Pose.from_orientation((0, 0, 0), (0, 0, 0)))
    path = tmp_path / "calib.txt"
    with pytest.raises(InputError, match="rotation of 'P1' differs from that of 'P0' by 0.0175"):
        dw.cameras.save(dw.cameras.Rig.of({"a": ahead, "b": turned}), path, format="kitti")
    with pytest.raises(InputError, match="up to 4 cameras, the rig has 5"):
        dw.cameras.save(dw.cameras.Rig.of({str(k): one for k in range(5)}), path, format="kitti")
    bent = dw.PinholeCamera.from_matrix(K, SIZE, (0.01, 0, 0, 0))
    with pytest.raises(InputError, match="no lens distortion"):
        dw.cameras.save(bent, path, format="kitti")
    assert not path.exists()


def test_the_raw_datas_lidar_beside_the_cameras(tmp_path, points):
    """With calib_velo_to_cam.txt beside it the world is the LiDAR's frame, as in a benchmark."""
    path = tmp_path / "calib_cam_to_cam.txt"
    path.write_text(RAW.format(R0=text_of(R0), P0=text_of(P["P0"]), P2=text_of(P["P2"])))
    beside = tmp_path / "calib_velo_to_cam.txt"
    lidar = f"R: {text_of(TR[:, :3])}\nT: {text_of(TR[:, 3])}\ndelta_f: 0 0\n"
    beside.write_text("calib_time: 15-Mar-2012 11:37:16\n" + lidar)
    check(dw.cameras.load(path, "P2"), P["P2"], points)
    for old, new, message in (("T:", "X:", "no entry 'T'"), ("R: 0.0", "R: 0.5", "not a rotation")):
        beside.write_text(lidar.replace(old, new, 1))
        with pytest.raises(FileFormatError, match=f"calib_velo_to_cam.txt.*{message}"):
            dw.cameras.load(path, "P2")


def test_the_raw_data_without_its_rotation(tmp_path):
    """The message names the raw data's own entry."""
    path = tmp_path / "calib_cam_to_cam.txt"
    text = RAW.format(R0=text_of(R0), P0=text_of(P["P0"]), P2=text_of(P["P2"]))
    path.write_text(text.replace("R_rect_00", "R_lost_00"))
    with pytest.raises(FileFormatError, match="no entry 'R_rect_00'"):
        dw.cameras.load_rig(path)
