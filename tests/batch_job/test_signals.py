"""Signals and second runs: an output is let go in order, and has one writer."""

from __future__ import annotations

import os
import signal

import pytest

from depthwarp.batch_job.workplace import Workplace
from depthwarp.cli.batch_progress import Interruption
from depthwarp.errors import InputError
from tests.batch_job.conftest import LENS, write_csv
from tests.batch_job.programs import end_of, folder_of, lines_of, started, wait_for_lines
from tests.cli.conftest import invoke


@pytest.mark.parametrize("name", ["out", "out.npz"])
def test_the_second_of_two_runs_is_refused(room, tmp_path, name):
    """While one process writes an output another cannot; after a kill the next one can."""
    poses, out = write_csv(tmp_path / "poses.csv", 3000), tmp_path / name
    job = ("batch", room, poses, "-o", out, *LENS, "--filters", "none")
    with started(*job) as first:
        wait_for_lines(first, folder_of(out), 1)
        os.kill(first.pid, signal.SIGSTOP)  # it is there, and not done before we look
        refused = invoke(*job)
    assert refused.exit_code == 2 and "another run" in refused.stderr
    with Workplace(folder_of(out), out):
        pass


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_in_order(room, tmp_path, number):
    """Exit code 130, one line that says how far it came, whole files, no lock left."""
    poses, out = write_csv(tmp_path / "poses.csv", 5000), tmp_path / "out"
    with started("batch", room, poses, "-o", out, *LENS, "--filters", "none") as process:
        wait_for_lines(process, out, 100)
        process.send_signal(number)
        code, said = end_of(process)
    assert code == 130, said
    written = lines_of(out)
    assert 100 <= written < 5000
    assert f"{written:,} of 5,000 views are written; the same command goes on" in said
    assert "Traceback" not in said
    assert {path.name for path in out.iterdir()} == {
        "batch.json",
        "views.jsonl",
        *(f"{k:06}.png" for k in range(written)),
    }


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_before_there_is_a_lock_ends_it_alike(room, tmp_path, number):
    """While the poses are read: exit code 130, one line, no output."""
    poses, out = tmp_path / "poses.csv", tmp_path / "out"
    os.mkfifo(poses)
    with started("batch", room, poses, "-o", out, *LENS) as process:
        with poses.open("w"):  # waits until the program reads
            process.send_signal(number)
            code, said = end_of(process)
    assert (code, said.splitlines()[-1]) == (130, "error: interrupted")
    assert "Traceback" not in said and not out.exists()


class Steps:
    """A context that is sent a signal on its way in and on its way out."""

    def __init__(self) -> None:
        self.taken: list[str] = []

    def __enter__(self) -> None:
        signal.raise_signal(signal.SIGTERM)
        self.taken.append("entered")

    def __exit__(self, *exception: object) -> None:
        self.taken.append("left")


def test_a_signal_waits_until_a_lock_is_taken():
    """It comes out of the block, which is not begun, after the lock has been let go."""
    steps = Steps()
    with Interruption() as interruption, pytest.raises(KeyboardInterrupt):
        with interruption.held_off(steps):
            steps.taken.append("begun")
    assert steps.taken == ["entered", "left"]


def test_what_a_signal_broke_off_is_no_defect():
    """An import that a signal breaks off fails as it likes: it is still the signal."""
    with pytest.raises(KeyboardInterrupt), Interruption():
        try:
            signal.raise_signal(signal.SIGTERM)
        except KeyboardInterrupt as error:
            raise ImportError("cannot load an extension") from error
    with pytest.raises(InputError), Interruption():
        raise InputError("no lens")
