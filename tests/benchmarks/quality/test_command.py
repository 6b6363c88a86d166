"""The quality benchmark's command: tables, JSON lines, pictures; and the real recordings."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from benchmarks.quality.__main__ import main
from benchmarks.quality.jumps import jumps
from benchmarks.quality.real import real_cases
from benchmarks.quality.truth import Label


def test_one_case_from_table_to_picture(tmp_path: Path, capsys):
    """A table on stdout, one JSON line a chain with all scores, a picture that is not blank."""
    lines, pictures = tmp_path / "quality.jsonl", tmp_path / "pictures"
    options = ["--scene", "slopes", "--points", "20000", "--views", "1", "--dirty", "no"]
    options += ["--chain", "raw", "bound + nearest"]
    assert main([*options, "--json", str(lines), "--pictures", str(pictures)]) == 0
    output = capsys.readouterr().out
    assert "slopes 0.02M" in output and "bound + nearest" in output
    raw, bound = (json.loads(line) for line in lines.read_text().splitlines())
    assert raw["case"] == bound["case"] == "slopes 0.02M"
    assert bound["leak"] == 0 < raw["leak"]
    assert bound["observed"]["coverage"] > raw["observed"]["coverage"] > 0
    assert {"mae_m", "rmse_m", "within", "pixels"} <= set(bound["edge_band"])
    assert bound["splat_ms"] > 0 and bound["machine"]["cores"] >= 1
    (picture,) = pictures.glob("*.png")
    assert cv2.imread(str(picture)).std() > 30


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--views", "9"], "from 1 to 8"),
        (["--points", "10"], "at least 1000"),
        (["--device", "toaster"], "toaster"),
        (["--json", "no/such/folder/scores.jsonl"], "no/such/folder"),
        (["--chain", "best", "bst"], "no chain has 'bst' in its name; there are: raw splat;"),
    ],
)
def test_bad_options_are_refused(capsys, options, says):
    """The message says what is allowed; the exit code is that of bad usage."""
    with pytest.raises(SystemExit) as stopped:
        main(options)
    assert stopped.value.code == 2 and says in capsys.readouterr().err


def test_a_slanted_floor_has_no_jumps_and_a_step_has_one():
    """A floor 0.4 m below the camera up to 80 m, then a wall 0.5 m before the floor's next row."""
    down = np.linspace(0.005, 0.5, 60)[::-1]
    rays = np.stack(np.broadcast_arrays(down[:, None] * 0 + 1.0, np.zeros(5), -down[:, None]), -1)
    depth = np.repeat(0.4 / down[:, None], 5, axis=1)
    normal = np.broadcast_to([0.0, 0.0, 1.0], rays.shape).copy()
    assert np.abs(np.diff(depth, axis=0)).max() > 10
    assert not jumps(depth, normal, rays, 0).any()
    depth[30:], normal[30:] = depth[29] - 0.5, (-1.0, 0.0, 0.0)
    found = jumps(depth, normal, rays, 0)
    assert found[29].all() and np.count_nonzero(found) == 5
    assert not jumps(depth, normal, rays, 1).any()


def test_real_recordings_are_read(shared_data: Path):
    """Every set that is there: maps beside their truth, right where a raw splat is right."""
    told: list[str] = []
    right = {}
    for name, shots in real_cases(shared_data, told.append):
        for shot in shots:
            assert shot.raw.depth.shape == shot.view.depth.shape == shot.label.shape
            assert shot.view.observed.mean() > 0.002
            both = (shot.raw.depth > 0) & (shot.view.depth > 0) & (shot.label == Label.VISIBLE)
            if both.any():
                right[name] = np.median(np.abs(shot.raw.depth - shot.view.depth)[both])
    if not right:
        pytest.skip(f"no real recordings on this machine: {told}")
    print({name: f"{1000 * value:.1f} mm" for name, value in right.items()})
    assert max(right.values()) < 0.02


def test_recordings_that_are_not_there_are_named(tmp_path: Path):
    """One message a set, with the file that is looked for."""
    told: list[str] = []
    assert list(real_cases(tmp_path, told.append)) == []
    assert len(told) == 4 and all(str(tmp_path) in line for line in told)
