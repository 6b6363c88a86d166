"""OpenCV's calibration files, against OpenCV itself."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import depthwarp as dw
from depthwarp.errors import FileFormatError, InputError

SAMPLE = """%YAML:1.0
---
calibration_time: "Thu 01 Jan 2015 12:00:00 PM UTC"
nr_of_frames: 2
image_width: 640
image_height: 480
board_width: 9
square_size: 25.
fisheye_model: 0
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 532.5, 0., 342.25, 0., 533.75, 233.5, 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 5
   cols: 1
   dt: d
   data: [ -0.28125, 0.0625, 0.00125, -0.0005, 0.125 ]
avg_reprojection_error: 0.5
extrinsic_parameters: !!opencv-matrix
   rows: 2
   cols: 6
   dt: d
   data: [ 1., 2., 3., 4., 5., 6., 7., 8., 9., 10., 11., 12. ]
"""
"""The form that OpenCV's calibration sample writes; the last entry is of the board, not ours."""

K = np.array([[532.5, 0, 342.25], [0, 533.75, 233.5], [0, 0, 1]])
POSE = dw.Pose.from_orientation((1.5, -2.25, 0.75), (5, -10, 40))
BROWN = dw.PinholeCamera.from_matrix(K, (640, 480), (-0.28, 0.06, 0.001, -0.0005, 0.1))
CAMERAS = {
    "ideal": dw.PinholeCamera.from_matrix(K, (640, 480)).with_pose(POSE),
    "brown": BROWN.with_pose(POSE),
    "rational": dw.PinholeCamera.from_matrix(
        K, (640, 480), (0.5, 0.1, 1e-3, -1e-3, 0.01, 0.8, 0.2, 0.03, 1e-3, 0, 0, 1e-4, 0.01, -0.02)
    ).with_pose(POSE),
    "fisheye": dw.FisheyeCamera.from_matrix(K, (640, 480), (-0.01, 0.004, 0.001, 0)).with_pose(
        POSE
    ),
}


def write_storage(path, **entries):
    """A file that cv2 itself writes."""
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in entries.items():
        file.write(name, value)
    file.release()
    return path


def entries_of(camera, **more):
    """What a calibration file says of a lens."""
    size = {"image_width": camera.width, "image_height": camera.height}
    lens = {"camera_matrix": camera.K, "distortion_coefficients": np.array(camera.distortion)}
    return size | lens | more


def points_before(camera, count=300):
    """World points in front of a camera, within its view."""
    rng = np.random.default_rng(3)
    u, v = rng.uniform(30, 610, count), rng.uniform(30, 450, count)
    rays = camera.directions(u, v) * rng.uniform(1, 20, (count, 1))
    return camera.to_world(rays, u)


def project_by_cv2(camera, points, K, distortion, rvec, tvec):
    """Pixels (N, 2) by OpenCV's own function for the model."""
    points = points.reshape(-1, 1, 3)
    if isinstance(camera, dw.FisheyeCamera):
        return cv2.fisheye.projectPoints(points, rvec, tvec, K, distortion)[0].reshape(-1, 2)
    return cv2.projectPoints(points, rvec, tvec, K, distortion)[0].reshape(-1, 2)


def test_the_form_of_the_calibration_sample(tmp_path):
    """Every number where it belongs; the world is the camera's own optical frame."""
    path = tmp_path / "out_camera_data.yml"
    path.write_text(SAMPLE)
    camera = dw.cameras.load(path)
    assert camera == dw.PinholeCamera.from_matrix(
        K, (640, 480), (-0.28125, 0.0625, 0.00125, -0.0005, 0.125)
    )
    np.testing.assert_array_equal(camera.pose.optical_from_world, np.eye(4))
    path.write_text(SAMPLE.replace("fisheye_model: 0", "fisheye_model: 1"))
    with pytest.raises(FileFormatError, match="4 fisheye coefficients .* got 5"):
        dw.cameras.load(path)


