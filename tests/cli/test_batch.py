"""`depthwarp batch` on the command line: bad input, one line each; and what a person sees."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import depthwarp as dw
from depthwarp.cli import batch_progress
from tests.cli.terminal import on_terminal

LENS = ("--fov", "70", "55", "--size", "16", "12")
CSV = "x,y,z,roll,pitch,yaw\n0,0,0,0,0,0\n"

SCALED = np.eye(4) * [1.01, 1.01, 1.01, 1]
MIRRORED = np.diag([1.0, 1.0, -1.0, 1.0])
NOT_FINITE = np.full((4, 4), np.nan)


@pytest.fixture
def refuse(run, tmp_path: Path) -> Callable[..., None]:
    """The command exits with 2, says the words in one line, and writes nothing."""

    def check(*arguments: object, says: tuple[str, ...], output: str = "out") -> None:
        before = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
        result = run("batch", *arguments, "-o", tmp_path / output)
        assert result.exit_code == 2, result.output
        errors = [line for line in result.stderr.splitlines() if line.startswith("error:")]
        assert len(errors) == 1 and result.stderr.endswith(errors[0] + "\n"), result.stderr
        for words in says:
            assert words in errors[0]
        after = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*")}
        assert {path: after[path] for path in after if path.is_file()} == {
            path: before[path] for path in before if path.is_file()
        }

    return check


@pytest.fixture
def poses(tmp_path: Path) -> Path:
    """One pose that sees the wall."""
    path = tmp_path / "poses.csv"
    path.write_text(CSV)
    return path


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("empty.csv", "", ("empty.csv", "empty")),
        ("head.csv", "x,y,z,roll,pitch,yaw\n", ("head.csv", "no pose")),
        ("bare.csv", "0,0,0,0,0,0\n", ("bare.csv", "line 1", "'x'", "roll")),
        ("quaternion.csv", "x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,1\n", ("line 1", "'roll'")),
        ("twice.csv", "x,x,y,z,roll,pitch,yaw\n0,0,0,0,0,0,0\n", ("line 1", "two columns 'x'")),
        ("short.csv", CSV + "1,2,3\n", ("short.csv", "line 3", "6", "3")),
        ("word.csv", CSV + "1,2,3,up,0,0\n", ("line 3", "'up'")),
        ("nan.csv", CSV + "\n1,2,3,nan,0,0\n", ("line 4", "'nan'")),
        ("binary.csv", "x,y,z,roll,pitch,yaw\n\0", ("binary.csv", "line 2")),
        (
            "tum.txt",
            "0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 0.9\n",
            ("tum.txt", "line 2", "w = 0.9, x = 0"),
        ),
        ("cut.txt", "0 0 0 0 0 0 0 1\n1 0 0 0 0\n", ("cut.txt", "line 2", "8", "5")),
        ("kitti.txt", "1 0 0 0 0 1 0 0 0 0 1.01 0\n", ("kitti.txt", "line 1", "0.02")),
        ("words.txt", "nothing of this kind\n", ("words.txt", "TUM", ".csv", "COLMAP")),
        (
            "named.csv",
            "name," + CSV.replace("0,0,0,0", "../a,0,0,0,0"),
            ("line 2", "'../a'", "rename"),
        ),
        (
            "doubled.csv",
            "name,x,y,z,roll,pitch,yaw\na.png,0,0,0,0,0,0\nA.jpg,0,0,0,0,0,0\n",
            ("line 2 ('a.png')", "line 3 ('A.jpg')", "one file"),
        ),
    ],
)
def test_poses_that_cannot_be_used(refuse, wall, tmp_path, name, text, says):
    """Each file is refused with its name, the line, and what was wrong."""
    path = tmp_path / name
    path.write_text(text)
    refuse(wall, path, *LENS, says=says)


@pytest.mark.parametrize(
    ("matrices", "says"),
    [
        (np.stack([np.eye(4), np.eye(4), SCALED]), ("pose 2", "not a rotation", "0.02")),
        (np.stack([np.eye(4), MIRRORED]), ("pose 1", "not a rotation", "determinant -1")),
        (np.stack([NOT_FINITE]), ("pose 0", "finite")),
        (np.stack([np.eye(4), np.eye(4).T + np.eye(4, k=-3)]), ("pose 1", "transposed")),
        (np.eye(4), ("(V, 4, 4)", "(4, 4)")),
        (np.zeros((0, 4, 4)), ("no pose",)),
        (np.array(["a"]), ("(V, 4, 4)",)),
    ],
)
def test_matrices_that_are_no_poses(refuse, wall, tmp_path, matrices, says):
    """The number of the pose is named, and by how much it is no rotation."""
    path = tmp_path / "poses.npz"
    np.savez(path, optical_from_world=matrices)
    refuse(wall, path, *LENS, says=("poses.npz", *says))


def test_an_npz_of_something_else(refuse, wall, tmp_path):
    """Neither poses nor a depth map, or no archive at all."""
    np.savez(tmp_path / "other.npz", points=np.zeros((2, 3)))
    refuse(wall, tmp_path / "other.npz", says=("other.npz",))
    np.savez(tmp_path / "named.npz", poses=np.eye(4)[None])
    refuse(wall, tmp_path / "named.npz", *LENS, says=("named.npz", "optical_from_world"))
    (tmp_path / "torn.npz").write_bytes(b"PK\x03\x04 torn")
    refuse(wall, tmp_path / "torn.npz", *LENS, says=("torn.npz",))


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ((), ("poses.csv", "no lens", "--camera", "--fov")),
        (("--size", "16", "12"), ("no lens",)),
        (("--fov", "70", "55"), ("--size",)),
        (("--camera-name", "left"), ("--camera-name", "--camera FILE")),
        (("--camera", "missing.yaml"), ("missing.yaml",)),
        ((*LENS, "--fov", "0", "55"), ("fov",)),
        ((*LENS, "--size", "0", "12"), ("size",)),
        ((*LENS, "--size", "1000000", "1000000"), ("GB", "smaller size, with --size")),
        ((*LENS, "--max-range", "0"), ("max_range",)),
        ((*LENS, "--max-range", "inf"), ("finite max_range",)),
        ((*LENS, "--max-range", "100", "--encoding", "millimetres"), ("65.535", "--encoding")),
        ((*LENS, "--min-range", "20"), ("min_range",)),
        ((*LENS, "--device", "cuda:77"), ("cuda:77", "cpu")),
    ],
)
def test_options_that_cannot_be_meant(refuse, wall, poses, options, says):
    """No lens, half a lens, or numbers out of their range."""
    refuse(wall, poses, *options, says=says)


def test_a_lens_cannot_be_said_twice(refuse, run, wall, poses, tmp_path):
    """--camera beside --fov, and either beside poses that bring their own lens."""
    assert run("batch", wall, poses, "-o", tmp_path / "first", *LENS).exit_code == 0
    own = tmp_path / "own.json"
    dw.cameras.save(dw.PinholeCamera.from_fov((70, 55), (16, 12)), own, format="open3d")
    refuse(wall, poses, "--camera", own, *LENS, says=("--camera", "--fov"))
    refuse(wall, own, *LENS, says=("own.json", "already says the lens"))
    refuse(wall, own, "--camera", own, says=("own.json", "already says the lens"))


def test_clouds_that_cannot_be_drawn(refuse, poses, tmp_path):
    """A missing cloud, one without points, one without a finite point; no folder is left."""
    refuse(tmp_path / "missing.ply", poses, *LENS, says=("missing.ply",))
    (tmp_path / "nan.xyz").write_text("nan 0 0\n")
    refuse(tmp_path / "nan.xyz", poses, *LENS, says=("nan.xyz", "finite"))
    np.savez(tmp_path / "none.npz", points=np.zeros((0, 3), np.float32))
    refuse(tmp_path / "none.npz", poses, *LENS, says=("none.npz", "no points"))
    assert not (tmp_path / "out").exists()


def test_outputs_that_cannot_be_written(refuse, run, wall, poses, tmp_path):
    """Other suffixes, missing folders, folders and files that are somebody else's."""
    for name in ("out.png", "out.h5", "out.tiff"):
        refuse(wall, poses, *LENS, output=name, says=(name, "give a folder"))
    refuse(wall, poses, *LENS, output="missing/out", says=("missing", "does not exist"))
    refuse(wall, poses, *LENS, output="wall.xyz", says=("wall.xyz", "is a file"))
    refuse(wall, poses, *LENS, output=".", says=("holds other files",))
    refuse(wall, poses, "--encoding", "kitti", *LENS, output="o.npz", says=("encoding",))
    refused = run("batch", wall, poses, "-o", "/proc/out", *LENS)
    assert refused.exit_code == 2 and "/proc/out" in refused.stderr
    assert refused.stderr.endswith("; choose another folder\n")  # where no room would help
    np.savez(tmp_path / "taken.npz", a=np.zeros(3))
    refuse(wall, poses, *LENS, output="taken.npz", says=("taken.npz", "not a batch"))
    (tmp_path / "folder.npz").mkdir()
    refuse(wall, poses, *LENS, output="folder.npz", says=("folder.npz", "is a folder"))
    (tmp_path / "odd").mkdir()
    (tmp_path / "odd" / "batch.json").write_text("{}")
    (tmp_path / "odd" / "views.jsonl").write_text("{}\n")
    refuse(wall, poses, *LENS, output="odd", says=("batch.json", "does not describe"))


