"""The scan on disk: whole frames, a journal that survives kills, damage that is found."""

from __future__ import annotations

import json
import math
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from depthwarp.errors import FileFormatError, InputError
from depthwarp.scanner.frames import Frame, PixelFormat, SourceInfo
from depthwarp.scanner.plan import ScanPlan
from depthwarp.scanner.recording import Recording, Step, lit, off
from tests.scanner.fakes import SIZE, FakeAxis, FakeSource
from tests.scanner.scan_until_killed import STEPS

PROJECT = Path(__file__).resolve().parents[2]
SOURCE = SourceInfo("fake", "F-1", SIZE, PixelFormat.MONO, is_emulated=True)


def frame(value: int = 0, **changes: object) -> Frame:
    """A frame of one value."""
    settings = {
        "pixels": np.full(SIZE[::-1], value, np.uint8),
        "pixel_format": PixelFormat.MONO,
        "bits": 8,
        "exposure_us": 100.0,
        "gain_db": 0.0,
        "host_time_ns": 5,
        "camera_time_ns": None,
        "sequence": value,
    }
    return Frame(**(settings | changes))


def begin(folder: Path, steps: int = 4) -> Recording:
    """A new recording with `steps` stops."""
    return Recording.create(folder, ScanPlan.turn(steps), SOURCE, {"calibration": "abc"})


def take(recording: Recording, number: int) -> None:
    """Record a stop."""
    frames = {off(0): frame(number), lit(0): frame(100 + number)}
    recording.append(Step(number, recording.plan.angles[number], 90.1 * number, frames))


def test_what_is_recorded_is_read_back(tmp_path):
    """Pixels, angles, settings and the plan come back as they were; NaN too."""
    recording = begin(tmp_path / "scan")
    take(recording, 0)
    pixels = np.arange(SIZE[0] * SIZE[1], dtype=np.uint16).reshape(SIZE[::-1])
    odd = frame(pixels=pixels, bits=12, exposure_us=math.nan, camera_time_ns=7)
    recording.append(Step(1, 90.0, 90.1125, {off(0): odd, lit(0): odd}))
    again = Recording.open(tmp_path / "scan")
    assert again.plan == recording.plan and again.source == SOURCE
    assert again.settings == {"calibration": "abc"}
    assert again.finished == {0, 1} and again.remaining == [2, 3]
    first, second = again.steps()
    assert first.frames[lit(0)].pixels[0, 0] == 100 and first.reported == 0.0
    found = second.frames[off(0)]
    assert np.array_equal(found.pixels, pixels) and found.pixels.dtype == np.uint16
    assert math.isnan(found.exposure_us) and found.camera_time_ns == 7 and found.bits == 12
    assert second.reported == 90.1125


def test_a_line_cut_anywhere_costs_at_most_its_own_stop(tmp_path):
    """A kill may cut the journal at any byte: the stops before are there, the scan goes on."""
    recording = begin(tmp_path)
    take(recording, 0)
    complete = (tmp_path / "journal.jsonl").read_bytes()
    take(recording, 1)
    both = (tmp_path / "journal.jsonl").read_bytes()
    for length in range(len(complete), len(both)):
        (tmp_path / "journal.jsonl").write_bytes(both[:length])
        again = Recording.open(tmp_path)
        assert again.finished == {0}
    take(again, 1)
    assert Recording.open(tmp_path).finished == {0, 1}
    assert (tmp_path / "journal.jsonl").read_bytes() == both


def test_reading_changes_nothing(tmp_path):
    """Opening a recording with an unfinished line leaves every byte of it."""
    recording = begin(tmp_path)
    take(recording, 0)
    with (tmp_path / "journal.jsonl").open("ab") as journal:
        journal.write(b"0123abcd {unfinished")
    before = (tmp_path / "journal.jsonl").read_bytes()
    assert len(list(Recording.open(tmp_path).steps())) == 1
    assert (tmp_path / "journal.jsonl").read_bytes() == before


def test_damage_in_the_middle_is_refused(tmp_path):
    """A flipped bit before the last line is no unfinished write: it is named, not passed over."""
    recording = begin(tmp_path)
    for number in range(3):
        take(recording, number)
    path = tmp_path / "journal.jsonl"
    content = bytearray(path.read_bytes())
    content[60] ^= 1
    path.write_bytes(content)
    with pytest.raises(FileFormatError, match="line 1 of 3 is damaged"):
        Recording.open(tmp_path)


