"""nerfstudio's transforms.json: its ray formulas by hand, round trips, bad files."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import depthwarp as dw
from depthwarp.cameras.formats import nerfstudio
from depthwarp.cameras.rig import Rig
from depthwarp.errors import FileFormatError, InputError

POSE = dw.Pose.from_orientation((1, -2, 3), (10, -20, 130))
LENS = {"w": 640, "h": 480, "fl_x": 500.5, "fl_y": 510, "cx": 320.25, "cy": 240.75}


def opengl_matrix(pose: dw.Pose) -> np.ndarray:
    """Camera to world with X right, Y up, Z backward: columns are the axes and the centre."""
    forward, left, up = pose.rotation
    matrix = np.eye(4)
    matrix[:3] = np.stack([-left, up, -forward, pose.center_world], axis=1)
    return matrix


def frame(name: str = "images/a.png", **entries: Any) -> dict[str, Any]:
    return {"file_path": name, "transform_matrix": opengl_matrix(POSE).tolist(), **entries}


def written(folder: Path, content: Any) -> Path:
    path = folder / "transforms.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def one_camera(folder: Path, content: dict[str, Any]) -> dw.Camera:
    path = written(folder, {"frames": [frame()], **content})
    assert nerfstudio.matches(path)
    rig = nerfstudio.read_rig(path)
    assert rig.names == ("images/a.png",)
    return rig.cameras[0]


def points_seen(camera: dw.Camera, optical: np.ndarray) -> np.ndarray:
    """Pixels of points given in axes X right, Y down, Z forward at POSE."""
    homogeneous = np.c_[optical * (1, -1, -1), np.ones(len(optical))]
    u, v, _, _ = camera.project((homogeneous @ opengl_matrix(POSE).T)[:, :3])
    return np.stack([u, v], axis=1)


def random_points(spread: float) -> np.ndarray:
    rng = np.random.default_rng(2)
    return rng.uniform((-spread, -spread, 1), (spread, spread, 3), (100, 3))


def test_a_perspective_camera(tmp_path: Path) -> None:
    """Pixels are fl x + c of OpenGL's axes, bent by k1, k2, p1, p2, k3, less a half."""
    bent = {"k1": -0.05, "k2": 0.02, "p1": 1e-3, "p2": -2e-3, "k3": 1e-3}
    camera = one_camera(tmp_path, {"camera_model": "OPENCV", **LENS, **bent})
    points = random_points(0.5)
    x, y = points[:, 0] / points[:, 2], points[:, 1] / points[:, 2]
    r = x * x + y * y
    radial = 1 + r * (-0.05 + r * (0.02 + r * 1e-3))
    right = x * radial + 2 * 1e-3 * x * y - 2e-3 * (r + 2 * x * x)
    down = y * radial - 2 * 2e-3 * x * y + 1e-3 * (r + 2 * y * y)
    expected = np.stack([500.5 * right + 320.25, 510 * down + 240.75], axis=1) - 0.5
    np.testing.assert_allclose(points_seen(camera, points), expected, rtol=0, atol=1e-9)


def test_a_fisheye_camera(tmp_path: Path) -> None:
    """OPENCV_FISHEYE is the angle's polynomial k1..k4, also behind the camera."""
    numbers = {**LENS, "fl_x": 180.0, "fl_y": 190.0}
    bent = {"k1": -0.02, "k2": 0.003, "k3": 1e-4, "k4": -1e-5}
    camera = one_camera(tmp_path, {"camera_model": "OPENCV_FISHEYE", **numbers, **bent})
    points = random_points(3) - (0, 0, 1.2)
    aside = np.hypot(points[:, 0], points[:, 1])
    t = np.arctan2(aside, points[:, 2])
    d = t * (1 - 0.02 * t**2 + 0.003 * t**4 + 1e-4 * t**6 - 1e-5 * t**8)
    middle = (320.25, 240.75)
    expected = (d / aside)[:, None] * points[:, :2] * (180, 190) + middle - np.array([0.5, 0.5])
    np.testing.assert_allclose(points_seen(camera, points), expected, rtol=0, atol=1e-9)