def test_zarr_stores_that_cannot_be_written(refuse, wall, poses, tmp_path):
    """A file or another store of that name, an encoding, views of several sizes."""
    zarr = pytest.importorskip("zarr")
    refuse(wall, poses, "--encoding", "kitti", *LENS, output="o.zarr", says=("encoding", ".zarr"))
    (tmp_path / "file.zarr").write_bytes(b"")
    refuse(wall, poses, *LENS, output="file.zarr", says=("file.zarr", "it is a file"))
    zarr.create_group(tmp_path / "taken.zarr")
    (tmp_path / "folder.zarr").mkdir()
    for name in ("taken.zarr", "folder.zarr"):
        refuse(wall, poses, *LENS, output=name, says=(name, "not a batch"))


def test_without_zarr_the_message_says_what_to_install(refuse, wall, poses, tmp_path, monkeypatch):
    """Before anything is drawn or written."""
    monkeypatch.setitem(sys.modules, "zarr", None)
    refuse(wall, poses, *LENS, output="o.zarr", says=('pip install "depthwarp[zarr]"',))
    assert not (tmp_path / "o.zarr.part").exists()


def test_an_npz_that_would_be_too_large(refuse, wall, tmp_path):
    """More than one NPZ may hold is refused before anything is drawn."""
    path = tmp_path / "many.csv"
    path.write_text(CSV + "0,0,0,0,0,0\n" * 300)
    size = ("--fov", "70", "55", "--size", "4096", "4096")
    refuse(wall, path, *size, output="out.npz", says=("301 views", "GB", "folder"))