@pytest.mark.parametrize("suffix", [".yaml", ".yml", ".xml", ".json"])
@pytest.mark.parametrize("name", CAMERAS)
def test_what_is_written_is_read_back_by_us_and_by_opencv(tmp_path, name, suffix):
    """An equal camera; and cv2 reads matrices that give its own projection the same pixels."""
    camera, path = CAMERAS[name], tmp_path / f"camera{suffix}"
    dw.cameras.save(camera, path, format="opencv")
    back = dw.cameras.load(path)
    assert back.with_pose(camera.pose) == camera
    np.testing.assert_allclose(
        back.pose.optical_from_world, camera.pose.optical_from_world, rtol=0, atol=1e-12
    )
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    transform = file.getNode("optical_from_world").mat()
    assert (file.getNode("fisheye_model").real() == 1) == (name == "fisheye")
    points = points_before(camera)
    expected = project_by_cv2(
        camera,
        points,
        file.getNode("camera_matrix").mat(),
        file.getNode("distortion_coefficients").mat(),
        cv2.Rodrigues(transform[:3, :3])[0],
        transform[:3, 3].copy(),
    )
    u, v, _, _ = back.project(points)
    np.testing.assert_allclose(np.column_stack([u, v]), expected, rtol=0, atol=1e-8)


@pytest.mark.parametrize("suffix", [".yaml", ".xml", ".json"])
@pytest.mark.parametrize("name", CAMERAS)
def test_what_opencv_writes_is_read(tmp_path, name, suffix):
    """Lens by the sample's keys, extrinsics as of cv2.solvePnP: the pixels of cv2's projection."""
    camera = CAMERAS[name]
    transform = camera.pose.optical_from_world
    rvec, tvec = cv2.Rodrigues(transform[:3, :3])[0], transform[:3, 3:].copy()
    more = {"rvec": rvec, "tvec": tvec, "fisheye_model": int(name == "fisheye")}
    path = write_storage(tmp_path / f"cv{suffix}", **entries_of(camera, **more))
    points = points_before(camera)
    distortion = np.array(camera.distortion or np.zeros(5))
    expected = project_by_cv2(camera, points, camera.K, distortion, rvec, tvec)
    u, v, _, _ = dw.cameras.load(path).project(points)
    np.testing.assert_allclose(np.column_stack([u, v]), expected, rtol=0, atol=1e-8)


def test_short_keys_and_a_matrix_of_a_rotation(tmp_path):
    """K, D, R, T are what the long names are; so is float32."""
    transform = POSE.optical_from_world
    entries = {"image_width": 640, "image_height": 480, "K": K.astype(np.float32)}
    entries |= {"D": np.zeros(5), "R": transform[:3, :3], "T": transform[:3, 3]}
    camera = dw.cameras.load(write_storage(tmp_path / "short.yaml", **entries))
    np.testing.assert_array_equal(camera.K, K)
    np.testing.assert_allclose(camera.pose.optical_from_world, transform, rtol=0, atol=1e-12)
    assert camera.distortion == ()


@pytest.mark.parametrize("suffix", [".yaml", ".xml", ".json"])
def test_a_lens_without_coefficients_is_ideal(tmp_path, suffix):
    """An empty matrix, as cv2 writes one."""
    entries = entries_of(BROWN, distortion_coefficients=np.zeros((1, 0)))
    camera = dw.cameras.load(write_storage(tmp_path / f"cv{suffix}", **entries))
    assert camera == dw.PinholeCamera.from_matrix(K, (640, 480))


@pytest.mark.parametrize("keys", ["K1 D1 K2 D2", "M1 D1 M2 D2"])
def test_a_stereo_calibration_is_a_rig(tmp_path, keys):
    """The first camera's frame is the world; the second is where cv2.stereoCalibrate puts it."""
    rotation = cv2.Rodrigues(np.array([0.02, -0.1, 0.03]))[0]
    lenses = K, np.array(BROWN.distortion), K, np.zeros(5)
    entries = dict(zip(keys.split(), lenses, strict=True))
    shift = np.array([[-0.12], [0.002], [0.01]])
    path = write_storage(tmp_path / "stereo.yml", **entries, R=rotation, T=shift)
    rig = dw.cameras.load_rig(path, size=(640, 480))
    assert rig.names == ("camera1", "camera2") and rig["camera1"] == BROWN
    points = points_before(BROWN)
    expected = cv2.projectPoints(points, rotation, shift, K, np.zeros(5))[0].reshape(-1, 2)
    u, v, _, _ = rig["camera2"].project(points)
    np.testing.assert_allclose(np.column_stack([u, v]), expected, rtol=0, atol=1e-8)
    with pytest.raises(InputError, match=r"2 cameras \(camera1, camera2\).*load_rig"):
        dw.cameras.load(path, size=(640, 480))

    write_storage(path, **entries)
    with pytest.raises(FileFormatError, match="not R and T between them: copy both"):
        dw.cameras.load_rig(path, size=(640, 480))