def test_a_panorama(tmp_path: Path) -> None:
    """EQUIRECTANGULAR: (x - cx) / fl_x and (y - cy) / fl_y are half turns right and down."""
    numbers = {"w": 800, "h": 400, "fl_x": 400, "fl_y": 400, "cx": 400, "cy": 200}
    camera = one_camera(tmp_path, {"camera_model": "EQUIRECTANGULAR", **numbers})
    points = random_points(3) - (0, 0, 2)
    azimuth = np.arctan2(points[:, 0], points[:, 2]) / math.pi
    dip = np.arctan2(points[:, 1], np.hypot(points[:, 0], points[:, 2])) / math.pi
    expected = np.stack([400 * azimuth + 400, 400 * dip + 200], axis=1) - 0.5
    np.testing.assert_allclose(points_seen(camera, points), expected, rtol=0, atol=1e-9)
    assert camera.elevations == (-90.0, 90.0)
    assert camera.azimuths == 360.0


def test_less_is_said_by_the_files_of_nerf(tmp_path: Path) -> None:
    """The field of view [rad] alone: square pixels, the principal point in the middle."""
    camera = one_camera(tmp_path, {"camera_angle_x": 1.2, "w": 800, "h": 600})
    focal = 400 / math.tan(0.6)
    np.testing.assert_allclose(camera.K, [[focal, 0, 399.5], [0, focal, 299.5], [0, 0, 1]])
    both = one_camera(tmp_path, {"camera_angle_x": 1.2, "camera_angle_y": 0.9, "w": 800, "h": 600})
    assert both.fy == pytest.approx(300 / math.tan(0.45))
    ngp = one_camera(tmp_path, {"camera_angle_x": 1.2, **LENS, "is_fisheye": True, "k1": 0.01})
    assert isinstance(ngp, dw.FisheyeCamera)
    assert ngp.fx == 500.5


def test_frames_may_have_their_own_lenses(tmp_path: Path) -> None:
    """Numbers stand at the top or in the frames; a number that stands in both must be the same."""
    top = {"camera_model": "OPENCV", "w": 640, "h": 480, "cx": 320.0, "cy": 240.0}
    frames = [frame("a", fl_x=500, fl_y=500, w=640), frame("b", fl_x=600, fl_y=600, k1=-0.01)]
    rig = nerfstudio.read_rig(written(tmp_path, {**top, "frames": frames}))
    assert rig.names == ("a", "b")
    assert (rig["a"].fx, rig["a"].distortion) == (500.0, ())
    assert (rig["b"].fx, rig["b"].distortion) == (600.0, (-0.01, 0.0, 0.0, 0.0))
    frames[1]["w"] = 641
    with pytest.raises(FileFormatError, match=r"frame 1 \('b'\): 'w' is 640 at the top .* 641"):
        nerfstudio.read_rig(written(tmp_path, {**top, "frames": frames}))


PINHOLE = dw.PinholeCamera(501.1, 499.7, 320.3, 239.9, 640, 480, POSE, (-0.05, 0.02, 0, 0, 0.01))
IDEAL = dw.PinholeCamera(501.1, 499.7, 320.3, 239.9, 640, 480, POSE)
FISHEYE = dw.FisheyeCamera(201.1, 199.7, 320.3, 239.9, 640, 480, POSE, (-0.02, 0.003, 0, 1e-5))
PANORAMA = dw.EquirectangularCamera(801, 333, POSE)
PART = dw.EquirectangularCamera(801, 333, POSE, 270.0, (-30.0, 77.0))


@pytest.mark.parametrize(
    "cameras",
    [(PINHOLE,), (PINHOLE, PINHOLE), (PINHOLE, IDEAL), (FISHEYE,), (PANORAMA,), (PART, PANORAMA)],
)
def test_rigs_come_back(tmp_path: Path, cameras: tuple[dw.Camera, ...]) -> None:
    """Written and read: names, order, lenses and poses, to 1e-12."""
    turned = dw.Pose.from_orientation((5, 6, 7), (-100, 40, 10), "rotated")
    placed = [camera.with_pose((POSE, turned)[k]) for k, camera in enumerate(cameras)]
    rig = Rig.of({f"images/ü {k}.png": camera for k, camera in enumerate(placed)})
    nerfstudio.write_rig(rig, tmp_path / "transforms.json")
    assert [entry.name for entry in tmp_path.iterdir()] == ["transforms.json"]
    assert nerfstudio.matches(tmp_path / "transforms.json")
    found = nerfstudio.read_rig(tmp_path / "transforms.json")
    assert found.names == rig.names
    for name, camera in rig.items():
        back = found[name]
        assert type(back) is type(camera)
        assert back.size == camera.size
        for number in ("fx", "fy", "cx", "cy"):
            assert getattr(back, number) == pytest.approx(getattr(camera, number), abs=1e-12, rel=0)
        assert getattr(back, "distortion", ()) == getattr(camera, "distortion", ())
        np.testing.assert_allclose(back.pose.rotation, camera.pose.rotation, rtol=0, atol=1e-12)
        np.testing.assert_allclose(
            back.pose.center_world, camera.pose.center_world, rtol=0, atol=1e-12
        )