def test_views_of_nothing_are_said(run, wall, tmp_path):
    """Looking away from the wall succeeds, with a warning that counts the views."""
    path = tmp_path / "poses.csv"
    path.write_text(CSV + "0,0,0,0,0,180\n")
    result = run("batch", wall, path, "-o", tmp_path / "out", *LENS)
    assert result.exit_code == 0 and result.stdout == ""
    assert "warning: 1 of the views drawn now show no point" in result.stderr


def test_an_error_is_also_an_object_with_json(run, wall, poses, tmp_path):
    """A program that asked for JSON gets the error as JSON."""
    result = run("batch", wall, poses, "-o", tmp_path / "out", "--json")
    assert "no lens" in json.loads(result.stdout)["error"]


def test_a_log_has_a_line_a_tile_and_about_ten_in_all(run, wall, tmp_path, monkeypatch):
    """Nine views of one tile are one line; a hundred tiles are a line about every tenth."""
    from depthwarp.batch_job import drawing

    for count, tile, shown in ((9, 128, [9]), (100, 1, range(10, 101, 10)), (12, 5, [5, 10, 12])):
        monkeypatch.setattr(drawing, "TILE_VIEWS", tile)
        path = tmp_path / "poses.csv"
        path.write_text(CSV + "0,0,0,0,0,0\n" * (count - 1))
        result = run("batch", wall, path, "-o", tmp_path / f"out{count}", *LENS)
        lines = [line for line in result.stderr.splitlines() if line.startswith("drawing:")]
        assert [line.split(",")[0] for line in lines] == [
            f"drawing: {done} of {count}" for done in shown
        ]


def test_the_time_left_is_that_of_the_rate(monkeypatch, capsys):
    """On a terminal: 128 of 700 views after two seconds are 64 views/s, and 9 s to go."""
    now = [100.0]
    monkeypatch.setattr(batch_progress.time, "perf_counter", lambda: now[0])
    for name, value in (("FORCE_COLOR", "1"), ("TERM", "xterm"), ("COLUMNS", "80")):
        monkeypatch.setenv(name, value)
    wall_seen = [SimpleNamespace(stats=SimpleNamespace(drawn=1))]
    with batch_progress.DrawnLine(700, 0) as drawn:
        now[0] += 2
        drawn(wall_seen * 128)
    shown = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", capsys.readouterr().err)
    assert "128/700 64 views/s 0:09" in shown


def test_a_terminal_shows_rate_and_time_left(wall, tmp_path):
    """One line of 80 columns with count, rate and time; in the end what there is."""
    path = tmp_path / "poses.csv"
    path.write_text(CSV + "0,0,0,0,0,0\n" * 999)
    with on_terminal("batch", wall, path, "-o", tmp_path / "out", *LENS) as terminal:
        assert terminal.wait_for_end() == 0
    shown = [line for line in terminal.screen.replace("\r", "\n").split("\n") if "views/s" in line]
    assert any("drawing" in line and "1000/1000" in line for line in shown)
    assert all(len(line) <= 80 for line in shown if line.startswith("drawing"))
    assert "1,000 views, 1,000 of them drawn now" in terminal.screen.replace("\r\n", "")
