"""Kills, full disks and second runs: nothing is lost, doubled or half-written."""

from __future__ import annotations

import errno
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from depthwarp.batch_job import outputs
from depthwarp.batch_job.workplace import Workplace
from tests.batch_job.conftest import LENS, content, write_csv
from tests.cli.conftest import invoke


def start(*arguments: object) -> subprocess.Popen[str]:
    """The program in a process of its own."""
    command = [sys.executable, "-m", "depthwarp", *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def lines_of(folder: Path) -> int:
    """Views that the journal holds."""
    journal = folder / "views.jsonl"
    return journal.read_bytes().count(b"\n") if journal.exists() else 0


def wait_for_lines(process: subprocess.Popen[str], folder: Path, count: int) -> None:
    """Wait until so many views are written, or the process is at its end."""
    while lines_of(folder) < count and process.poll() is None:
        time.sleep(0.001)


def damage(folder: Path) -> None:
    """What a kill or a power cut may leave: half a line, half a file, a file without a line."""
    journal = folder / "views.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    journal.write_bytes(b"".join(lines[:-2]) + lines[-2][:40])
    (folder / "000001.png").write_bytes(b"")
    (folder / "000002.png").unlink()
    (folder / ".unfinished").write_bytes(b"half a file")


@pytest.mark.parametrize("suffix", ["", ".npz"])
def test_killed_batches_give_the_bytes_of_an_unbroken_one(room, tmp_path, suffix):
    """SIGKILL at three random moments, then the same command: every file, byte for byte."""
    poses, moments = write_csv(tmp_path / "poses.csv", 1500), random.Random(4)
    whole, broken = tmp_path / f"whole{suffix}", tmp_path / f"broken{suffix}"
    job = ("batch", room, poses, *LENS, "--filters", "none")
    assert invoke(*job, "-o", whole).exit_code == 0
    working = broken.with_name(broken.name + ".part") if suffix else broken
    kills = 0
    for part in range(3):
        process = start(*job, "-o", broken)
        wait_for_lines(process, working, 300 * part + moments.randrange(1, 250))
        time.sleep(moments.uniform(0, 0.01))
        process.kill()
        process.communicate()
        kills += 0 < lines_of(working) < 1500
    assert kills >= 2
    result = invoke(*job, "-o", broken)
    assert result.exit_code == 0, result.output
    assert "continuing" in result.stderr
    if suffix:
        assert broken.read_bytes() == whole.read_bytes()
        assert not working.exists()
    else:
        assert content(broken) == content(whole)


def test_what_is_damaged_is_drawn_again(room, tmp_path):
    """A torn line, a file of no bytes and one that is gone: only these views are drawn again."""
    poses = write_csv(tmp_path / "poses.csv", 10)
    out, job = tmp_path / "out", ("batch", room, poses, *LENS)
    assert invoke(*job, "-o", out).exit_code == 0
    before = content(out)
    damage(out)
    result = invoke(*job, "-o", out, "--json")
    assert json.loads(result.stdout)["drawn"] == 4
    after = content(out)
    assert sorted(after.pop("views.jsonl").splitlines()) == sorted(
        before.pop("views.jsonl").splitlines()
    )
    assert after == before


def test_a_batch_that_is_whole_is_left_as_it_is(room, tmp_path):
    """The same command again draws nothing, for a folder and for an NPZ."""
    poses = write_csv(tmp_path / "poses.csv", 4)
    for name in ("out", "out.npz"):
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


@pytest.mark.parametrize("name", ["out", "out.npz"])
def test_the_second_of_two_runs_is_refused(room, tmp_path, name):
    """While one process writes an output another cannot; after a kill the next one can."""
    poses = write_csv(tmp_path / "poses.csv", 3000)
    out = tmp_path / name
    working = tmp_path / "out.npz.part" if out.suffix else out
    job = ("batch", room, poses, "-o", out, *LENS, "--filters", "none")
    first = start(*job)
    wait_for_lines(first, working, 1)
    os.kill(first.pid, signal.SIGSTOP)  # it is there, and not done before we look
    try:
        refused = invoke(*job)
    finally:
        first.kill()
        first.communicate()
    assert refused.exit_code == 2 and "another run" in refused.stderr
    with Workplace(working, out):
        pass


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_in_order(room, tmp_path, number):
    """Exit code 130, one line that says how far it came, whole files, no lock left."""
    poses, out = write_csv(tmp_path / "poses.csv", 5000), tmp_path / "out"
    process = start("batch", room, poses, "-o", out, *LENS, "--filters", "none")
    wait_for_lines(process, out, 100)
    process.send_signal(number)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130, said
    written = lines_of(out)
    assert 100 <= written < 5000
    assert f"{written:,} of 5,000 views are written; the same command goes on" in said
    assert "Traceback" not in said
    assert {path.name for path in out.iterdir()} == {
        "batch.json",
        "views.jsonl",
        *(f"{k:06}.png" for k in range(written)),
    }


def full_after(monkeypatch: pytest.MonkeyPatch, writes: int) -> None:
    """Let the disk be full after so many files, for one file: whoever goes on leaves a gap."""
    put, left = Workplace.put, [writes]

    def put_or_fail(work: Workplace, target: Path, image: bytes) -> None:
        left[0] -= 1
        if left[0] == -1:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        put(work, target, image)

    monkeypatch.setattr(Workplace, "put", put_or_fail)


def test_a_full_disk_stops_it_and_what_is_written_stays(room, tmp_path, monkeypatch):
    """The writer's error ends the job with one line; with room again it goes on."""
    poses, out = write_csv(tmp_path / "poses.csv", 400), tmp_path / "out"
    job = ("batch", room, poses, *LENS, "--filters", "none", "-o")
    assert invoke(*job, tmp_path / "whole").exit_code == 0
    with monkeypatch.context() as full:
        full_after(full, writes=141)  # the description and 140 views
        result = invoke(*job, out)
    assert result.exit_code == 2, result.output
    error = next(line for line in result.stderr.splitlines() if line.startswith("error:"))
    assert "No space left" in error and "the same command continues" in error
    assert lines_of(out) == len(list(out.glob("*.png"))) == 140
    assert invoke(*job, out).exit_code == 0
    assert content(out) == content(tmp_path / "whole")


def test_a_disk_that_is_full_from_the_beginning_leaves_nothing(room, tmp_path, monkeypatch):
    """No folder without a view."""
    poses, out = write_csv(tmp_path / "poses.csv", 3), tmp_path / "out"
    for writes in (0, 1):
        with monkeypatch.context() as full:
            full_after(full, writes)
            result = invoke("batch", room, poses, "-o", out, *LENS)
        assert result.exit_code == 2 and "No space left" in result.stderr
        assert not out.exists()


def test_a_full_disk_while_the_npz_is_put_together(room, tmp_path, monkeypatch):
    """The parts stay; the same command makes the file of them without drawing."""
    poses, out = write_csv(tmp_path / "poses.csv", 5), tmp_path / "out.npz"
    job = ("batch", room, poses, "-o", out, *LENS, "--json")

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(shutil, "copyfileobj", full)
        result = invoke(*job)
    assert result.exit_code == 2 and "No space left" in result.stderr
    assert not out.exists() and not (tmp_path / "out.npz.part" / "whole.npz").exists()
    assert json.loads(invoke(*job).stdout)["drawn"] == 0
    assert out.exists() and not (tmp_path / "out.npz.part").exists()


def test_a_defect_of_the_writer_is_not_hidden(room, tmp_path, monkeypatch):
    """Any error in the writer's thread ends the job with its own exit code."""

    def broken(*_: object) -> bytes:
        raise RuntimeError("boom")

    monkeypatch.setattr(outputs.PngFolder, "_image", broken)
    poses = write_csv(tmp_path / "poses.csv", 300)
    result = invoke("batch", room, poses, "-o", tmp_path / "out", *LENS)
    assert result.exit_code == 1 and "boom" in result.stderr
    assert not (tmp_path / "out").exists()