def test_equal_lenses_stand_at_the_top(tmp_path: Path) -> None:
    """As nerfstudio's own files: shared numbers once, others in every frame."""
    path = tmp_path / "transforms.json"
    nerfstudio.write_rig(Rig.of({"a": IDEAL, "b": IDEAL}), path)
    shared = json.loads(path.read_text())
    assert (shared["fl_x"], shared["cx"], shared["w"]) == (501.1, 320.8, 640)
    assert set(shared["frames"][0]) == {"file_path", "transform_matrix"}
    nerfstudio.write_rig(Rig.of({"a": IDEAL, "b": PINHOLE}), path)
    own = json.loads(path.read_text())
    assert "fl_x" not in own
    assert [entry["k1"] for entry in own["frames"]] == [0.0, -0.05]


RATIONAL = dw.PinholeCamera.from_matrix(
    [[500, 0, 320], [0, 500, 240], [0, 0, 1]], (640, 480), [0] * 5 + [0.01, 0, 0]
)


@pytest.mark.parametrize(
    ("cameras", "message"),
    [
        ({"x": RATIONAL}, "'x' cannot be written for nerfstudio, .* PinholeCamera"),
        (
            {"x": dw.CylindricalCamera.looking((64, 32))},
            "'x' cannot be written for nerfstudio, .* CylindricalCamera",
        ),
        (
            {"a": IDEAL, "b": FISHEYE},
            "'a' is OPENCV, 'b' is OPENCV_FISHEYE; write one file",
        ),
    ],
)
def test_lenses_without_a_model_are_refused(
    tmp_path: Path, cameras: dict[str, dw.Camera], message: str
) -> None:
    """A lens that the format has no model for, or two models: an error with the camera's name."""
    with pytest.raises(InputError, match=message):
        nerfstudio.write_rig(Rig.of(cameras), tmp_path / "transforms.json")
    assert not list(tmp_path.iterdir())