def test_a_missing_size_has_a_remedy(tmp_path):
    """The error names the argument; with it the file is read; not if the file says otherwise."""
    path = write_storage(tmp_path / "cv.yaml", camera_matrix=K, distortion_coefficients=np.zeros(5))
    with pytest.raises(InputError, match=r"image_width.*give size=\(width, height\)"):
        dw.cameras.load(path)
    assert dw.cameras.load(path, size=(640, 480)).size == (640, 480)
    with pytest.raises(InputError, match="size must be"):
        dw.cameras.load(path, size=(640, -480))
    path.write_text(SAMPLE)
    assert dw.cameras.load(path, size=(640, 480)).size == (640, 480)
    with pytest.raises(InputError, match="640 x 480 pixels by the file, size says 320 x 240"):
        dw.cameras.load(path, size=(320, 240))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"camera_matrix": np.diag([0.0, 500, 1])}, "fx must be a finite number above 0"),
        ({"camera_matrix": np.diag([500, np.nan, 1])}, "finite"),
        ({"camera_matrix": np.diag([500, np.inf, 1])}, "finite"),
        ({"camera_matrix": np.zeros((3, 3))}, "without skew"),
        ({"camera_matrix": np.array([[500, 2, 320], [0, 500, 240], [0, 0, 1.0]])}, "skew"),
        ({"camera_matrix": np.eye(2)}, "3 x 3"),
        ({"camera_matrix": 5.0}, "camera_matrix is not a matrix"),
        ({"camera_matrix": None}, "no entry 'camera_matrix or K or cameraMatrix'"),
        ({"distortion_coefficients": None}, "no distortion_coefficients or D .* add the line"),
        ({"distortion_coefficients": np.zeros(7)}, "got 7"),
        ({"distortion_coefficients": np.array([np.nan, 0, 0, 0])}, "finite"),
        ({"image_width": 0}, "from 1 to"),
        ({"image_width": 640.5}, "whole numbers"),
        ({"image_width": "wide"}, "image_width is not a number"),
        ({"image_height": None}, "no entry 'image_height'"),
        ({"xi": np.ones(1)}, "omnidir"),
        ({"camera_model": "pancake"}, "unknown camera_model 'pancake'; known are pinhole"),
        ({"optical_from_world": np.diag([1, 1, 1.001, 1])}, "not a rotation .* by 0.002"),
        ({"R": np.diag([1.0, 1, -1]), "T": np.zeros(3)}, "determinant -1"),
        ({"R": np.eye(3)}, "no entry 'T or tvec'"),
        ({"tvec": np.zeros(3)}, "no entry 'R or rvec'"),
        ({"R": np.eye(3), "T": np.zeros(2)}, "R and T must be .* got 9 and 2 numbers"),
    ],
    ids=str,
)
def test_bad_content_is_refused(tmp_path, change, message):
    """The message names the file and the entry."""
    entries = entries_of(BROWN) | change
    entries = {name: value for name, value in entries.items() if value is not None}
    # A matrix must be there for the file to be known at all.
    path = write_storage(tmp_path / "bad.yaml", board=np.eye(3), **entries)
    with pytest.raises(FileFormatError, match=message) as caught:
        dw.cameras.load(path)
    assert "bad.yaml" in str(caught.value)


def test_what_cannot_be_written_is_refused(tmp_path):
    """Another model, several cameras, another suffix: nothing is written."""
    lidar = dw.SpinningLidar(512, (1.0, -1.0), POSE)
    with pytest.raises(InputError, match="no model for a SpinningLidar"):
        dw.cameras.save(lidar, tmp_path / "a.yaml", format="opencv")
    rig = dw.cameras.Rig.of(CAMERAS)
    with pytest.raises(InputError, match="holds one camera, the rig has 4"):
        dw.cameras.save(rig, tmp_path / "a.yaml", format="opencv")
    with pytest.raises(InputError, match="suffix must be one of .yaml"):
        dw.cameras.save(BROWN, tmp_path / "a.txt", format="opencv")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("matrix", ["camera_matrix", "K", "cameraMatrix"])
