"""Full disks: a batch stops with one line, and goes on when there is room."""

from __future__ import annotations

import errno
import json
import os
import shutil
from pathlib import Path

import pytest

from depthwarp.batch_job import outputs
from depthwarp.batch_job.workplace import Workplace
from tests.batch_job.conftest import LENS, content, write_csv
from tests.batch_job.programs import end_of, lines_of, started
from tests.cli.conftest import invoke


def full_after(monkeypatch: pytest.MonkeyPatch, writes: int) -> None:
    """Let the disk be full after so many files, for one file: whoever goes on leaves a gap."""
    put, left = Workplace.put, [writes]

    def put_or_fail(work: Workplace, target: Path, image: bytes) -> None:
        left[0] -= 1
        if left[0] == -1:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        put(work, target, image)

    monkeypatch.setattr(Workplace, "put", put_or_fail)


def test_a_full_disk_stops_it_and_what_is_written_stays(room, tmp_path, monkeypatch, small_tiles):
    """The writer's error ends the job with one line; with room again it goes on."""
    poses, out = write_csv(tmp_path / "poses.csv", 50), tmp_path / "out"
    job = ("batch", room, poses, *LENS, "--filters", "none", "-o")
    assert invoke(*job, tmp_path / "whole").exit_code == 0
    with monkeypatch.context() as full:
        full_after(full, writes=20)  # the description and 19 views
        result = invoke(*job, out)
    assert result.exit_code == 2, result.output
    error = next(line for line in result.stderr.splitlines() if line.startswith("error:"))
    assert "No space left" in error and "the same command continues" in error
    assert lines_of(out) == len(list(out.glob("*.png"))) == 19
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


def test_an_npz_that_has_no_room_says_sizes_that_can_be_read(room, tmp_path, monkeypatch):
    """Less than a gigabyte is said in megabytes."""
    poses, usage = write_csv(tmp_path / "poses.csv", 5), shutil.disk_usage(tmp_path)
    monkeypatch.setattr(shutil, "disk_usage", lambda path: usage._replace(free=6_290_000))
    job = ("batch", room, poses, "-o", tmp_path / "out.npz", "--fov", "70", "55", "--size")
    result = invoke(*job, "10000", "10000")
    assert result.exit_code == 2 and not (tmp_path / "out.npz.part").exists()
    assert "it will be 4.5 GB" in result.stderr and "6.29 MB are free" in result.stderr


def test_a_defect_of_the_writer_is_not_hidden(room, tmp_path, monkeypatch):
    """Any error in the writer's thread ends the job with its own exit code."""

    def broken(*_: object) -> bytes:
        raise RuntimeError("boom")

    monkeypatch.setattr(outputs.PngFolder, "_image", broken)
    poses = write_csv(tmp_path / "poses.csv", 300)
    result = invoke("batch", room, poses, "-o", tmp_path / "out", *LENS)
    assert result.exit_code == 1 and "boom" in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_disk_that_takes_no_more_lines_is_continued(room, tmp_path):
    """Files that the system cuts short: one line of error, whole lines, and the bytes in the end.

    The journal of 400 views is longer than the limits; with the first not even one tile fits.
    """
    poses, out = write_csv(tmp_path / "poses.csv", 400), tmp_path / "out"
    job = ("batch", room, poses, *LENS, "--filters", "none", "-o")
    assert invoke(*job, tmp_path / "whole").exit_code == 0
    for largest, written in ((30_000, 0), (170_000, 128)):
        with started(*job, out, largest=largest) as process:
            code, said = end_of(process)
        errors = [line for line in said.splitlines() if line.startswith("error:")]
        assert (code, len(errors)) == (2, 1) and "Traceback" not in said, said
        assert "File too large" in errors[0] and "the same command continues" in errors[0]
        assert lines_of(out) == written
    assert invoke(*job, out).exit_code == 0
    assert content(out) == content(tmp_path / "whole")
