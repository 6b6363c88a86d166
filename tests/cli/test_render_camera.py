"""`depthwarp render --camera FILE`: lenses and poses from the files of other programs."""

from __future__ import annotations

import numpy as np
import pytest

import depthwarp as dw

FISHEYE = dw.FisheyeCamera(
    20.0,
    20.0,
    31.5,
    23.5,
    64,
    48,
    dw.Pose.from_orientation((0.1, 0, 0), (0, 0, 5)),
    (0.01, 0, 0, 0),
)
RIG = dw.cameras.Rig.of(
    {
        "left.png": dw.PinholeCamera.from_fov((70, 50), (64, 48), (0, 0.2, 0)),
        "right.png": dw.PinholeCamera.from_fov((70, 50), (32, 24), (0, -0.2, 0)),
    }
)


def rendered(run, wall, output, *arguments) -> dw.DepthMap:
    """The map that the command writes with raw depths."""
    result = run("render", wall, "-o", output, "--filters", "none", *arguments)
    assert result.exit_code == 0, result.stderr
    return dw.DepthMap.load(output)


def test_a_lens_and_its_pose_come_from_the_file(run, wall, tmp_path):
    """A fisheye of OpenCV's FileStorage draws what it draws in Python."""
    dw.cameras.save(FISHEYE, tmp_path / "lens.yaml", format="opencv")
    found = rendered(run, wall, tmp_path / "d.npz", "--camera", tmp_path / "lens.yaml")
    expected = dw.render(dw.read(wall), dw.cameras.load(tmp_path / "lens.yaml"))
    np.testing.assert_array_equal(found.depth, expected.depth)
    assert found.camera == expected.camera and expected.stats.drawn > 100


def test_the_lens_of_a_file_at_another_place(run, wall, tmp_path):
    """--position and --orientation keep the lens and move the camera."""
    dw.cameras.save(FISHEYE, tmp_path / "lens.yaml", format="opencv")
    place = ["--position", "0.5", "0.1", "0.2", "--orientation", "0", "4", "8"]
    found = rendered(run, wall, tmp_path / "d.npz", "--camera", tmp_path / "lens.yaml", *place)
    pose = dw.Pose.from_orientation((0.5, 0.1, 0.2), (0, 4, 8))
    assert found.camera == FISHEYE.with_pose(pose)


def test_one_of_several_cameras_by_name(run, wall, tmp_path):
    """Of a COLMAP model a name chooses; without one the message lists them."""
    dw.cameras.save(RIG, tmp_path / "model", format="colmap")
    camera = ["--camera", tmp_path / "model"]
    found = rendered(run, wall, tmp_path / "d.npz", *camera, "--camera-name", "right.png")
    assert found.camera.size == (32, 24)
    result = run("render", wall, "-o", tmp_path / "e.npz", *camera)
    assert result.exit_code == 2 and "left.png, right.png" in result.stderr
    assert "--camera-name NAME" in result.stderr and "load_rig" not in result.stderr
    assert not (tmp_path / "e.npz").exists()


def test_a_file_without_a_size_takes_the_options(run, wall, tmp_path):
    """KITTI's calib.txt holds no size: --size gives it."""
    rows = "700 0 31.5 0 0 700 23.5 0 0 0 1 0"
    lidar = "0 -1 0 0 0 0 -1 0 1 0 0 0"
    (tmp_path / "calib.txt").write_text(
        "".join(f"P{n}: {rows}\n" for n in range(4))
        + f"R0_rect: 1 0 0 0 1 0 0 0 1\nTr_velo_to_cam: {lidar}\n"
    )
    camera = ["--camera", tmp_path / "calib.txt", "--camera-name", "P2"]
    found = rendered(run, wall, tmp_path / "d.npz", *camera, "--size", "64", "48")
    assert found.camera.size == (64, 48)
    result = run("render", wall, "-o", tmp_path / "e.npz", *camera)
    assert result.exit_code == 2 and "on the command line: --size W H" in result.stderr


