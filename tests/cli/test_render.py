"""`depthwarp render`, from a file to a file."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

import depthwarp as dw
from depthwarp.errors import InputError
from tests.cli.conftest import VIEW


def test_it_writes_a_16_bit_image_and_says_how_to_read_it(run, wall, tmp_path):
    """The PNG decodes, by the words of its sidecar, to the depth of the wall."""
    output = tmp_path / "depth.png"
    result = run("render", wall, "-o", output, *VIEW, "--filters", "none", "--depth", "z")
    assert result.exit_code == 0, result.stderr
    values = cv2.imread(str(output), cv2.IMREAD_UNCHANGED)
    about = json.loads((tmp_path / "depth.png.json").read_text())
    assert values.dtype == np.uint16 and values.shape == (48, 64)
    depth = values * about["metres_per_unit"]
    assert about["depth_kind"] == "z"
    assert np.abs(depth[values > 0] - 4.0).max() < 15 / 65535
    assert (values > 0).sum() == about["counts"]["drawn"] == about["pixels"]["measured"]


def test_json_is_one_object_on_stdout_and_the_rest_goes_to_stderr(run, wall, tmp_path):
    """A program can read the counts; people's text does not get in its way."""
    result = run("render", wall, "-o", tmp_path / "depth.npz", *VIEW, "--json")
    answer = json.loads(result.stdout)
    assert answer["counts"]["total"] == 6400
    assert sum(answer["pixels"].values()) == 64 * 48
    assert set(answer["seconds"]) == {"read", "render", "save"}
    assert "reading" in result.stderr and "reading" not in result.stdout


def test_text_goes_to_stderr_without_json_too(run, wall, tmp_path):
    """Without --json stdout stays empty and the counts are said on stderr."""
    result = run("render", wall, "-o", tmp_path / "depth.npz", *VIEW)
    assert result.stdout == ""
    assert "64 x 48 px" in result.stderr and "6,400" in result.stderr


def test_the_command_equals_the_library(run, wall, wall_points, tmp_path):
    """Same flags, same bits: the default of the command is the paper's chain."""
    output = tmp_path / "depth.npz"
    assert run("render", wall, "-o", output, *VIEW).exit_code == 0
    camera = dw.PinholeCamera.from_fov(fov=(60, 60), size=(64, 48))
    expected = dw.render(dw.PointCloud(wall_points), camera, filters=dw.filters.paper())
    found = dw.DepthMap.load(output)
    for name in ("depth", "index", "state"):
        assert np.array_equal(getattr(found, name), getattr(expected, name))
    assert found.camera == camera


def test_q_depth_map_renders_the_papers_range_view(run, wall, wall_points, tmp_path):
    """--q-depth-map selects by (8)(9) and projects on the depth plane, in both position frames."""
    output = tmp_path / "depth.npz"
    arguments = [
        "--position",
        "-1",
        "0.5",
        "0",
        "--orientation",
        "0",
        "0",
        "20",
        "--fov",
        "50",
        "40",
    ]
    for frame in ("world", "rotated"):
        result = run(
            *["render", wall, "-o", output, *arguments, "--q-depth-map", "0.05"],
            *["--q-line", "0.02", "--position-frame", frame],
        )
        assert result.exit_code == 0, result.stderr
        view = dw.RangeView((-1, 0.5, 0), (0, 0, 20), (50, 40), 0.02, 0.05, frame)
        expected = dw.render(dw.PointCloud(wall_points), view, filters=dw.filters.paper())
        assert np.array_equal(dw.DepthMap.load(output).index, expected.index)


@pytest.mark.parametrize("name", ["first.npz", "first.png"])
def test_a_camera_can_be_taken_from_an_earlier_map(run, wall, tmp_path, name):
    """--camera with a depth map's file renders the same image again."""
    first, second = tmp_path / name, tmp_path / "second.npz"
    view = [
        "--position",
        "0.1",
        "-0.2",
        "0.3",
        "--orientation",
        "3",
        "5",
        "-7",
        "--fov",
        "70",
        "50",
    ]
    assert run("render", wall, "-o", first, *view, "--size", 40, 30).exit_code == 0
    camera = Path(f"{first}.json") if name.endswith("png") else first
    assert run("render", wall, "-o", second, "--camera", camera).exit_code == 0
    third = tmp_path / "third.npz"
    assert run("render", wall, "-o", third, *view, "--size", 40, 30).exit_code == 0
    assert np.array_equal(dw.DepthMap.load(second).depth, dw.DepthMap.load(third).depth)


