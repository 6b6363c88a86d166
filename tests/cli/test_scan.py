"""`depthwarp scan` and `replay` on the twin, through the whole program."""

from __future__ import annotations

import io
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import depthwarp as dw
from depthwarp.cli.steering import ask_person
from depthwarp.scanner.calibration import load_calibration
from depthwarp.scanner.recording import Recording, Step, lit, off
from tests.cli.conftest import invoke

SMALL = ("--stops", "12", "--twin-scale", "0.125")


@pytest.fixture(scope="module")
def scanned(tmp_path_factory) -> Path:
    """The folder of one unbroken small scan."""
    folder = tmp_path_factory.mktemp("scan") / "whole"
    result = invoke("scan", "-o", folder, *SMALL)
    assert result.exit_code == 0, result.stderr
    return folder


def test_a_scan_leaves_a_recording_and_a_cloud(scanned):
    """All stops are recorded; the cloud says of every point how it came about."""
    recording, cloud = Recording.open(scanned), dw.read(scanned / "cloud.ply")
    assert recording.remaining == [] and len(recording.finished) == 12
    assert len(cloud) > 1500
    assert {"sigma", "range", "row", "angle", "intensity", "frame"} <= set(cloud.attributes)
    assert set(np.unique(cloud.attributes["frame"])) == set(range(12))


def test_a_replay_gives_the_same_bytes(scanned, tmp_path):
    """From the recording alone the same cloud comes again; the counts are said as JSON."""
    result = invoke("replay", scanned, "-o", tmp_path / "again.ply", "--json")
    assert result.exit_code == 0, result.stderr
    assert (tmp_path / "again.ply").read_bytes() == (scanned / "cloud.ply").read_bytes()
    counts = json.loads(result.stdout)["counts"]
    assert counts["stops"] == 12 and counts["points"] == len(dw.read(tmp_path / "again.ply"))


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_scan_in_order_and_resume_finishes_it(scanned, tmp_path, number):
    """Ctrl-C and SIGTERM leave a whole recording; resumed, it gives the same cloud."""
    folder = tmp_path / "broken"
    process = subprocess.Popen(
        [sys.executable, "-m", "depthwarp", "scan", "-o", str(folder), *SMALL],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "COLUMNS": "200"},
    )
    deadline = time.monotonic() + 60
    journal = folder / "journal.jsonl"
    while not (journal.exists() and journal.read_bytes().count(b"\n") >= 2):
        assert process.poll() is None and time.monotonic() < deadline
        time.sleep(0.005)
    process.send_signal(number)
    _, said = process.communicate(timeout=60)
    if process.returncode == 0:
        pytest.skip("the scan was over before the signal came")
    assert process.returncode == 2 and "--resume" in said, said
    assert 2 <= len(Recording.open(folder).finished) < 12
    result = invoke("scan", "-o", folder, "--resume", *SMALL)
    assert result.exit_code == 0, result.stderr
    assert "continuing" in result.stderr
    assert (folder / "cloud.ply").read_bytes() == (scanned / "cloud.ply").read_bytes()


def test_what_does_not_fit_together_is_refused(scanned, tmp_path):
    """Half a twin, no calibration, a second scan in a folder, a foreign calibration, no scan."""
    cases = [
        (["scan", "-o", tmp_path / "a", "--camera", "folder:x"], "belong together"),
        (["scan", "-o", tmp_path / "a", "--axis", "simulated", "--camera", "opencv:0"], "calibra"),
        (["scan", "-o", scanned, *SMALL], "--resume"),
        (["scan", "-o", tmp_path / "b", "--resume", *SMALL], "holds no scan"),
        (["scan", "-o", scanned, "--resume", "--stops", "12"], "begun with camera"),
        (["scan", "-o", tmp_path / "c", "--stops", "0"], "stops must be 1 to"),
        (["scan", "-o", tmp_path / "c", "--twin-scale", "0"], "scale"),
        (["scan", "-o", tmp_path / "c", "--position", "0", "nan", "0", *SMALL], "--position"),
        (["scan", "-o", tmp_path / "c", "--at-start", *SMALL], "give --resume"),
        (["replay", tmp_path / "d", "-o", tmp_path / "d.ply"], "holds no scan"),
        (["replay", scanned, "-o", tmp_path / "d.docx"], "unknown suffix"),
    ]
    for arguments, words in cases:
        result = invoke(*arguments)
        assert result.exit_code == 2 and words in result.stderr, (arguments, result.stderr)
    assert not list(tmp_path.iterdir())