def test_a_stop_twice_is_refused(tmp_path):
    """Neither the recorder nor a journal can hold a stop twice."""
    recording = begin(tmp_path)
    take(recording, 0)
    with pytest.raises(InputError, match="stop 0 is recorded already"):
        take(recording, 0)
    path = tmp_path / "journal.jsonl"
    path.write_bytes(path.read_bytes() * 2)
    with pytest.raises(FileFormatError, match="records stop 0 again"):
        Recording.open(tmp_path)


@pytest.mark.parametrize("damage", ["missing", "changed", "cut"])
def test_a_frame_that_is_not_what_was_recorded(tmp_path, damage):
    """A missing, changed or shortened frame is named with its stop."""
    take(begin(tmp_path), 0)
    path = tmp_path / "frames" / "000000_off0.npy"
    if damage == "missing":
        path.unlink()
    elif damage == "changed":
        np.save(path, np.load(path) + 1)
    else:
        path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(FileFormatError, match="frame 'off0' of stop 0"):
        list(Recording.open(tmp_path).steps())


def test_folders_that_hold_no_scan(tmp_path):
    """No scan, another file, another version, a plan that is none: each is said."""
    with pytest.raises(FileNotFoundError, match="holds no scan"):
        Recording.open(tmp_path)
    path = tmp_path / "scan.json"
    for text, words in (
        ("{", "damaged"),
        ("[]", "not a scan of this version"),
        ('{"schema": "depthwarp scan 99"}', "not a scan of this version"),
        ('{"schema": "depthwarp scan 1", "plan": {"angles": []}}', "damaged"),
    ):
        path.write_text(text)
        with pytest.raises(FileFormatError, match=words):
            Recording.open(tmp_path)


def test_a_second_scan_does_not_overwrite_the_first(tmp_path):
    """A folder with a scan is refused, with the remedy."""
    begin(tmp_path)
    with pytest.raises(InputError, match="--resume"):
        begin(tmp_path)


def test_a_folder_that_cannot_be_made(tmp_path):
    """A file in the way is an input error."""
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot write"):
        begin(tmp_path / "file" / "scan")


def snapshot(folder: Path) -> dict[tuple[int, str], bytes]:
    """All frames and angles of a finished recording."""
    recording = Recording.open(folder)
    assert recording.remaining == []
    return {
        (step.number, name): np.float64(step.reported).tobytes() + found.pixels.tobytes()
        for step in recording.steps()
        for name, found in step.frames.items()
    }


def test_a_scan_killed_fifty_times_equals_an_unbroken_one(tmp_path):
    """SIGKILL at random moments; after the last resume no frame is lost, doubled or changed."""
    rng = random.Random(2015)
    command = [sys.executable, "-m", "tests.scanner.scan_until_killed"]
    subprocess.run([*command, tmp_path / "whole"], cwd=PROJECT, check=True, capture_output=True)
    killed_midway = 0
    for _ in range(50):
        process = subprocess.Popen(
            [*command, tmp_path / "broken"], cwd=PROJECT, stdout=subprocess.PIPE
        )
        assert process.stdout is not None and process.stdout.readline() == b"ready\n"
        time.sleep(rng.uniform(0, 0.015))
        process.send_signal(signal.SIGKILL)
        process.wait()
        process.stdout.close()
        killed_midway += process.returncode == -signal.SIGKILL
    assert killed_midway == 50
    subprocess.run([*command, tmp_path / "broken"], cwd=PROJECT, check=True, capture_output=True)
    whole = snapshot(tmp_path / "whole")
    assert len(whole) == STEPS * 4
    assert snapshot(tmp_path / "broken") == whole
    names = {path.name for path in (tmp_path / "broken" / "frames").iterdir()}
    assert {name for name in names if not name.startswith(".")} == {
        path.name for path in (tmp_path / "whole" / "frames").iterdir()
    }
    entries = json.loads((tmp_path / "broken" / "scan.json").read_text())
    assert entries["plan"]["exposures_us"] == [100.0, 400.0]


def test_the_fakes_are_deterministic():
    """A frame follows from angle, laser and exposure: the kill test compares like with like."""
    frames = []
    for _ in range(2):
        axis = FakeAxis()
        source = FakeSource(axis)
        axis.move_to(10)
        source.configure(100, 0)
        frames.append(source.grab(1).pixels)
    assert np.array_equal(*frames)
