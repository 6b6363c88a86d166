"""Kills and damage: nothing is lost, doubled or half-written."""

from __future__ import annotations

import errno
import json
import os
import random
import time
from pathlib import Path

import numpy as np
import pytest

from depthwarp.batch_job import outputs, workplace
from depthwarp.batch_job.zarr_store import ZarrStore
from tests.batch_job.conftest import LENS, content, write_csv
from tests.batch_job.programs import folder_of, lines_of, started, wait_for_lines
from tests.cli.conftest import invoke

OUTPUTS = ["out", "out.npz", "out.zarr"]


@pytest.mark.parametrize("name", OUTPUTS)
def test_killed_batches_give_the_bytes_of_an_unbroken_one(room, tmp_path, name):
    """SIGKILL at three random moments, then the same command: every file, byte for byte."""
    if name.endswith(".zarr"):
        pytest.importorskip("zarr")
    poses, moments = write_csv(tmp_path / "poses.csv", 700), random.Random(4)
    broken, whole = tmp_path / name, tmp_path / f"whole{name}"
    job = ("batch", room, poses, *LENS, "--filters", "none", "-o")
    assert invoke(*job, whole).exit_code == 0
    kills = 0
    for part in range(3):
        with started(*job, broken) as process:
            wait_for_lines(process, folder_of(broken), 128 * part + moments.randrange(2))
            time.sleep(moments.uniform(0, 0.1))
            process.kill()
            process.wait()
        kills += folder_of(broken).exists() and lines_of(folder_of(broken)) < 700
    assert kills >= 2
    result = invoke(*job, broken)
    assert result.exit_code == 0, result.output
    assert "continuing" in result.stderr
    if broken.is_dir():
        assert content(broken) == content(whole)
    else:
        assert broken.read_bytes() == whole.read_bytes()
    assert broken.suffix == "" or not folder_of(broken).exists()


def full_disk(*_: object) -> None:
    """What a full disk does."""
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def damage(folder: Path) -> None:
    """What a kill or a power cut may leave: half a line, half a file, a file without a line."""
    journal = folder / "views.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(lines[:-2]) + lines[-2][:40])
    (folder / "000001.png").write_bytes(b"")
    (folder / "000002.png").unlink()
    (folder / ".unfinished").write_bytes(b"half a file")


def test_chunks_that_are_damaged_are_written_again(room, tmp_path):
    """Of an unfinished Zarr store: a chunk cut short, one that is gone, and what a kill left."""
    pytest.importorskip("zarr")
    poses, out = write_csv(tmp_path / "poses.csv", 30), tmp_path / "out.zarr"
    job = ("batch", room, poses, *LENS, "--filters", "none", "--json", "-o")
    assert invoke(*job, tmp_path / "whole.zarr").exit_code == 0
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ZarrStore, "_put_together", full_disk)
        assert invoke(*job, out).exit_code == 2
    store = folder_of(out) / "whole.zarr"
    (store / "depth" / "c.3.0.0").write_bytes(b"cut")
    (store / "index" / "c.20.0.0").unlink()
    (store / "state" / "c.7.0.partial").write_bytes(b"half a chunk")
    (store / "counts").mkdir()
    assert json.loads(invoke(*job, out).stdout)["drawn"] == 2
    assert content(out) == content(tmp_path / "whole.zarr")


def test_what_is_damaged_is_drawn_again(room, tmp_path):
    """A torn line, a file of no bytes and one that is gone: only these views are drawn again.

    In the end all files are as before, the journal with its lines in the order of the views too.
    """
    poses = write_csv(tmp_path / "poses.csv", 10)
    out, job = tmp_path / "out", ("batch", room, poses, *LENS)
    assert invoke(*job, "-o", out).exit_code == 0
    before = content(out)
    damage(out)
    result = invoke(*job, "-o", out, "--json")
    assert json.loads(result.stdout)["drawn"] == 4
    assert content(out) == before


def test_a_full_disk_at_the_ordering_loses_no_line(room, tmp_path, monkeypatch):
    """The journal stays as it was, whole; the same command puts it in order."""
    poses, out = write_csv(tmp_path / "poses.csv", 10), tmp_path / "out"
    job = ("batch", room, poses, *LENS, "-o", out, "--json")
    assert invoke(*job).exit_code == 0
    before = content(out)
    (out / "000003.png").unlink()
    with monkeypatch.context() as patch:
        patch.setattr(workplace, "lines_in_order", full_disk)
        result = invoke(*job)
    assert result.exit_code == 2 and "the same command continues" in result.stderr
    lines = (out / "views.jsonl").read_bytes().splitlines()
    assert [json.loads(line)["view"] for line in lines] == [0, 1, 2, 4, 5, 6, 7, 8, 9, 3]
    assert json.loads(invoke(*job).stdout)["drawn"] == 0
    assert content(out) == before