def test_lost_pixels_are_a_warning_in_one_line(run, wall, tmp_path):
    """A lens that folds back inside its image renders, and says which share stays empty."""
    pose = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))
    with pytest.warns(dw.errors.LensDomainWarning):
        lens = dw.PinholeCamera(40.0, 40.0, 31.5, 23.5, 64, 48, pose, (-0.5, 0, 0, 0))
    dw.cameras.save(lens, tmp_path / "lens.yaml", format="opencv")
    output = tmp_path / "d.npz"
    result = run("render", wall, "-o", output, "--camera", tmp_path / "lens.yaml")
    assert result.exit_code == 0, result.stderr
    (line,) = [line for line in result.stderr.splitlines() if line.startswith("warning: ")]
    assert f"{tmp_path / 'lens.yaml'}: PinholeCamera" in line
    assert "%" in line and ".py" not in line


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--fov", "60", "60"), "leave out --fov"),
        (("--q-depth-map", "0.1"), "leave out --fov"),
        (("--position", "0", "0", "0"), "give both --position and --orientation"),
        (("--position-frame", "rotated"), "belongs to --position"),
        (("--camera-name", "other"), "no camera 'other'"),
        (("--size", "5", "5"), "size"),
        (("--depth", "z"), "use depth='range'"),
    ],
)
def test_options_that_contradict_the_file(run, wall, tmp_path, arguments, message):
    """Nothing is ignored: each is refused in one line, and nothing is written."""
    panorama = dw.EquirectangularCamera.looking((36, 18))
    dw.render(dw.read(wall), panorama).save(tmp_path / "p.npz")
    output = tmp_path / "d.npz"
    result = run("render", wall, "-o", output, "--camera", tmp_path / "p.npz", *arguments)
    assert result.exit_code == 2 and message in result.stderr
    assert not output.exists()


def test_a_file_that_is_no_camera(run, wall, tmp_path):
    """The message lists what is known."""
    (tmp_path / "notes.txt").write_text("remember the milk\n")
    output = tmp_path / "d.npz"
    result = run("render", wall, "-o", output, "--camera", tmp_path / "notes.txt")
    assert result.exit_code == 2 and "COLMAP" in result.stderr
    assert len(result.stderr.strip().splitlines()) <= 4


def test_a_name_without_a_file(run, wall, tmp_path):
    """--camera-name alone is refused."""
    result = run("render", wall, "-o", tmp_path / "d.npz", "--camera-name", "left")
    assert result.exit_code == 2 and "--camera FILE" in result.stderr


INTRINSICS = """%YAML:1.0
---
image_width: 64
image_height: 48
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 40., 0., 31.5, 0., 40., 23.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 0., 0., 0., 0., 0. ]
"""


def test_a_file_without_a_pose_says_where_the_camera_looks(run, wall, tmp_path):
    """Once, in one line; not with a pose in the file or on the command line."""
    (tmp_path / "calib.yaml").write_text(INTRINSICS)
    dw.cameras.save(FISHEYE, tmp_path / "posed.yaml", format="opencv")
    place = ["--position", "0", "0", "0", "--orientation", "0", "0", "0"]
    said = {}
    for name, options in (("calib.yaml", []), ("calib.yaml", place), ("posed.yaml", [])):
        path = tmp_path / name
        result = run("render", wall, "-o", tmp_path / "d.npz", "--camera", path, *options)
        assert result.exit_code == 0, result.stderr
        said[name, len(options)] = [
            line for line in result.stderr.splitlines() if "says no pose" in line
        ]
    (line,) = said.pop(("calib.yaml", 0))
    assert line.startswith(str(tmp_path / "calib.yaml")) and "--position" in line
    assert list(said.values()) == [[], []]


def test_a_kind_of_depth_is_refused_before_the_cloud_is_read(run, tmp_path):
    """A panorama has no z; a cloud that is not there is not even looked for."""
    panorama = dw.EquirectangularCamera.looking((36, 18))
    cloud = dw.PointCloud(np.ones((1, 3), np.float32))
    dw.render(cloud, panorama, device="cpu").save(tmp_path / "p.npz")
    options = ["-o", tmp_path / "d.npz", "--camera", tmp_path / "p.npz", "--depth", "z"]
    result = run("render", tmp_path / "none.ply", *options)
    assert result.exit_code == 2 and "use depth='range'" in result.stderr
    assert "none.ply" not in result.stderr
