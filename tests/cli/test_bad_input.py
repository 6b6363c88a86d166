"""Bad input: one clear line, exit code 2, and nothing left behind."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.cli.conftest import VIEW

PLY_HEADER = "ply\nformat binary_little_endian 1.0\nelement vertex {}\n" + "".join(
    f"property float {axis}\n" for axis in "xyz"
)


def write_ply(path: Path, claimed: int, present: int) -> Path:
    """A binary PLY whose header may claim more vertices than it has."""
    rows = np.zeros((present, 3), "<f4") + np.float32(1)
    path.write_bytes((PLY_HEADER.format(claimed) + "end_header\n").encode() + rows.tobytes())
    return path


def refuse(run, folder: Path, *arguments: object, says: tuple[str, ...]) -> None:
    """The command exits with 2, says the words, and leaves the output folder empty."""
    result = run(*arguments)
    assert result.exit_code == 2, result.output
    assert result.stdout == ""
    for words in says:
        assert words in result.stderr
    assert "Traceback" not in result.stderr
    assert not list(folder.iterdir())


@pytest.fixture
def out(tmp_path: Path) -> Path:
    """An empty folder for outputs."""
    folder = tmp_path / "out"
    folder.mkdir()
    return folder


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("empty.ply", b"", ("empty.ply",)),
        ("empty.pcd", b"", ("empty.pcd",)),
        ("empty.xyz", b"", ("empty.xyz",)),
        ("words.xyz", b"this is not a cloud\n", ("words.xyz",)),
        ("cloud.docx", b"PK", ("docx", ".ply", ".pcd")),
        ("not.npz", b"PK\x03\x04 broken", ("not.npz",)),
        ("odd.bin", b"\0" * 17, ("odd.bin", "16")),
        ("noheader.ply", b"ply\nformat ascii 1.0\n" * 10, ("noheader.ply",)),
    ],
)
def test_files_that_are_not_clouds(run, out, tmp_path, name, content, says):
    """Empty, foreign and damaged files are refused by name."""
    path = tmp_path / name
    path.write_bytes(content)
    refuse(run, out, "render", path, "-o", out / "d.png", *VIEW, says=says)


def test_missing_file(run, out, tmp_path):
    """A name with no file behind it."""
    path = tmp_path / "missing.ply"
    refuse(run, out, "render", path, "-o", out / "d.png", *VIEW, says=("missing.ply",))


def test_truncated_ply_and_lying_header(run, out, tmp_path):
    """Both counts are named: what the header claims and what is there; nothing is allocated."""
    short = write_ply(tmp_path / "short.ply", claimed=10, present=4)
    refuse(run, out, "render", short, "-o", out / "d.png", *VIEW, says=("short.ply", "10", "4"))
    lying = write_ply(tmp_path / "lying.ply", claimed=10**12, present=4)
    refuse(run, out, "render", lying, "-o", out / "d.png", *VIEW, says=("lying.ply", "4"))


def test_zero_points(run, out, tmp_path):
    """A cloud without points has nothing to render."""
    path = write_ply(tmp_path / "zero.ply", claimed=0, present=0)
    refuse(run, out, "render", path, "-o", out / "d.png", *VIEW, says=("zero.ply", "no points"))


def test_one_point(run, out, tmp_path):
    """One point is a cloud: it is drawn."""
    path = write_ply(tmp_path / "one.ply", claimed=1, present=1)
    view = ["--position", "0", "1", "1", "--orientation", "0", "0", "0", "--fov", "60", "60"]
    result = run("render", path, "-o", out / "d.npz", *view, "--size", 3, 3, "--json")
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout)["counts"]["drawn"] == 1


def test_points_that_cannot_be_drawn_are_counted(run, out, tmp_path):
    """NaN and infinite points, and a point at the camera's centre, are skipped and said."""
    path = tmp_path / "odd.xyz"
    path.write_text("nan 0 0\ninf 0 0\n0 0 0\n2 0 0\n")
    result = run("render", path, "-o", out / "d.npz", *VIEW, "--filters", "none", "--json")
    counts = json.loads(result.stdout)["counts"]
    assert (counts["not_finite"], counts["behind"], counts["drawn"]) == (2, 1, 1)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"--fov": ("0", "60")}, ("fov", "horizontal")),
        ({"--fov": ("60", "180")}, ("fov", "vertical")),
        ({"--fov": ("60", "200")}, ("fov", "180")),
        ({"--fov": ("nan", "60")}, ("fov",)),
        ({"--size": ("0", "48")}, ("size",)),
        ({"--size": ("64", "-1")}, ("size",)),
        ({"--size": ("1000000000", "1000000000")}, ("size",)),
        ({"--size": ("1000000", "1000000")}, ("GB", "smaller size")),
        ({"--position": ("nan", "0", "0")}, ("position",)),
        ({"--orientation": ("0", "inf", "0")}, ("orientation",)),
        ({"--size": None, "--q-depth-map": ("1e-9",)}, ("q_depth_map", "larger")),
        ({"--size": None, "--q-depth-map": ("1e-5",)}, ("GB", "q_depth_map")),
        ({"--size": None, "--q-depth-map": ("0",)}, ("q_depth_map", "above 0")),
        ({"--size": None, "--q-depth-map": ("-1",)}, ("q_depth_map",)),
        ({"--size": None, "--q-depth-map": ("0.1",), "--q-line": ("1e-12",)}, ("q_line",)),
        ({"--size": None}, ("--size", "--q-depth-map")),
        ({"--q-depth-map": ("0.1",)}, ("--size", "--q-depth-map")),
        ({"--q-line": ("0.1",)}, ("--q-line", "--q-depth-map")),
        ({"--fov": None}, ("--fov",)),
        ({"--max-range": ("0",)}, ("max_range",)),
        ({"--min-range": ("20",)}, ("min_range",)),
        ({"--device": ("cuda:77",)}, ("cuda:77", "cpu")),
        ({"--depth": ("radial",)}, ("radial",)),
        ({"--filters": ("median",)}, ("median",)),
        ({"--camera": ("nothing.json",)}, ("--camera",)),
    ],
)
def test_bad_values(run, out, wall, changes, says):
    """Every number that cannot be meant is refused by its name."""
    options: dict[str, tuple[str, ...] | None] = {
        "--position": ("0", "0", "0"),
        "--orientation": ("0", "0", "0"),
        "--fov": ("60", "60"),
        "--size": ("64", "48"),
    } | changes
    arguments = [part for name, v in options.items() if v is not None for part in (name, *v)]
    refuse(run, out, "render", wall, "-o", out / "d.png", *arguments, says=says)


