"""Finding a file's format, choosing a camera in it, and files that are damaged."""

from __future__ import annotations

import importlib
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import depthwarp as dw
from depthwarp.cameras import Rig
from depthwarp.cameras.formats import FORMATS, TRAJECTORIES
from depthwarp.errors import FileFormatError, InputError

SIZE = (640, 480)
POSE = dw.Pose.from_orientation((1.5, -2.25, 0.75), (5, -10, 40))
PLAIN = dw.PinholeCamera(500.25, 501.5, 310, 230.125, *SIZE, POSE)
BENT = dw.PinholeCamera(500.25, 501.5, 310, 230.125, *SIZE, POSE, (-0.28, 0.06, 0.001, -0.0005))
AT_ORIGIN = BENT.with_pose(dw.Pose.from_optical(np.eye(4)))
TWO = Rig.of({"0": PLAIN, "1": PLAIN.with_pose(dw.Pose.from_orientation((0, 0, 1), (0, 0, 0)))})

FILES = {
    "cv.yaml": ("opencv", BENT),
    "cv.xml": ("opencv", BENT),
    "cv.json": ("opencv", BENT),
    "ros.yaml": ("ros", AT_ORIGIN),
    "one.json": ("open3d", PLAIN),
    "two.json": ("open3d", TWO),
    "calib.txt": ("kitti", PLAIN),
    "transforms.json": ("nerfstudio", BENT),
}
"""Names of files, and what is written into each in which format."""


def written(folder: Path, name: str) -> Path:
    """One of `FILES`."""
    form, camera = FILES[name]
    dw.cameras.save(camera, folder / name, format=form)
    return folder / name


def size_for(name: str):
    """What has to be said when it is read."""
    return SIZE if name == "calib.txt" else None


def same(rig: Rig, expected: Rig) -> bool:
    """Whether lenses are equal, and poses to 1e-12."""
    return len(rig) == len(expected) and all(
        camera.with_pose(other.pose) == other
        and np.allclose(camera.pose.optical_from_world, other.pose.optical_from_world, 0, 1e-12)
        for camera, other in zip(rig.cameras, expected.cameras, strict=True)
    )


@pytest.mark.parametrize("name", FILES)
def test_the_content_chooses_the_format(tmp_path, name):
    """Under any name, given as text or as a path; the same camera comes back."""
    path = written(tmp_path, name)
    expected = FILES[name][1]
    expected = expected if isinstance(expected, Rig) else Rig.of({"camera": expected})
    assert same(dw.cameras.load_rig(path, size=size_for(name)), expected)
    renamed = path.rename(tmp_path / f"calibration{path.suffix}")
    assert same(dw.cameras.load_rig(str(renamed), size=size_for(name)), expected)


def test_a_folder_is_a_colmap_model(tmp_path):
    """Written and read through the same two functions as a file."""
    dw.cameras.save(TWO, tmp_path / "model", format="colmap")
    assert same(dw.cameras.load_rig(tmp_path / "model"), TWO)
    assert dw.cameras.load(tmp_path / "model", "1").pose.center_world == pytest.approx((0, 0, 1))


@pytest.mark.parametrize("name", FILES)
def test_only_one_format_knows_a_file(tmp_path, name):
    """The order of the formats does not matter."""
    path = written(tmp_path, name)
    modules = [importlib.import_module(f"depthwarp.cameras.formats.{form}") for form in known()]
    assert [module.NAME for module in modules if module.matches(path)] == [FILES[name][0]]


def known():
    """All formats."""
    return [*FORMATS, *TRAJECTORIES]


@pytest.mark.parametrize("form", known())
def test_every_format_states_its_convention(form, tmp_path):
    """Axes, and pixel centres where there is a lens; folders and missing files are not known."""
    module = importlib.import_module(f"depthwarp.cameras.formats.{form}")
    assert module.NAME == form
    assert "X right" in module.CONVENTION or "X forward" in module.CONVENTION
    assert form in TRAJECTORIES or "centre" in module.CONVENTION
    assert not module.matches(tmp_path) and not module.matches(tmp_path / "none.txt")


