"""`depthwarp scan` and `replay` on the twin, through the whole program."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import typer

import depthwarp as dw
from depthwarp.cli.steering import ask_person
from depthwarp.scanner.calibration import load_calibration
from depthwarp.scanner.recording import Recording
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
        (["scan", "-o", tmp_path / "c", "--stops", "0"], "steps must be"),
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


def test_a_person_is_asked_until_the_answer_is_a_number(monkeypatch, capsys):
    """A slip of the finger does not end the scan; just Enter is no number."""
    answers = iter(["9o", "90.5", ""])
    monkeypatch.setattr(typer, "prompt", lambda *_, **__: next(answers))
    assert ask_person("angle") == 90.5
    assert "'9o' is not a number" in capsys.readouterr().err
    assert ask_person("angle") is None