MIRRORED = (opengl_matrix(POSE) * [[-1], [1], [1], [1]]).tolist()
SCALED = (opengl_matrix(POSE) @ np.diag([2.0, 2, 2, 1])).tolist()
COLUMNS = opengl_matrix(POSE).T.tolist()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('{"frames": [{"file_path": "a", ', "not whole JSON"),
        ("", "not whole JSON"),
        ("[" * 100_000, "not whole JSON"),
        ("[1, 2]", "no list 'frames'"),
        ({**LENS, "frames": []}, "no list 'frames' with a frame in it"),
        ({**LENS, "frames": {"a": 1}}, "no list 'frames'"),
        ({**LENS, "frames": [5]}, "frame 0 has no 'file_path'"),
        ({**LENS, "frames": [{"transform_matrix": []}]}, "frame 0 has no 'file_path'"),
        ({**LENS, "frames": [frame("a"), frame("a")]}, "two frames have the file_path 'a'"),
        (
            {**LENS, "frames": [frame(camera_model="FISHEYE624")]},
            "model 'FISHEYE624' is not",
        ),
        ({**LENS, "frames": [frame(camera_model=["OPENCV"])]}, "camera_model .* is not known"),
        ({**LENS, "frames": [frame(k1=math.nan)]}, "'k1' must be a finite number, got nan"),
        ({**LENS, "frames": [frame(k1=10**400)]}, "'k1' must be a finite number, got 1000"),
        ({**LENS, "frames": [frame(k1=True)]}, "'k1' must be a finite number, got True"),
        ({**LENS, "frames": [frame(k1="0.1")]}, "'k1' must be a finite number, got '0.1'"),
        ({**LENS, "frames": [frame(k4=0.1)]}, "'k4' is 0.1, which a PinholeCamera does not have"),
        (
            {**LENS, "frames": [frame(camera_model="OPENCV_FISHEYE", p1=0.1)]},
            "'p1' is 0.1, which a FisheyeCamera does not have",
        ),
        ({**LENS, "w": 640.5, "frames": [frame()]}, "size must be two whole numbers"),
        ({**LENS, "fl_x": 0, "frames": [frame()]}, "fx must be a finite number above 0"),
        ({"w": 64, "h": 48, "frames": [frame()]}, "neither 'fl_x' nor 'camera_angle_x'"),
        ({"w": 64, "h": 48, "camera_angle_x": 4, "frames": [frame()]}, "below pi radians, got 4"),
        (
            {**LENS, "camera_model": "EQUIRECTANGULAR", "frames": [frame()]},
            "'cx' of a panorama must be half its width, 320.0, got 320.25",
        ),
        (
            {"w": 64, "h": 32, "fl_x": -5, "camera_model": "EQUIRECTANGULAR", "frames": [frame()]},
            "'fl_x' and 'fl_y' must be above 0",
        ),
        ({**LENS, "frames": [frame(transform_matrix=SCALED)]}, "not a rotation .* by 3, "),
        (
            {**LENS, "frames": [frame(transform_matrix=MIRRORED)]},
            "a rotation .* determinant -1",
        ),
        ({**LENS, "frames": [frame(transform_matrix=COLUMNS)]}, r"end in the row \(0, 0, 0, 1\)"),
        ({**LENS, "frames": [frame(transform_matrix=[[1, 2], [3]])]}, "must be 4 x 4 numbers"),
        ({**LENS, "frames": [frame(transform_matrix=[[10**400]])]}, "must be 4 x 4 numbers"),
        ({**LENS, "frames": [frame(transform_matrix=None)]}, "4 x 4 finite numbers, got shape"),
        ({**LENS, "frames": [{"file_path": "a"}]}, "4 x 4 finite numbers, got shape"),
    ],
)
def test_bad_files_are_refused(tmp_path: Path, content: Any, message: str) -> None:
    """Cut short, entries missing, contradicting or impossible: an error with file and frame."""
    path = written(tmp_path, content)
    with pytest.raises(FileFormatError, match=message) as caught:
        nerfstudio.read_rig(path)
    assert str(path) in str(caught.value)


@pytest.mark.parametrize(
    "content", ["{}", '{"class_name": "PinholeCameraParameters"}', '- "fl_x"', "", "\0"]
)
def test_other_files_are_not_taken(tmp_path: Path, content: str) -> None:
    """JSON of another kind, what is no JSON, and folders are left to other formats."""
    assert not nerfstudio.matches(written(tmp_path, content))
    assert not nerfstudio.matches(tmp_path)


def test_a_size_for_files_without_one(tmp_path: Path) -> None:
    """The argument stands in for w and h, also under an angle; a file's own must be the same."""
    path = written(tmp_path, {"camera_angle_x": math.pi / 2, "frames": [frame()]})
    with pytest.raises(InputError, match=r"no 'w': give size=\(width, height\)"):
        dw.cameras.load(path)
    camera = dw.cameras.load(path, size=(640, 480))
    assert isinstance(camera, dw.PinholeCamera) and camera.size == (640, 480)
    assert (camera.fx, camera.fy) == pytest.approx((320, 320))
    assert (camera.cx, camera.cy) == (319.5, 239.5)
    path = written(tmp_path, {"fl_x": 500, "w": 640, "frames": [frame()]})
    assert dw.cameras.load(path, size=(640, 480)).size == (640, 480)
    with pytest.raises(InputError, match="640 x 240 pixels by the file, size says 320 x 240"):
        dw.cameras.load(path, size=(320, 240))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fl_x": 200}, "'fl_x' of a panorama must be at least half its width, 400.0"),
        ({"fl_y": 200}, "'fl_y' 200.0 and 'cy' 200.0 of a panorama .* from -180 to 180 degrees"),
        ({"cy": 300}, "'cy' 300.0 of a panorama"),
    ],
)
def test_a_panorama_that_cannot_be(tmp_path: Path, change: dict[str, float], message: str) -> None:
    """The message has the file's own names."""
    numbers = {"w": 800, "h": 400, "fl_x": 400, "fl_y": 400, "cx": 400, "cy": 200, **change}
    content = {"camera_model": "EQUIRECTANGULAR", **numbers, "frames": [frame()]}
    with pytest.raises(FileFormatError, match=message):
        nerfstudio.read_rig(written(tmp_path, content))