def test_an_empty_image_is_explained(run, wall, tmp_path):
    """Looking away from the wall succeeds, warns, and says that all points are behind."""
    view = ["--position", "0", "0", "0", "--orientation", "0", "0", "180", "--fov", "60", "60"]
    result = run("render", wall, "-o", tmp_path / "depth.png", *view, "--size", 64, 48)
    assert result.exit_code == 0
    assert "empty" in result.stderr and "6,400 behind" in result.stderr


@pytest.mark.parametrize("encoding", ["millimetres", "kitti"])
def test_other_16_bit_encodings(run, wall, tmp_path, encoding):
    """Millimetres and metres times 256 hold the wall's 4 m."""
    arguments = [*VIEW, "--filters", "none", "--depth", "z", "--encoding", encoding]
    assert run("render", wall, "-o", tmp_path / "d.png", *arguments).exit_code == 0
    values = cv2.imread(str(tmp_path / "d.png"), cv2.IMREAD_UNCHANGED)
    assert set(np.unique(values)) == {0, 4 * {"millimetres": 1000, "kitti": 256}[encoding]}


def test_no_flag_changes_the_result_under_python_O(run_program, wall, tmp_path):
    """`python -O` gives the same file and the same refusal."""
    for number, flags in enumerate([(), ("-O",)]):
        output = tmp_path / f"depth{number}.npz"
        done = run_program("render", wall, "-o", output, *VIEW, "--json", python=flags)
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout)["counts"]["total"] == 6400
        bad = run_program("render", "nothing.ply", "-o", output, *VIEW, python=flags)
        assert bad.returncode == 2 and "nothing.ply" in bad.stderr
    first, second = (dw.DepthMap.load(tmp_path / f"depth{number}.npz") for number in range(2))
    assert np.array_equal(first.depth, second.depth) and np.array_equal(first.index, second.index)


def test_the_program_says_nothing_of_warp(run_program, wall, tmp_path):
    """Warp's greeting, its compile messages and its driver warning stay out of the output."""
    done = run_program("render", wall, "-o", tmp_path / "depth.png", *VIEW)
    assert done.returncode == 0
    assert "arp" not in done.stderr.replace("depthwarp", "")


def _read_offset(path: Path) -> np.ndarray:
    return dw.read(path, offset=(500_000.0, 4_000_000.0, 0.0)).points_world


def test_map_coordinates_need_an_offset(run, wall_points, tmp_path):
    """UTM coordinates are refused with the remedy; with --offset they render as the local ones."""
    path = tmp_path / "utm.xyz"
    shifted = wall_points.astype(np.float64) + (500_000.0, 4_000_000.0, 0.0)
    path.write_text("".join(f"{x:.6f} {y:.6f} {z:.6f}\n" for x, y, z in shifted))
    refused = run("render", path, "-o", tmp_path / "depth.npz", *VIEW)
    assert refused.exit_code == 2 and "--offset" in refused.stderr
    offset = ["--offset", "500000", "4000000", "0"]
    done = run("render", path, "-o", tmp_path / "depth.npz", *VIEW, *offset, "--json")
    assert done.exit_code == 0, done.stderr
    assert json.loads(done.stdout)["counts"]["drawn"] > 1000
    assert np.abs(_read_offset(path) - wall_points).max() < 1e-5


def test_the_library_writes_nothing_on_stdout(wall):
    """A script's own output is not mixed with Warp's greeting."""
    script = (
        "import depthwarp as dw, sys; cloud = dw.read(sys.argv[1]);"
        "camera = dw.PinholeCamera.from_fov((60, 60), (8, 8));"
        "print(dw.render(cloud, camera, device='cpu').stats.total)"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, str(wall)], capture_output=True, text=True, check=True
    )
    assert done.stdout == "6400\n"


def test_the_description_names_the_filters(run, wall, tmp_path):
    """Who reads the file can see what was done to the map."""
    run("render", wall, "-o", tmp_path / "d.npz", *VIEW)
    filters = dw.DepthMap.load(tmp_path / "d.npz").filters
    assert [text.partition("(")[0] for text in filters] == ["PaperErase", "Dilation"]
    raw = dw.render(dw.read(wall), dw.DepthMap.load(tmp_path / "d.npz").camera)
    assert raw.filters == ()
    assert dw.filters.apply(raw, dw.filters.paper()).filters == filters


@pytest.mark.parametrize("filters", ["paper", dw.filters.dilate(), [1]])
def test_filters_must_be_a_list_of_filters(wall, filters):
    """A name, a single filter or numbers are refused with an example."""
    camera = dw.PinholeCamera.from_fov((60, 60), (8, 8))
    with pytest.raises(InputError, match="dw.filters.paper"):
        dw.render(dw.read(wall), camera, filters=filters)
