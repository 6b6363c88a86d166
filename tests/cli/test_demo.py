"""`depthwarp demo`, as a newcomer runs it."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

import depthwarp as dw
from depthwarp.cli import demo_scan
from depthwarp.cli.demo_scores import MapScore, room_depth, score_map
from tests.cli.conftest import invoke

FIGURES = (
    *("fig01_scanner", "fig02_frame"),
    *("fig03_point_cloud", "fig04_rotated_cloud", "fig05_range_view_angles", "fig06_range_view"),
    *("fig08_segmented_points", "fig11_depth_map", "fig12_surf", "fig13_depth_map_2"),
    *("fig11_depth_map_best", "fig13_depth_map_2_best"),
    *("fig11_paper_and_best", "fig13_paper_and_best_2"),
    *("fig14_segmented_points_2", "fig15_surf_2"),
)


@pytest.fixture(scope="module", autouse=True)
def short_turn() -> Iterator[None]:
    """A turn of fewer stops: the whole chain at a tenth of its time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demo_scan, "STOPS", 60)
        yield


@pytest.fixture(scope="module")
def demo(tmp_path_factory) -> tuple[Path, dict]:
    """The folder that one run of the demo wrote, and its JSON answer."""
    folder = tmp_path_factory.mktemp("demo") / "new" / "folder"
    result = invoke("demo", "--out", folder, "--json")
    assert result.exit_code == 0, result.stderr
    return folder, json.loads(result.stdout)


def test_it_writes_every_file_and_names_it(demo):
    """Cloud, depth map, a picture for each of the paper's figures and the twins, nothing else."""
    folder, answer = demo
    expected = {"cloud.ply", "depth.png", "depth.png.json", "depth.npz"}
    expected |= {f"{name}.png" for name in FIGURES}
    assert {file.name for file in folder.iterdir()} == expected
    assert {Path(file).name for file in answer["files"]} == expected


def test_the_map_has_the_papers_size_and_comes_from_the_cloud(demo):
    """724 x 662 px; a pixel holds the range of its point; the PNG is the same map."""
    folder, _ = demo
    depth_map, cloud = dw.DepthMap.load(folder / "depth.npz"), dw.read(folder / "cloud.ply")
    assert depth_map.depth.shape == (662, 724)
    drawn = depth_map.index >= 0
    points = cloud.points_world[depth_map.index[drawn]].astype(np.float64)
    distance = np.linalg.norm(points - (1.79, 3.3, 1.2), axis=1)
    assert np.abs(depth_map.depth[drawn] - distance).max() < 1e-5
    assert np.array_equal(drawn, depth_map.depth > 0) and drawn.mean() > 0.2
    assert np.array_equal(drawn, np.isin(depth_map.state, (dw.State.MEASURED, dw.State.FILLED)))
    values = cv2.imread(str(folder / "depth.png"), cv2.IMREAD_UNCHANGED)
    assert np.abs(values / 65535 * 15 - depth_map.depth).max() <= 15 / 65535 / 2 + 1e-6


def test_the_figures_are_pictures(demo):
    """Every figure opens, is large enough to look at, and is not of one colour."""
    folder, _ = demo
    for name in FIGURES:
        picture = cv2.imread(str(folder / f"{name}.png"))
        assert min(picture.shape[:2]) >= 600, name
        assert len(np.unique(picture @ np.array([1, 256, 65536]))) > 50, name


def test_the_best_filters_leave_fewer_wrong_depths(demo):
    """Of those there are, in both views; the shares named "paper" are those of the saved map.

    They cover more only where a scan is not as sparse as this one.
    """
    folder, answer = demo
    assert list(answer["filters"]) == ["fig11", "fig13"]
    for figure, scores in answer["filters"].items():
        paper, best = scores["paper"], scores["best"]
        wrong = {name: score["wrong"] / score["covered"] for name, score in scores.items()}
        assert wrong["best"] < 0.9 * wrong["paper"], figure
        assert best["measured"] > paper["measured"], figure
        for score in scores.values():
            assert score["measured"] + score["filled"] == pytest.approx(score["covered"])
            assert score["right"] + score["wrong"] == pytest.approx(score["covered"])
    saved = dw.DepthMap.load(folder / "depth.npz")
    paper = answer["filters"]["fig11"]["paper"]
    assert paper["covered"] == (saved.depth > 0).mean()
    assert paper["measured"] == (saved.state == dw.State.MEASURED).mean()


def test_the_exact_depth_is_the_rooms():
    """Unprojected it lies on the floor, z = 0, and on nothing below; steps of 5 cm decide."""
    camera = dw.PinholeCamera.from_fov((60.0, 50.0), (40, 30), (1.79, 3.3, 1.2), (0, 20, 50))
    exact = room_depth(camera)
    points = camera.unproject(exact).reshape(-1, 3)
    height = points[:, 2]
    assert height.min() > -1e-9 and (np.abs(height) < 1e-9).mean() > 0.3
    cloud = dw.PointCloud(points.astype(np.float32))
    depth_map = dw.render(cloud, camera, depth="range")
    assert score_map(depth_map, exact) == MapScore(1.0, 1.0, 0.0, 1.0, 0.0)
    assert score_map(depth_map, exact + 0.04).right == 1.0
    assert score_map(depth_map, exact - 0.06).wrong == 1.0


def test_two_runs_give_the_same_cloud_and_map(demo, tmp_path):
    """The scan is seeded: a second run repeats the first."""
    folder, _ = demo
    assert invoke("demo", "--out", tmp_path).exit_code == 0
    for name in ("cloud.ply", "depth.png"):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()


def test_without_matplotlib_it_says_what_to_install(tmp_path, monkeypatch):
    """The extra is asked for before any work is done."""
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    result = invoke("demo", "--out", tmp_path / "out")
    assert result.exit_code == 2 and 'pip install "depthwarp[viz]"' in result.stderr
    assert not (tmp_path / "out").exists()


def test_a_folder_that_cannot_be_made(tmp_path):
    """A file in the way is named."""
    (tmp_path / "file").write_text("")
    result = invoke("demo", "--out", tmp_path / "file" / "demo")
    assert result.exit_code == 2 and "file" in result.stderr