@pytest.mark.parametrize("name", ["d.jpg", "d", "missing/d.png"])
def test_outputs_that_cannot_be_written(run, out, wall, name):
    """An unknown suffix and a folder that is not there are refused before the cloud is read."""
    refuse(run, out, "render", wall, "-o", out / name, *VIEW, says=("cannot write", name))


def test_an_output_that_is_a_folder(run, tmp_path, wall):
    """A folder with the output's name stays what it is."""
    folder = tmp_path / "folder.png"
    folder.mkdir()
    result = run("render", wall, "-o", folder, *VIEW)
    assert result.exit_code == 2 and "folder" in result.stderr
    assert folder.is_dir() and not list(folder.iterdir())


def test_a_depth_that_the_encoding_cannot_hold_leaves_the_old_file(run, out, tmp_path):
    """70 m in millimetres do not fit 16 bits: refused, and the older file is untouched."""
    path = tmp_path / "far.xyz"
    path.write_text("70 0 0\n")
    old = tmp_path / "d.png"
    old.write_bytes(b"old")
    arguments = [*VIEW, "--max-range", "100", "--encoding", "millimetres"]
    result = run("render", path, "-o", old, *arguments)
    assert result.exit_code == 2 and "millimetres" in result.stderr
    assert old.read_bytes() == b"old"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["d.png", "far.xyz", "out"]