def test_a_batch_that_is_whole_is_left_as_it_is(room, tmp_path):
    """The same command again draws nothing, whatever the output is."""
    pytest.importorskip("zarr")
    poses = write_csv(tmp_path / "poses.csv", 4)
    for name in OUTPUTS:
        arguments = ("batch", room, poses, "-o", tmp_path / name, *LENS, "--json")
        assert invoke(*arguments).exit_code == 0
        before = content(tmp_path)
        assert json.loads(invoke(*arguments).stdout)["drawn"] == 0
        assert content(tmp_path) == before


@pytest.mark.parametrize("name", ["out", "out.npz"])
@pytest.mark.parametrize(
    ("changes", "says"),
    [
        (("--max-range", "9"), "--max-range is 9.0, it was 15.0"),
        (("--min-range", "1"), "--min-range"),
        (("--depth", "z"), "--depth is z, it was range"),
        (("--filters", "none"), "--filters is none"),
        (("--fov", "71", "55"), "the lens"),
        (("--size", "16", "14"), "the lens"),
        (("--offset", "1", "0", "0"), "the cloud"),
    ],
)
def test_other_settings_are_refused_with_what_differs(room, tmp_path, name, changes, says):
    """A batch is continued only by the command that began it; its files stay."""
    poses, out = write_csv(tmp_path / "poses.csv", 4), tmp_path / name
    arguments = ("batch", room, poses, "-o", out, *LENS)
    assert invoke(*arguments).exit_code == 0
    before = content(tmp_path)
    result = invoke(*arguments, *changes)
    assert result.exit_code == 2 and says in result.stderr
    assert content(tmp_path) == before


def test_other_inputs_are_refused_with_what_differs(room, tmp_path):
    """Another cloud, other poses, another number of them, another encoding."""
    poses, out = write_csv(tmp_path / "poses.csv", 4), tmp_path / "out"
    assert invoke("batch", room, poses, "-o", out, *LENS).exit_code == 0
    small = tmp_path / "small.npz"
    np.savez(small, points=np.ones((5, 3), np.float32))
    turned = tmp_path / "turned.csv"
    turned.write_text(poses.read_text().replace("37.0", "38.0"))
    more = write_csv(tmp_path / "more.csv", 5)
    for cloud, other, options, says in (
        (small, poses, (), "the cloud has 5 points, it had 4000"),
        (room, turned, (), "the poses are others"),
        (room, more, (), "number of views is 5, it was 4"),
        (room, poses, ("--encoding", "kitti"), "--encoding is kitti"),
    ):
        result = invoke("batch", cloud, other, "-o", out, *LENS, *options)
        assert result.exit_code == 2 and says in result.stderr


def test_a_break_while_the_journal_is_read_loses_nothing(room, tmp_path, monkeypatch):
    """The views of a batch count on, though none was counted when the signal came."""
    poses, out = write_csv(tmp_path / "poses.csv", 4), tmp_path / "out"
    job = ("batch", room, poses, "-o", out, *LENS, "--json")
    assert invoke(*job).exit_code == 0
    before = content(out)

    def broken(*_: object) -> bool:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(outputs.PngFolder, "_is_whole", broken)
        assert invoke(*job).exit_code == 130
    assert content(out) == before
    assert json.loads(invoke(*job).stdout)["drawn"] == 0


@pytest.mark.parametrize("name", OUTPUTS)
def test_a_view_counts_when_it_is_on_the_disk(room, tmp_path, monkeypatch, small_tiles, name):
    """Before each write to the journal all files of its views, and their folder, are synced."""
    if name.endswith(".zarr"):
        pytest.importorskip("zarr")
    poses, out = tmp_path / "poses.csv", tmp_path / name
    poses.write_text(
        "name,x,y,z,roll,pitch,yaw\n" + "".join(f"a/{k},0,0,0,0,0,{k}\n" for k in range(40))
    )
    synced, counted = set[Path](), list[int]()
    sync, write_all = workplace.sync, workplace.write_all

    def noting(path: Path) -> None:
        sync(path)
        synced.add(path.relative_to(folder_of(out).parent))

    def checking(file, content) -> None:
        lines = [json.loads(line) for line in content.splitlines()]
        folder = Path(folder_of(out).name)
        for line in lines:
            made = {
                "out": [f"{line['name']}.png"],
                "out.npz": ["depth.npy", "index.npy", "state.npy"],
                "out.zarr": [
                    f"whole.zarr/{array}/c.{line['view']}.0.0"
                    for array in ("depth", "index", "state")
                ],
            }[name]
            for path in made:
                assert {folder, folder / path, (folder / path).parent} <= synced
        counted.append(len(lines))
        synced.clear()
        write_all(file, content)

    monkeypatch.setattr(workplace, "sync", noting)
    monkeypatch.setattr(workplace, "write_all", checking)
    result = invoke("batch", room, poses, "-o", out, *LENS, "--filters", "none")
    assert result.exit_code == 0, result.output
    assert counted == [16, 16, 8]