def test_a_camera_is_chosen_by_its_name(tmp_path):
    """With several, a name is needed; the errors list them."""
    path = written(tmp_path, "two.json")
    assert dw.cameras.load(path, "1").pose.center_world == pytest.approx((0, 0, 1))
    with pytest.raises(InputError, match=r"holds 2 cameras \(0, 1\).*cameras\.load_rig"):
        dw.cameras.load(path)
    with pytest.raises(InputError, match="no camera 'left'; it has 0, 1"):
        dw.cameras.load(path, "left")
    many = Rig.of({str(k): PLAIN for k in range(40)})
    dw.cameras.save(many, path, format="open3d")
    with pytest.raises(InputError, match=r"40 cameras \(0, 1, .*, 11, \.\.\. \(28 more\)\)"):
        dw.cameras.load(path)


@pytest.mark.parametrize("load", [dw.cameras.load, dw.cameras.load_rig, dw.cameras.load_trajectory])
def test_files_that_are_no_cameras(tmp_path, load):
    """Not there, empty, a folder, a picture, prose, other data: errors that say what to do."""
    with pytest.raises(FileNotFoundError, match="none.yaml: there is no such file"):
        load(tmp_path / "none.yaml")
    path = tmp_path / "camera.yaml"
    path.write_bytes(b"")
    with pytest.raises(FileFormatError, match=r"camera.yaml: the file is empty \(0 bytes\)"):
        load(path)
    for content in (b"\n", b"hello", b"\x89PNG\r\n\x1a\n" + bytes(50), b"{}", b"[]", b"x: 1\n"):
        path.write_bytes(content)
        with pytest.raises(FileFormatError, match="camera.yaml"):
            load(path)
    with pytest.raises(FileFormatError, match=tmp_path.name):
        load(tmp_path)


def test_an_unknown_file_is_told_what_is_known(tmp_path):
    """Every format of cameras is in the message."""
    path = tmp_path / "camera.txt"
    path.write_text("f 500\n")
    with pytest.raises(FileFormatError, match="a file of no known camera format") as caught:
        dw.cameras.load(path)
    for what in ("OpenCV", "ROS", "Open3D", "KITTI", "COLMAP", "nerfstudio", "depth map"):
        assert what in str(caught.value)
    assert len(str(caught.value).removeprefix(str(path))) <= 160
    with pytest.raises(FileFormatError, match="a folder of no known camera format"):
        dw.cameras.load(tmp_path)


@pytest.mark.parametrize(
    ("name", "content", "guess"),
    [
        ("cloud.ply", "ply\nformat ascii 1.0\n", "a point cloud; read it with depthwarp.read"),
        ("a.json", '{\n"x": 1,\n', "broken JSON, line 3"),
        ("t.csv", "# t, x\n0.5,1,2,3,0,0,0,1\n", "seems to be a trajectory; TUM's lines are"),
        ("project/sparse/0/cameras.txt", "", "a COLMAP project, whose model is .*sparse.0"),
    ],
)
def test_a_guess_at_what_an_unknown_file_is(tmp_path, name, content, guess):
    """Point clouds, broken JSON with its line, a project of COLMAP."""
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content)
    with pytest.raises(FileFormatError, match=guess):
        dw.cameras.load(tmp_path / name.split("/")[0])


