"""What each format holds, and the description beside an image."""

from __future__ import annotations

import json
import math

import cv2
import numpy as np
import pytest

import depthwarp as dw
from depthwarp import saving
from depthwarp.encodings import decode_depth, encode_depth, get_encoding
from depthwarp.errors import MissingExtraError
from tests.saving.maps import SUFFIXES, assert_same, files_in, render


@pytest.mark.parametrize("encoding", [None, "range16", "millimetres", "kitti"])
def test_png_holds_the_integers(tmp_path, depth_map, encoding):
    """Any reader of 16-bit PNG gets the encoded integers; decoded they are the depth."""
    path = tmp_path / "depth.png"
    depth_map.save(path) if encoding is None else depth_map.save(path, encoding)
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    meaning = get_encoding(encoding or "range16", 8.0)
    assert image.dtype == np.uint16
    np.testing.assert_array_equal(image, encode_depth(depth_map.depth, meaning))
    about = json.loads((tmp_path / "depth.png.json").read_text())
    assert about["encoding"] == (encoding or "range16") and about["dtype"] == "uint16"
    # Decoded by what the description says, without this package:
    decoded = eval(about["depth_m"], {"value": image.astype(np.float64)})
    np.testing.assert_allclose(decoded, image * about["metres_per_unit"], rtol=1e-12)
    np.testing.assert_allclose(decoded, depth_map.depth, atol=about["metres_per_unit"] * 0.51)
    np.testing.assert_array_equal(decode_depth(image, meaning), decoded.astype(np.float32))


@pytest.mark.parametrize("suffix", [".tiff", ".tif", ".TIFF"])
def test_tiff_holds_float32_metres(tmp_path, depth_map, suffix):
    """The very bits of the depth, and a description that says metres."""
    path = tmp_path / f"depth{suffix}"
    depth_map.save(path)
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert image.dtype == np.float32
    np.testing.assert_array_equal(image.view(np.uint32), depth_map.depth.view(np.uint32))
    about = json.loads((tmp_path / f"depth{suffix}.json").read_text())
    assert (about["encoding"], about["dtype"], about["metres_per_unit"]) == ("metres", "float32", 1)


@pytest.mark.parametrize("suffix", [".png", ".tiff"])
def test_the_description_beside_an_image(tmp_path, depth_map, suffix):
    """NAME.json says what a reader has to know: kind, bounds, camera, counts, states."""
    depth_map.save(tmp_path / f"view.1{suffix}")
    assert set(files_in(tmp_path)) == {f"view.1{suffix}", f"view.1{suffix}.json"}
    about = json.loads((tmp_path / f"view.1{suffix}.json").read_text())
    assert about["format"] == "depthwarp depth map"
    assert about["version"] == dw.__version__
    assert (about["width"], about["height"], about["empty_value"]) == (40, 30, 0)
    assert (about["depth_kind"], about["min_range_m"], about["max_range_m"]) == ("range", 0.5, 8.0)
    assert about["counts"] == dict(depth_map.stats)
    assert about["pixels"] == {
        state.name.lower(): int((depth_map.state == state).sum()) for state in dw.State
    }
    camera = about["camera"]
    assert (camera["model"], camera["width"], camera["height"]) == ("pinhole", 40, 30)
    assert camera["K"] == depth_map.camera.K.tolist()
    # K and optical_from_world alone make the camera, for any program that uses OpenCV's axes.
    again = dw.PinholeCamera.from_matrix(
        camera["K"], (40, 30), optical_from_world=camera["optical_from_world"]
    )
    points = np.random.default_rng(1).uniform(-6, 6, (100, 3))
    np.testing.assert_allclose(
        again.project(points)[:3], depth_map.camera.project(points)[:3], rtol=1e-9, atol=1e-9
    )
    assert saving.load_camera(tmp_path / f"view.1{suffix}.json") == depth_map.camera


@pytest.mark.parametrize(
    "options", [{"min_range": 0.5, "max_range": 8.0}, {"depth": "z", "max_range": math.inf}]
)
def test_npz_comes_back_as_it_was(tmp_path, options):
    """Depth, index, state, camera, kind, bounds and counts: one file, the same bits."""
    depth_map = render(**options)
    path = tmp_path / "depth.npz"
    depth_map.save(path)
    assert set(files_in(tmp_path)) == {"depth.npz"}
    assert_same(dw.DepthMap.load(path), depth_map)
    assert_same(dw.DepthMap.load(str(path)), depth_map)
    assert saving.load_camera(path) == depth_map.camera


def test_npz_is_read_by_numpy_alone(tmp_path, depth_map):
    """`depth`, `index` and `state` are plain arrays; the camera and the rest are JSON."""
    depth_map.save(tmp_path / "depth.npz")
    with np.load(tmp_path / "depth.npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["depth"], depth_map.depth)
        np.testing.assert_array_equal(arrays["index"], depth_map.index)
        np.testing.assert_array_equal(arrays["state"], depth_map.state)
        assert json.loads(str(arrays["camera"]))["K"] == depth_map.camera.K.tolist()
        assert json.loads(str(arrays["about"]))["depth_kind"] == "range"


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_map_of_one_pixel(tmp_path, suffix):
    """The smallest map goes through every format."""
    camera = dw.PinholeCamera.from_fov((60, 45), (1, 1))
    depth_map = dw.render(dw.PointCloud(np.float32([[3, 0, 0]])), camera, device="cpu")
    path = tmp_path / f"one{suffix}"
    depth_map.save(path)
    if suffix == ".npz":
        assert_same(dw.DepthMap.load(path), depth_map)
    else:
        value = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
        assert value.shape == (1, 1) and value[0, 0] == (13107 if suffix == ".png" else 3)


def test_descriptions_are_strict_json(tmp_path):
    """A map without a bound has no number for it: null, as JSON has no infinity."""
    depth_map = render(max_range=math.inf)
    depth_map.save(tmp_path / "depth.tiff")
    depth_map.save(tmp_path / "other.png", "millimetres")

    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    for name in ("depth.tiff.json", "other.png.json"):
        about = json.loads((tmp_path / name).read_text(), parse_constant=refuse)
        assert about["max_range_m"] is None


def test_an_exr_without_its_package_says_what_to_install(tmp_path, depth_map, monkeypatch):
    """The message holds the pip command; nothing is left behind."""
    monkeypatch.setitem(__import__("sys").modules, "OpenEXR", None)  # as if it were not there
    with pytest.raises(MissingExtraError, match=r'pip install "depthwarp\[exr\]"'):
        depth_map.save(tmp_path / "depth.exr")
    assert files_in(tmp_path) == {}


def test_exr_holds_float32_metres(tmp_path, depth_map):
    """One channel Z, the very bits of the depth."""
    OpenEXR = pytest.importorskip("OpenEXR", reason="needs the package OpenEXR (extra exr)")
    depth_map.save(tmp_path / "depth.exr")
    with OpenEXR.File(str(tmp_path / "depth.exr")) as image:
        pixels = image.channels()["Z"].pixels
    np.testing.assert_array_equal(pixels, depth_map.depth)
    assert json.loads((tmp_path / "depth.exr.json").read_text())["encoding"] == "metres"


def test_a_map_is_written_over(tmp_path, depth_map):
    """Saving to a name that is taken replaces the file."""
    for suffix in SUFFIXES:
        path = tmp_path / f"depth{suffix}"
        path.write_text("old")
        depth_map.save(path)
        assert path.read_bytes() != b"old"
