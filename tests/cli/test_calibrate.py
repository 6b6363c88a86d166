"""`depthwarp calibrate` on the twin: pictures, their resumption, the verdict, and the wall."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from depthwarp.scanner.axes import SimulatedAxis
from depthwarp.scanner.calibration import load_calibration
from depthwarp.scanner.calibration.capture import recorded_placements, take_placement
from depthwarp.scanner.geometry import reference_geometry
from depthwarp.scanner.plan import ScanPlan
from depthwarp.scanner.recording import Recording
from depthwarp.scanner.twin import TwinCamera, TwinRenderer, wall_scene
from depthwarp.scanner.twin.session import twin_calibration
from tests.cli.conftest import invoke

PLACES = 8
TAKE = ("--axis", "twin", "--camera", "twin", "--twin-scale", 0.25, "--placements", PLACES)
BOARD = ("--board", "chessboard:9x6:0.1")
STOPS = ("--angles", "1,5,20,35")
WALL_M = 3.0


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict]:
    """A folder of pictures with a calibration beside it, and what the command said as JSON."""
    folder = tmp_path_factory.mktemp("calibrate")
    result = invoke(
        "calibrate", folder / "boards", "-o", folder / "c.json", *BOARD, *TAKE, *STOPS, "--json"
    )
    assert result.exit_code == 0, result.stderr
    return folder, json.loads(result.stdout)


def test_the_twin_is_calibrated(pictures: tuple[Path, dict]):
    """Pictures, numbers and words: the file belongs to the twin's camera and is near the truth."""
    folder, said = pictures
    truth = reference_geometry(0.25)
    calibration = load_calibration(folder / "c.json")
    assert said["grade"] in ("good", "usable")
    assert said["residuals"]["placements"] == PLACES
    assert said["output"] == str(folder / "c.json")
    assert {"name", "value", "grade", "advice"} <= set(said["checks"][0])
    assert calibration.camera_serial == "TWIN-0001"
    assert calibration.board == "chessboard:9x6:0.1"
    found = calibration.geometry
    assert np.linalg.norm(np.cross(found.plane_normal, truth.plane_normal)) < 5e-4
    assert np.linalg.norm(np.cross(found.axis.direction, truth.axis.direction)) < 5e-4
    assert found.plane_distance == pytest.approx(truth.plane_distance, abs=5e-4)


def test_a_place_left_unfinished_is_taken_anew_and_no_other(
    pictures: tuple[Path, dict], tmp_path: Path
):
    """After a kill the same command takes that place again; the result is the same."""
    folder, _ = pictures
    before = load_calibration(folder / "c.json")
    whole = folder / "boards" / "placement_00" / "journal.jsonl"
    untouched = whole.stat().st_mtime_ns
    broken = folder / "boards" / "placement_03" / "journal.jsonl"
    broken.write_bytes(b"".join(broken.read_bytes().splitlines(keepends=True)[:2]))
    result = invoke("calibrate", folder / "boards", "-o", tmp_path / "c.json", *TAKE, *STOPS)
    assert result.exit_code == 0, result.stderr
    said = [line for line in result.stderr.splitlines() if line.startswith("place ")]
    taken = {line[: len("place 4")] for line in said if "head at" not in line}
    assert taken == {"place 4"}
    assert whole.stat().st_mtime_ns == untouched
    assert not recorded_placements(folder / "boards")[3].remaining
    found = load_calibration(tmp_path / "c.json").geometry  # OpenCV's threads round differently
    np.testing.assert_allclose(found.plane_normal, before.geometry.plane_normal, atol=1e-8)
    assert found.axis.point == pytest.approx(before.geometry.axis.point, abs=1e-8)


def test_a_bad_calibration_says_what_to_do_and_writes_nothing(
    pictures: tuple[Path, dict], tmp_path: Path
):
    """Boards up to 4 m are no calibration for 100 m: exit code 2, words, no file."""
    folder, _ = pictures
    out = tmp_path / "c.json"
    result = invoke("calibrate", folder / "boards", "-o", out, "--max-range", 100, "--json")
    assert result.exit_code == 2
    said = json.loads(result.stdout)
    assert said["grade"] == "bad"
    assert said["output"] is None
    assert "add targets farther away" in result.stderr
    assert not out.exists()


