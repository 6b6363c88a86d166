"""`depthwarp info`, `doctor`, `--version` and `--help`."""

from __future__ import annotations

import json

import pytest

import depthwarp as dw


def test_info_says_what_is_in_a_cloud(run, wall):
    """Points, bounds and extent, for people and as JSON."""
    text = run("info", wall)
    assert text.exit_code == 0 and "6,400" in text.stdout
    answer = json.loads(run("info", wall, "--json").stdout)
    assert answer["points"] == answer["finite_points"] == 6400
    assert answer["extent_m"] == [0.0, 4.0, 4.0]
    assert answer["min_m"] == [4.0, -2.0, -2.0]


def test_info_of_a_cloud_with_attributes_and_nan(run, tmp_path):
    """Attributes are listed with type and bounds; points that are not finite are counted."""
    path = tmp_path / "cloud.csv"
    path.write_text("x,y,z,intensity\n1,2,3,10\nnan,0,0,30\n")
    answer = json.loads(run("info", path, "--json").stdout)
    assert (answer["points"], answer["finite_points"]) == (2, 1)
    assert answer["attributes"]["intensity"]["max"] == 30
    assert "intensity" in run("info", path).stdout


def test_doctor_tests_every_device(run):
    """The CPU renders the test cloud; versions and extras are listed."""
    result = run("doctor", "--json")
    assert result.exit_code == 0, result.stderr
    report = json.loads(result.stdout)
    assert report["depthwarp"] == dw.__version__
    assert report["devices"][0]["name"] == "cpu" and report["devices"][0]["ok"]
    assert "warp-lang" in report["packages"]
    text = run("doctor")
    assert "works" in text.stdout and "depthwarp" in text.stdout


def test_doctor_fails_when_a_device_does(run, monkeypatch):
    """A device that cannot render is said to fail, and the exit code is 1."""

    def broken(*_: object, **__: object) -> None:
        raise RuntimeError("no such kernel")

    monkeypatch.setattr("depthwarp.render", broken, raising=False)
    result = run("doctor", "--json")
    assert result.exit_code == 1
    assert "no such kernel" in json.loads(result.stdout)["devices"][0]["problem"]


def test_version_and_help(run_program):
    """The program names its version and its commands, quickly enough to do so without Warp."""
    assert run_program("--version").stdout.strip() == f"depthwarp {dw.__version__}"
    text = run_program("--help").stdout
    for command in ("demo", "render", "info", "doctor"):
        assert command in text


@pytest.mark.parametrize("arguments", [["rendre"], ["render"], ["info", "--loud"]])
def test_usage_errors_exit_with_2(run, arguments):
    """A mistyped command or a missing argument is bad usage."""
    assert run(*arguments).exit_code == 2