def test_an_empty_path(tmp_path, monkeypatch):
    """Text without a name; and what pathlib makes of it, the current folder."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError, match="path of the file is empty"):
        dw.cameras.load("")
    with pytest.raises(FileFormatError, match="an empty path means this folder"):
        dw.cameras.load(Path(""))


def test_the_only_camera_of_a_file_is_named(tmp_path):
    """Where another name was asked for."""
    with pytest.raises(InputError, match="no camera 'foo'; its only camera is 'camera'"):
        dw.cameras.load(written(tmp_path, "cv.yaml"), "foo")


def test_a_trajectory_has_no_lens_and_a_lens_no_trajectory(tmp_path):
    """Each error names the right function; what `save_trajectory` writes is read back."""
    walk = dw.cameras.Trajectory((0.5, 1.5), (POSE, TWO.cameras[1].pose))
    for form in TRAJECTORIES:
        path = tmp_path / f"{form}.txt"
        dw.cameras.save_trajectory(walk, path, format=form)
        back = dw.cameras.load_trajectory(path)
        for pose, expected in zip(back.poses, walk.poses, strict=True):
            np.testing.assert_allclose(
                pose.optical_from_world, expected.optical_from_world, rtol=0, atol=1e-12
            )
        with pytest.raises(FileFormatError, match="no lens; read it with .*load_trajectory"):
            dw.cameras.load(path)
    with pytest.raises(FileFormatError, match="not a trajectory; known are TUM"):
        dw.cameras.load_trajectory(written(tmp_path, "cv.yaml"))
    with pytest.raises(InputError, match="format must be one of 'tum'"):
        dw.cameras.save_trajectory(walk, tmp_path / "a.txt", format="csv")


@pytest.mark.parametrize("suffix", [".npz", ".png"])
def test_a_depth_maps_camera(tmp_path, suffix):
    """Of its own NPZ, and of the JSON beside an image, for any model."""
    camera = dw.SpinningLidar(36, tuple(range(9)), POSE)
    cloud = dw.PointCloud(np.ones((1, 3)))
    path = tmp_path / f"depth{suffix}"
    dw.render(cloud, camera, device="cpu").save(path)
    described = path if suffix == ".npz" else Path(f"{path}.json")
    assert dw.cameras.load(described) == camera
    assert dw.cameras.load(described, size=(36, 9)) == camera
    with pytest.raises(InputError, match="36 x 9 pixels by the file, size says 9 x 36"):
        dw.cameras.load(described, size=(9, 36))
    described.write_bytes(described.read_bytes()[:300])
    with pytest.raises(FileFormatError, match=described.name):
        dw.cameras.load(described)


@pytest.mark.parametrize("name", FILES)
def test_a_file_that_was_cut_short_is_refused_or_whole_in_what_counts(tmp_path, name):
    """Cut at any place: an error that names the file, or the same cameras; never others."""
    path = written(tmp_path, name)
    content, expected = path.read_bytes(), dw.cameras.load_rig(path, size=size_for(name))
    refused = 0
    # Behind the last blank of a KITTI file is a single number, which nothing says how long it was.
    end = content.rindex(b" ") if name == "calib.txt" else len(content)
    for length in range(1, end, max(1, end // 150)):
        path.write_bytes(content[:length])
        try:
            assert dw.cameras.load_rig(path, size=SIZE) == expected
        except FileFormatError as error:
            assert name in str(error)
            refused += 1
    assert refused > 75


@pytest.mark.parametrize("name", FILES)
def test_a_damaged_file_is_an_error_of_ours(tmp_path, name):
    """Bytes turned into others: read, or refused by an error that a program can catch."""
    path = written(tmp_path, name)
    content = path.read_bytes()
    rng = np.random.default_rng(6)
    refused = 0
    for place in rng.integers(0, len(content), 100):
        damaged = bytearray(content)
        damaged[place] ^= int(rng.integers(1, 256))
        path.write_bytes(damaged)
        try:
            dw.cameras.load_rig(path, size=size_for(name))
        except InputError as error:
            assert name in str(error)
            refused += 1
        except Warning:  # a lens that is now another one
            refused += 1
    assert refused > 10


def test_what_cannot_be_saved(tmp_path):
    """An unknown format, no camera, no folder; an older file stays as it was."""
    with pytest.raises(InputError, match="format must be one of 'opencv', 'ros', .* got 'yaml'"):
        dw.cameras.save(PLAIN, tmp_path / "a.yaml", format="yaml")
    with pytest.raises(InputError, match="camera must be a Camera or a Rig, got a Pose"):
        dw.cameras.save(POSE, tmp_path / "a.yaml", format="opencv")
    for name, (form, camera) in FILES.items():
        with pytest.raises(InputError, match="folder .* does not exist"):
            dw.cameras.save(camera, tmp_path / "none" / name, format=form)
        path = written(tmp_path, name)
        before = path.read_bytes()
        with pytest.raises(InputError):
            dw.cameras.save(dw.SpinningLidar(64, (1.0, 0.0), POSE), path, format=form)
        assert path.read_bytes() == before


def test_no_format_is_imported_before_a_file_is_read():
    """`dw.cameras` loads neither OpenCV nor a format's module."""
    script = (
        "import sys, depthwarp as dw; dw.cameras.load; "
        "print([m for m in sys.modules if m == 'cv2' or m.endswith(('opencv', 'colmap'))])"
    )
    folders = [str(Path(dw.__file__).parents[1]), str(Path(dw.__file__).parents[1] / "kernels")]
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path[:0] = {folders}; {script}"],
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.stdout.strip() == "[]", done.stderr
