"""Open3D's JSON, by its own text and, where it is installed, against Open3D itself."""

from __future__ import annotations

import json

import numpy as np
import pytest

import depthwarp as dw
from depthwarp.errors import FileFormatError, InputError

INTRINSIC = {
    "height": 480,
    "intrinsic_matrix": [525.0, 0.0, 0.0, 0.0, 526.0, 0.0, 319.5, 239.5, 1.0],
    "width": 640,
}
EXTRINSIC = [0.0, -1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 2.0, 3.0, 1.0]
PARAMETERS = {
    "class_name": "PinholeCameraParameters",
    "extrinsic": EXTRINSIC,
    "intrinsic": INTRINSIC,
    "version_major": 1,
    "version_minor": 0,
}
POSES = [
    dw.Pose.from_orientation((1.5, -2.25, 0.75 * k), (5 * k, -10, 40), "rotated") for k in range(3)
]
CAMERAS = [
    dw.PinholeCamera(500 + k, 501.25, 319.5 - k, 200, 640 - k, 480, pose)
    for k, pose in enumerate(POSES)
]
RIG = dw.cameras.Rig(("0", "1", "2"), tuple(CAMERAS))


@pytest.fixture(scope="module")
def open3d():
    """Open3D, if it is installed."""
    return pytest.importorskip("open3d", reason="needs the package open3d, which wrote the format")


def assert_close(camera, expected):
    """The same lens, and the same pose to 1e-12."""
    assert camera.with_pose(expected.pose) == expected
    np.testing.assert_allclose(
        camera.pose.optical_from_world, expected.pose.optical_from_world, rtol=0, atol=1e-12
    )