def test_a_camera_or_a_port_that_does_not_do_leaves_no_scan_behind(scanned, tmp_path):
    """A grey camera is refused before the turn; a wrong port can be corrected and tried again."""
    calibration = load_calibration(scanned / "calibration.json")
    width, height = calibration.camera_size
    for name, shape, port, words in (
        ("grey", (height, width), "/dev/null", "gives grey frames"),
        ("colour", (height, width, 3), tmp_path / "nowhere", "there is no serial port"),
    ):
        folder = tmp_path / name
        folder.mkdir()
        cv2.imwrite(str(folder / "0.png"), np.zeros(shape, np.uint8))
        own = replace(calibration, camera_serial=str(folder))
        own.save(tmp_path / f"{name}.json")
        result = invoke(
            *("scan", "-o", tmp_path / "scan", "--axis", f"grbl:{port}"),
            *("--camera", f"folder:{folder}", "--calibration", tmp_path / f"{name}.json"),
        )
        assert result.exit_code == 2 and words in result.stderr, result.stderr
        assert not (tmp_path / "scan").exists()


def test_a_calibration_of_another_scan_is_refused(scanned, tmp_path):
    """The recording names its calibration by hash; another one is not used in its place."""
    content = json.loads((scanned / "calibration.json").read_text())
    content["date"] = "2020-01-01T00:00:00+00:00"
    other = tmp_path / "other.json"
    other.write_text(json.dumps(content))
    result = invoke("replay", scanned, "-o", tmp_path / "x.ply", "--calibration", other)
    assert result.exit_code == 2 and "changed" in result.stderr
    assert not (tmp_path / "x.ply").exists()


def altered(scanned: Path, folder: Path, change: Callable[[Step], np.ndarray]) -> Path:
    """A copy of a recording whose lit frames are others."""
    source = Recording.open(scanned)
    copy = Recording.create(folder, source.plan, source.source, source.settings)
    shutil.copy(scanned / "calibration.json", folder)
    for step in source.steps():
        frames = dict(step.frames)
        frames[lit(0)] = replace(frames[lit(0)], pixels=change(step))
        copy.append(replace(step, frames=frames))
    return folder


def with_second_line(step: Step) -> np.ndarray:
    """The light of the line once more, 40 px beside it, in stops 3 to 6."""
    on, without = (step.frames[name].pixels for name in (lit(0), off(0)))
    added = np.roll(np.maximum(on.astype(int) - without, 0), 40, axis=1)
    return on if step.number not in range(3, 7) else np.minimum(on + added, 255).astype(np.uint8)


def test_a_second_line_is_counted_and_warned_of(scanned, tmp_path):
    """A cloud comes out, with a warning that says in how many stops, and what to do."""
    folder = altered(scanned, tmp_path / "two", with_second_line)
    result = invoke("replay", folder, "-o", tmp_path / "two.ply")
    assert result.exit_code == 0, result.stderr
    assert "warning: 4 of 12 stops show two lines" in result.stderr
    assert "switch the other laser off or cover what mirrors" in result.stderr
    result = invoke("replay", folder, "-o", tmp_path / "two.ply", "--json")
    said = json.loads(result.stdout)
    assert said["counts"]["stops_with_two_lines"] == 4
    assert len(said["warnings"]) == 1 and "4 of 12 stops" in said["warnings"][0]


def test_an_undisturbed_scan_warns_of_nothing(scanned, tmp_path):
    """Each stop of the twin's room shows one line."""
    result = invoke("replay", scanned, "-o", tmp_path / "again.ply", "--json")
    said = json.loads(result.stdout)
    assert said["warnings"] == [] and "warning" not in result.stderr
    assert said["counts"]["stops_with_two_lines"] == said["counts"]["stops_without_line"] == 0


@pytest.mark.parametrize("seen", [range(4, 5), range(1, 12, 2), range(11, 12)])
def test_stops_without_a_line_are_warned_of(scanned, tmp_path, seen):
    """Also where the line is in view at few stops the cloud is theirs; the others are counted."""
    folder = altered(
        scanned,
        tmp_path / "dark",
        lambda step: step.frames[lit(0) if step.number in seen else off(0)].pixels,
    )
    result = invoke("replay", folder, "-o", tmp_path / "dark.ply")
    assert result.exit_code == 0, result.stderr
    assert f"warning: {12 - len(seen)} of 12 stops show no laser line" in result.stderr
    assert "check that the laser was on" in result.stderr
    assert set(dw.read(tmp_path / "dark.ply").attributes["frame"]) == set(seen)


def test_no_line_at_any_stop_is_refused(scanned, tmp_path):
    """The laser was off all the time: what was looked at, what to do, and no cloud."""
    folder = altered(scanned, tmp_path / "dark", lambda step: step.frames[off(0)].pixels)
    result = invoke("replay", folder, "-o", tmp_path / "dark.ply")
    assert result.exit_code == 2 and "no laser line is in view" in result.stderr
    assert f"{folder}, stops 0, 1," in result.stderr
    assert "check that the laser is on, in view" in result.stderr
    assert not (tmp_path / "dark.ply").exists()


def test_a_person_is_asked_until_the_answer_is_a_number(monkeypatch, capsys):
    """A slip of the finger does not end the scan; just Enter is no number."""
    monkeypatch.setattr("sys.stdin", io.StringIO("9o\n90.5\n\n"))
    assert ask_person("angle") == 90.5
    assert "'9o' is not a number" in capsys.readouterr().err
    assert ask_person("angle") is None
