"""What a batch writes: every view as `dw.render` gives it, and how to read it."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pytest

import depthwarp as dw
from depthwarp.cameras.description import camera_from_dict
from depthwarp.encodings import encode_depth, get_encoding
from tests.batch_job.conftest import LENS, TILE, cameras, write_csv
from tests.cli.conftest import invoke

pytestmark = pytest.mark.usefixtures("small_tiles")

VIEWS = 2 * TILE + 5
"""Two whole tiles, of which one plan draws both, and a rest."""


@pytest.mark.parametrize(
    ("options", "encoding", "settings"),
    [
        ((), "range16", {"filters": dw.filters.paper()}),
        (
            ("--filters", "none", "--depth", "z", "--encoding", "millimetres", "--min-range", "2"),
            "millimetres",
            {"depth": "z", "min_range": 2.0},
        ),
        (("--filters", "none", "--max-range", "3"), "range16", {"max_range": 3.0}),
    ],
)
def test_every_png_holds_the_values_of_render(room, tmp_path, options, encoding, settings):
    """All views of several tiles, bit for bit; counts and cameras stand in the journal."""
    out = tmp_path / "out"
    poses = write_csv(tmp_path / "poses.csv", VIEWS)
    result = invoke("batch", room, poses, "-o", out, *LENS, *options)
    assert result.exit_code == 0, result.output
    about = json.loads((out / "batch.json").read_text())
    lines = [json.loads(line) for line in (out / "views.jsonl").read_text().splitlines()]
    assert [line["view"] for line in lines] == list(range(VIEWS))
    names = {"batch.json", "views.jsonl", *(f"{k:06}.png" for k in range(VIEWS))}
    assert {path.name for path in out.iterdir()} == names
    cloud = dw.read(room)
    numbers = get_encoding(encoding, settings.get("max_range", 15.0))
    for camera, line in zip(cameras(VIEWS), lines, strict=True):
        expected = dw.render(cloud, camera, **settings)
        found = cv2.imread(str(out / line["file"]), cv2.IMREAD_UNCHANGED)
        assert np.array_equal(found, encode_depth(expected.depth, numbers))
        assert line["counts"] == dict(expected.stats)
        assert camera_from_dict(about["lenses"][line["lens"]] | line) == camera
    assert about["metres_per_unit"] == numbers.divisor / numbers.factor
    meaning = {"range16": f"value / 65535 * {numbers.divisor:g}", "millimetres": "value / 1000"}
    assert about["depth_m"] == meaning[encoding]
    assert about["depth_kind"] == settings.get("depth", "range")


def test_the_npz_holds_the_arrays_of_render(room, tmp_path):
    """Depth, index and state of all views, bit for bit; the folder of its parts is gone."""
    out = tmp_path / "out.npz"
    poses = write_csv(tmp_path / "poses.csv", VIEWS)
    result = invoke("batch", room, poses, "-o", out, *LENS)
    assert result.exit_code == 0, result.output
    cloud = dw.read(room)
    expected = dw.render_batch(cloud, cameras(VIEWS), filters=dw.filters.paper())
    with np.load(out) as found:
        for name in ("depth", "index", "state"):
            assert found[name].dtype == getattr(expected, name).dtype
            assert np.array_equal(found[name], getattr(expected, name))
        matrices = [camera.pose.optical_from_world for camera in cameras(VIEWS)]
        assert np.array_equal(found["optical_from_world"], matrices)
        counts = [list(depth_map.stats.values()) for depth_map in expected]
        assert np.array_equal(found["counts"], counts)
        assert list(found["count_names"]) == list(expected[0].stats)
        assert json.loads(str(found["about"]))["depth_kind"] == "range"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.npz", "poses.csv", "room.npz"]


def test_the_zarr_store_holds_the_arrays_of_render(room, tmp_path):
    """Bit for bit, a chunk a view, of views of nothing too; and how to read them."""
    zarr = pytest.importorskip("zarr")
    out = tmp_path / "out.zarr"
    poses = write_csv(tmp_path / "poses.csv", VIEWS)
    result = invoke("batch", room, poses, "-o", out, *LENS, "--min-range", "4")
    assert result.exit_code == 0, result.output
    settings = {"filters": dw.filters.paper(), "min_range": 4.0}
    expected = dw.render_batch(dw.read(room), cameras(VIEWS), **settings)
    assert not all(depth_map.stats.drawn for depth_map in expected)
    found = zarr.open_group(out, mode="r", zarr_format=3)
    for name in ("depth", "index", "state"):
        array = found[name]
        assert array.chunks == (1, *array.shape[1:]) and array.nchunks_initialized == VIEWS
        assert array.dtype == getattr(expected, name).dtype
        assert np.array_equal(array[:], getattr(expected, name))
    matrices = [camera.pose.optical_from_world for camera in cameras(VIEWS)]
    assert np.array_equal(found["optical_from_world"][:], matrices)
    counts = [list(depth_map.stats.values()) for depth_map in expected]
    assert np.array_equal(found["counts"][:], counts)
    assert found.attrs["count_names"] == list(expected[0].stats)
    assert found.attrs["names"] == [f"{k:06}" for k in range(VIEWS)]
    assert found.attrs["about"]["depth_kind"] == "range"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.zarr", "poses.csv", "room.npz"]


def test_cameras_of_a_file_bring_lenses_sizes_and_names(room, tmp_path):
    """A COLMAP model of two lenses, its images in folders: each view with its own lens."""
    wide = dw.PinholeCamera.from_fov((90, 70), (20, 10), (0.2, 0, 0), (0, 0, 40))
    fish = dw.FisheyeCamera(fx=8, fy=8, cx=7.5, cy=7.5, width=16, height=16, pose=wide.pose)
    placed = {
        "left/0001.jpg": wide,
        "right/0001.jpg": fish,
        "left/0002.jpg": wide.with_pose(cameras(9)[8].pose),
    }
    model = tmp_path / "model"
    dw.cameras.save(dw.cameras.Rig.of(placed), model, format="colmap")
    out = tmp_path / "out"
    result = invoke("batch", room, model, "-o", out, "--filters", "none")
    assert result.exit_code == 0, result.output
    lines = (out / "views.jsonl").read_text().splitlines()
    assert [json.loads(line)["view"] for line in lines] == [0, 1, 2]  # drawn lens after lens
    for name, camera in dw.cameras.load_rig(model).items():
        expected = dw.render(dw.read(room), camera).depth
        found = cv2.imread(str(out / name.replace(".jpg", ".png")), cv2.IMREAD_UNCHANGED)
        assert np.array_equal(found, encode_depth(expected, get_encoding("range16", 15.0)))
    refused = invoke("batch", room, model, "-o", tmp_path / "out.npz")
    assert refused.exit_code == 2 and "2 sizes" in refused.stderr
    assert not (tmp_path / "out.npz.part").exists()


def test_all_formats_of_poses_give_the_same_images(room, tmp_path):
    """TUM, KITTI odometry, CSV and NPZ of one walk, with a lens by options or by a file."""
    from depthwarp.cameras.trajectory import Trajectory

    views = cameras(5)
    trajectory = Trajectory(tuple(map(float, range(5))), tuple(view.pose for view in views))
    dw.cameras.save_trajectory(trajectory, tmp_path / "tum.txt", format="tum")
    dw.cameras.save_trajectory(trajectory, tmp_path / "kitti.txt", format="kitti_poses")
    write_csv(tmp_path / "poses.csv", 5)
    matrices = np.array([view.pose.optical_from_world for view in views])
    np.savez(tmp_path / "poses.npz", optical_from_world=matrices)
    dw.cameras.save(views[3], tmp_path / "lens.json", format="open3d")
    images = []
    for name in ("poses.csv", "tum.txt", "kitti.txt", "poses.npz"):
        for lens in (LENS, ("--camera", tmp_path / "lens.json")):
            out = tmp_path / f"{name}{len(images)}"
            result = invoke("batch", room, tmp_path / name, "-o", out, *lens, "--filters", "none")
            assert result.exit_code == 0, result.output
            files = sorted(out.glob("*.png"))
            assert [file.name for file in files] == [f"{k:06}.png" for k in range(5)]
            images.append([cv2.imread(str(file), cv2.IMREAD_UNCHANGED) for file in files])
    # Poses through text and quaternions are rounded, so a pixel at a border may differ.
    for other in images:
        assert np.mean(np.array(other) != np.array(images[0])) < 0.02


def test_names_of_a_csv_are_those_of_the_files(room, tmp_path):
    """A column `name`, in any place and beside columns that say something else."""
    poses = tmp_path / "poses.csv"
    poses.write_text("name;yaw;x;y;z;roll;pitch;time\nb/two.JPG;1;0;0;0;0;0;9\none;2;0;0;0;0;0;8\n")
    out = tmp_path / "out"
    assert invoke("batch", room, poses, "-o", out, *LENS).exit_code == 0
    assert {str(path.relative_to(out)) for path in out.rglob("*.png")} == {"b/two.png", "one.png"}


def test_json_says_what_was_done(room, tmp_path):
    """Numbers of views, the rate and the times, as one object on stdout."""
    poses = write_csv(tmp_path / "poses.csv", 3)
    result = invoke("batch", room, poses, "-o", tmp_path / "out", *LENS, "--json")
    answer = json.loads(result.stdout)
    assert (answer["views"], answer["drawn"], answer["empty"]) == (3, 3, 0)
    assert set(answer["seconds"]) == {"read", "prepare", "draw", "finish"}
    assert answer["views_per_second"] > 0