def test_matrices_are_read_column_by_column(tmp_path):
    """The text that Open3D writes for a camera: a worked example."""
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(PARAMETERS))
    camera = dw.cameras.load(path)
    assert camera.size == (640, 480)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (525, 526, 319.5, 239.5)
    np.testing.assert_array_equal(
        camera.pose.optical_from_world, [[0, 1, 0, 1], [-1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]
    )
    # Point (-2, 2, 7) is at (3, 4, 10) in optical axes.
    u, v, _, _ = camera.project(np.array([[-2.0, 2, 7]]))
    np.testing.assert_allclose((u[0], v[0]), (319.5 + 525 * 0.3, 239.5 + 526 * 0.4), atol=1e-12)


def test_intrinsics_alone_are_a_camera_in_its_own_frame(tmp_path):
    """As of `write_pinhole_camera_intrinsic`: optical axes are the world's."""
    path = tmp_path / "intrinsic.json"
    path.write_text(json.dumps(INTRINSIC))
    camera = dw.cameras.load(path)
    np.testing.assert_array_equal(camera.pose.optical_from_world, np.eye(4))
    # (width / 2 - 0.5) is the middle of an image: what from_fov gives too.
    middle = dw.PinholeCamera.from_fov((60, 45), (640, 480))
    assert (camera.cx, camera.cy) == (middle.cx, middle.cy)


def test_one_camera_and_several_are_read_back(tmp_path):
    """Parameters for one, a trajectory for several; names become numbers."""
    dw.cameras.save(CAMERAS[1], tmp_path / "one.json", format="open3d")
    assert_close(dw.cameras.load(tmp_path / "one.json"), CAMERAS[1])
    named = dw.cameras.Rig(("left", "right", "top"), tuple(CAMERAS))
    dw.cameras.save(named, tmp_path / "all.json", format="open3d")
    back = dw.cameras.load_rig(tmp_path / "all.json")
    assert back.names == RIG.names
    for name in back:
        assert_close(back[name], RIG[name])
    assert_close(dw.cameras.load(tmp_path / "all.json", "2"), CAMERAS[2])


def test_open3d_reads_what_is_written(tmp_path, open3d):
    """Open3D's own reader: the same matrices."""
    dw.cameras.save(RIG, tmp_path / "all.json", format="open3d")
    dw.cameras.save(CAMERAS[0], tmp_path / "one.json", format="open3d")
    entries = list(open3d.io.read_pinhole_camera_trajectory(str(tmp_path / "all.json")).parameters)
    entries.append(open3d.io.read_pinhole_camera_parameters(str(tmp_path / "one.json")))
    for entry, camera in zip(entries, [*CAMERAS, CAMERAS[0]], strict=True):
        np.testing.assert_array_equal(entry.intrinsic.intrinsic_matrix, camera.K)
        assert (entry.intrinsic.width, entry.intrinsic.height) == camera.size
        np.testing.assert_array_equal(entry.extrinsic, camera.pose.optical_from_world)


def test_what_open3d_writes_is_read(tmp_path, open3d):
    """Open3D's own writer, for each of the three kinds of file."""
    trajectory = open3d.camera.PinholeCameraTrajectory()
    entries = []
    for camera in CAMERAS:
        entry = open3d.camera.PinholeCameraParameters()
        entry.intrinsic = open3d.camera.PinholeCameraIntrinsic(*camera.size, camera.K)
        entry.extrinsic = camera.pose.optical_from_world
        entries.append(entry)
    trajectory.parameters = entries
    open3d.io.write_pinhole_camera_trajectory(str(tmp_path / "all.json"), trajectory)
    open3d.io.write_pinhole_camera_parameters(str(tmp_path / "one.json"), entries[1])
    open3d.io.write_pinhole_camera_intrinsic(str(tmp_path / "lens.json"), entries[2].intrinsic)
    for name, camera in dw.cameras.load_rig(tmp_path / "all.json").items():
        assert_close(camera, RIG[name])
    assert_close(dw.cameras.load(tmp_path / "one.json"), CAMERAS[1])
    lens = dw.cameras.load(tmp_path / "lens.json")
    assert_close(lens, CAMERAS[2].with_pose(lens.pose))


def test_open3ds_middle_of_an_image_is_ours(open3d):
    """The default sensor's principal point: pixel centres at whole numbers."""
    kind = open3d.camera.PinholeCameraIntrinsicParameters.PrimeSenseDefault
    intrinsic = open3d.camera.PinholeCameraIntrinsic(kind)
    ours = dw.PinholeCamera.from_fov((60, 45), (intrinsic.width, intrinsic.height))
    np.testing.assert_array_equal(intrinsic.intrinsic_matrix[:2, 2], (ours.cx, ours.cy))


def changed(**change):
    """The worked example with other entries; those that are None are left out."""
    entries = PARAMETERS | change
    return {name: value for name, value in entries.items() if value is not None}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (changed(class_name="PinholeCameraIntrinsic3"), "unknown class_name 'PinholeCameraI.*Traj"),
        (changed(extrinsic=None), "no entry 'extrinsic'"),
        (changed(extrinsic=EXTRINSIC[:15]), "extrinsic must be 16 numbers"),
        (changed(extrinsic=np.reshape(EXTRINSIC, (4, 4)).T.ravel().tolist()), "transposed"),
        (changed(extrinsic=[1.01 * x for x in EXTRINSIC[:15]] + [1.0]), "by 0.0201"),
        (changed(extrinsic=[*EXTRINSIC[:12], float("nan"), 0, 0, 1]), "finite"),
        (changed(intrinsic=5), "not an Open3D camera"),
        (changed(intrinsic=INTRINSIC | {"width": 0}), "from 1 to"),
        (changed(intrinsic=INTRINSIC | {"width": -1}), "from 1 to"),
        (changed(intrinsic=INTRINSIC | {"intrinsic_matrix": [0.0] * 8 + [1.0]}), "fx must be"),
        (changed(intrinsic=INTRINSIC | {"intrinsic_matrix": ["a"] * 9}), "not an Open3D camera"),
        ({"class_name": "PinholeCameraTrajectory", "parameters": []}, "at least one camera"),
        ({"class_name": "PinholeCameraTrajectory", "parameters": [{}]}, "no entry 'intrinsic'"),
        (INTRINSIC | {"width": None}, "size must be two whole numbers"),
        (INTRINSIC | {"intrinsic_matrix": [float("inf")] * 9}, "finite"),
    ],
    ids=str,
)
def test_bad_content_is_refused(tmp_path, content, message):
    """The message names the file and what is wrong."""
    path = tmp_path / "bad.json"
    # The name stays in the text, so that the file is taken for one of Open3D's.
    path.write_text(json.dumps({"intrinsic_matrix": 0} | content))
    with pytest.raises(FileFormatError, match=message) as caught:
        dw.cameras.load(path)
    assert "bad.json" in str(caught.value)


def test_what_the_format_cannot_hold_is_refused(tmp_path):
    """Distortion and other models: nothing is written."""
    bent = dw.PinholeCamera.from_matrix(CAMERAS[0].K, (640, 480), (-0.1, 0, 0, 0))
    with pytest.raises(InputError, match="no lens distortion.*colmap"):
        dw.cameras.save(bent, tmp_path / "a.json", format="open3d")
    fisheye = dw.FisheyeCamera.from_matrix(CAMERAS[0].K, (640, 480))
    with pytest.raises(InputError, match="no model for a FisheyeCamera"):
        dw.cameras.save(fisheye, tmp_path / "a.json", format="open3d")
    assert not list(tmp_path.iterdir())