@pytest.fixture(scope="module")
def wall(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scan of a flat wall, with the twin's exact calibration in it."""
    folder = tmp_path_factory.mktemp("wall")
    renderer = TwinRenderer(wall_scene(WALL_M), reference_geometry(0.25))
    with SimulatedAxis() as axis, TwinCamera(renderer, axis) as camera:
        axis.reference()
        info = camera.open()
        plan = ScanPlan(tuple(np.linspace(-55.0, -25.0, 13)), (500.0,), settle_s=0.0)
        take_placement(folder, 0, plan, camera, info, axis, settings={})
        twin_calibration(renderer, info).save(folder / "true.json")
    return folder


def test_a_good_calibration_passes_on_a_wall(wall: Path):
    """The exact geometry: flat, and at its distance."""
    result = invoke(
        "calibrate",
        *("--verify", wall / "placement_00", "--calibration", wall / "true.json"),
        *("--distance", WALL_M, "--json"),
    )
    assert result.exit_code == 0, result.stderr
    assert json.loads(result.stdout)["grade"] == "good", result.stderr


def test_a_wrong_toe_in_shows_on_a_wall(wall: Path, tmp_path: Path):
    """A laser plane that is off by 5 mrad is found out, in words, with exit code 2."""
    true = load_calibration(wall / "true.json")
    x, y, z = true.geometry.plane_normal
    cos, sin = np.cos(5e-3), np.sin(5e-3)
    normal = (float(cos * x - sin * z), y, float(cos * z + sin * x))
    replace(true, geometry=replace(true.geometry, plane_normal=normal)).save(tmp_path / "c.json")
    result = invoke(
        "calibrate",
        *("--verify", wall / "placement_00", "--calibration", tmp_path / "c.json"),
        *("--distance", WALL_M),
    )
    assert result.exit_code == 2
    assert "toe-in error" in result.stderr


def test_bad_input_is_refused_in_one_line(pictures: tuple[Path, dict], wall: Path, tmp_path: Path):
    """Missing parts, another camera's placement and odd numbers, each by name."""
    folder, _ = pictures
    out, boards = tmp_path / "c.json", folder / "boards"
    for arguments, says in (
        ((boards,), "-o FILE"),
        (("-o", out), "--verify DIR"),
        ((boards, "-o", tmp_path / "no" / "c.json"), "its folder does not exist"),
        ((tmp_path, "-o", out), "give --board"),
        ((tmp_path, "-o", out, *BOARD), "no pictures of a board are recorded"),
        ((boards, "-o", out, "--axis", "twin"), "both --axis and --camera"),
        ((boards, "-o", out, "--axis", "manual", "--camera", "twin"), "belong together"),
        ((boards, "-o", out, "--angles", "1,two", *TAKE), "separated by commas"),
        ((boards, "-o", out, *TAKE, "--placements", 99), "the twin knows"),
        ((boards, "-o", out, "--board", "chessboard:8x8:0.1"), "8 x 8"),
        (("--verify", wall / "placement_00"), "needs --calibration"),
    ):
        result = invoke("calibrate", *arguments)
        assert result.exit_code == 2, (arguments, result.output)
        assert says in result.stderr
        assert "Traceback" not in result.stderr
        assert not out.exists()


def test_placements_of_two_cameras_are_refused(pictures: tuple[Path, dict], tmp_path: Path):
    """A calibration belongs to one camera."""
    source = recorded_placements(pictures[0] / "boards")[0]
    for number, serial in enumerate(("A", "B")):
        recording = Recording.create(
            tmp_path / f"placement_{number:02d}",
            source.plan,
            replace(source.source, serial=serial),
            source.settings,
        )
        recording.append(source.step(0))
    result = invoke("calibrate", tmp_path, "-o", tmp_path / "c.json")
    assert result.exit_code == 2
    assert "a calibration belongs to one camera" in result.stderr