@pytest.mark.parametrize("content", ["{}", "[1]", "not json", '{"camera": {"model": "fisheye"}}'])
def test_camera_files_that_are_none(run, out, wall, tmp_path, content):
    """A JSON file without a camera is refused by name."""
    camera = tmp_path / "camera.json"
    camera.write_text(content)
    arguments = ["render", wall, "-o", out / "d.png", "--camera", camera]
    refuse(run, out, *arguments, says=("camera.json",))


def test_an_error_is_also_an_object_with_json(run, tmp_path):
    """A program that asked for JSON gets the error as JSON."""
    result = run("info", tmp_path / "missing.ply", "--json")
    assert result.exit_code == 2
    assert "missing.ply" in json.loads(result.stdout)["error"]


def test_a_defect_of_ours_exits_with_1(run, wall, tmp_path, monkeypatch):
    """An unexpected exception is called a defect, with its traceback on stderr."""
    import depthwarp.io

    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("boom")

    monkeypatch.setattr(depthwarp.io, "read", broken)
    monkeypatch.setattr("depthwarp.read", broken, raising=False)
    result = run("info", wall)
    assert result.exit_code == 1
    assert "boom" in result.stderr and "defect" in result.stderr


def test_an_input_is_never_overwritten(run, tmp_path, wall_points):
    """An output with the name of the cloud, or of the camera's file, is refused."""
    cloud = tmp_path / "cloud.npz"
    np.savez(cloud, points=wall_points)
    before = cloud.read_bytes()
    result = run("render", cloud, "-o", cloud, *VIEW)
    assert result.exit_code == 2 and "would replace" in result.stderr
    assert cloud.read_bytes() == before
    assert run("render", cloud, "-o", tmp_path / "d.png", *VIEW).exit_code == 0
    camera = tmp_path / "d.png.json"
    before = camera.read_bytes()
    result = run("render", cloud, "-o", tmp_path / "d.png", "--camera", camera)
    assert result.exit_code == 2 and "would replace" in result.stderr
    assert camera.read_bytes() == before


def test_a_cloud_without_a_finite_point(run, out, tmp_path):
    """NaN only: refused by name."""
    path = tmp_path / "nan.xyz"
    path.write_text("nan nan nan\nnan 0 0\n")
    refuse(run, out, "render", path, "-o", out / "d.png", *VIEW, says=("nan.xyz", "finite"))


def test_nothing_ahead_of_a_range_view(run, out, wall):
    """The remedy that the message names works."""
    view = ["--position", "0", "0", "0", "--orientation", "0", "0", "180", "--fov", "60", "60"]
    arguments = ["render", wall, "-o", out / "d.png", *view, "--q-depth-map", "0.1"]
    refuse(run, out, *arguments, says=("--depth-plane",))
    assert run(*arguments, "--depth-plane", "3").exit_code == 0


@pytest.mark.parametrize("option", [("--q-line", "0.1"), ("--position-frame", "rotated")])
def test_no_option_is_ignored_beside_a_camera(run, out, wall, tmp_path, option):
    """What --camera already says cannot be said again."""
    assert run("render", wall, "-o", tmp_path / "d.npz", *VIEW).exit_code == 0
    arguments = ["render", wall, "-o", out / "d.png", "--camera", tmp_path / "d.npz", *option]
    refuse(run, out, *arguments, says=("--camera",))


def test_an_encoding_that_cannot_hold_the_range_is_refused_before_reading(run, out):
    """A 16-bit PNG has no value for an infinite range; the missing cloud is not even looked at."""
    arguments = ["render", "missing.ply", "-o", out / "d.png", *VIEW, "--max-range", "inf"]
    refuse(run, out, *arguments, says=("finite max_range",))


def test_a_full_disk_is_said_with_the_file(run, out, wall, monkeypatch):
    """The message names the file and the cause, and nothing is left behind."""

    def full(*_: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    arguments = ["render", wall, "-o", out / "d.png", *VIEW]
    refuse(run, out, *arguments, says=("d.png", "No space left"))