@pytest.mark.parametrize(
    "coefficients", ["distortion_coefficients", "D", "distCoeffs", "dist_coeffs"]
)
@pytest.mark.parametrize("size", ["image_size", "imageSize"])
def test_names_that_users_give(tmp_path, matrix, coefficients, size):
    """Those of cv2's arguments; the size as a matrix of two numbers, (width, height)."""
    distortion = np.array(BROWN.distortion)
    entries = {size: np.array([640, 480]), matrix: K, coefficients: distortion}
    assert dw.cameras.load(write_storage(tmp_path / "cv.yaml", **entries)) == BROWN


def test_a_size_by_a_list(tmp_path):
    """As C++ writes a cv::Size; three numbers are refused."""
    path = tmp_path / "cv.yaml"
    old = "image_width: 640\nimage_height: 480\n"
    path.write_text(SAMPLE.replace(old, "image_size: [ 640, 480 ]\n"))
    assert dw.cameras.load(path).size == (640, 480)
    path.write_text(SAMPLE.replace(old, "image_size: [ 640, 480, 3 ]\n"))
    with pytest.raises(FileFormatError, match=r"image_size must be \[width, height\], got 3"):
        dw.cameras.load(path)


def test_the_remedy_for_an_ideal_lens_helps(tmp_path):
    """The line that the message says makes the file one of an ideal lens."""
    path = tmp_path / "cv.yaml"
    write_storage(path, image_width=640, image_height=480, camera_matrix=K)
    with pytest.raises(FileFormatError, match="ideal lens add the line") as caught:
        dw.cameras.load(path)
    line = str(caught.value).split("'")[1]
    path.write_text(path.read_text() + line + "\n")
    assert dw.cameras.load(path) == dw.PinholeCamera.from_matrix(K, (640, 480))


def test_the_matrix_is_checked_before_a_size_is_asked_for(tmp_path):
    """What cannot be mended by a size is said first."""
    path = write_storage(tmp_path / "cv.yaml", K=np.diag([0.0, 500, 1]), D=np.zeros(5))
    with pytest.raises(FileFormatError, match="fx must be a finite number above 0"):
        dw.cameras.load(path)


@pytest.mark.parametrize("keys", ["K D", "K1 D1 K2 D2"])
def test_four_coefficients_of_either_model_are_not_guessed(tmp_path, keys):
    """Under D the file must say; under the sample's name they are cv2.calibrateCamera's."""
    bent = np.array([[-0.01], [0.02], [-0.01], [0.002]])
    lens = {key: K if key.startswith("K") else bent for key in keys.split()}
    entries = {"image_width": 640, "image_height": 480, "R": np.eye(3), "T": np.zeros(3), **lens}
    path = write_storage(tmp_path / "cv.yaml", **entries)
    with pytest.raises(FileFormatError, match="4 coefficients, .*'fisheye_model: 1'"):
        dw.cameras.load_rig(path)
    text = path.read_text()
    for number, model in enumerate((dw.PinholeCamera, dw.FisheyeCamera)):
        path.write_text(f"{text}fisheye_model: {number}\n")
        for camera in dw.cameras.load_rig(path).cameras:
            assert type(camera) is model
            assert camera.distortion == tuple(bent.ravel())
    for name in ("distortion_coefficients", "distCoeffs"):
        entries = {"image_size": np.array([640, 480]), "camera_matrix": K, name: bent}
        write_storage(path, **entries)
        assert type(dw.cameras.load(path)) is dw.PinholeCamera


def test_one_camera_of_a_stereo_calibration_without_extrinsics(tmp_path):
    """By its name, in its own optical frame; not both, and no other name."""
    entries = {"M1": K, "D1": np.array(BROWN.distortion), "M2": 2 * K - np.diag([0, 0, 1])}
    path = write_storage(tmp_path / "intrinsics.yml", **entries, D2=np.zeros(5))
    assert dw.cameras.load(path, "camera1", size=(640, 480)) == BROWN
    second = dw.cameras.load(path, "camera2", size=(640, 480))
    assert second == dw.PinholeCamera.from_matrix(entries["M2"], (640, 480))
    for name in (None, "left"):
        with pytest.raises(FileFormatError, match="R and T between .* or load one alone by its"):
            dw.cameras.load(path, name, size=(640, 480))
