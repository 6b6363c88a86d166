"""Writing and reading depth maps: every format, its description, and files whole or not at all."""

from __future__ import annotations

import dataclasses
import io
import json
import math
import os
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pytest

import depthwarp as dw
from depthwarp import saving
from depthwarp.encodings import decode_depth, encode_depth, get_encoding
from depthwarp.errors import FileFormatError, InputError, MissingExtraError

SUFFIXES = [".png", ".tiff", ".tif", ".npz"]


def render(**options) -> dw.DepthMap:
    """A map with all four states, through a view that is turned and shifted."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-6, 6, (3000, 3)).astype(np.float32)
    camera = dw.PinholeCamera.from_fov(
        (80, 60), (40, 30), (0.1, 0.2, 0.3), (5, 10, 70), position_frame="rotated"
    )
    filters = (dw.filters.remove_hidden(side=5), dw.filters.dilate(side=2))
    return dw.render(dw.PointCloud(points), camera, filters=filters, device="cpu", **options)


@pytest.fixture(scope="module")
def depth_map() -> dw.DepthMap:
    """A map that nobody changes."""
    result = render(min_range=0.5, max_range=8.0)
    assert set(np.unique(result.state)) == set(dw.State)
    return result


def assert_same(ours: dw.DepthMap, theirs: dw.DepthMap) -> None:
    """The same bits, camera, bounds, kind and counts."""
    np.testing.assert_array_equal(ours.depth.view(np.uint32), theirs.depth.view(np.uint32))
    for name in ("depth", "index", "state"):
        a, b = getattr(ours, name), getattr(theirs, name)
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)
    for name in ("camera", "kind", "min_range", "max_range", "stats"):
        assert getattr(ours, name) == getattr(theirs, name)


def files_in(folder: Path) -> dict[str, bytes]:
    """Every file of a folder, hidden ones too."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}


# --- formats ---


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


# --- what cannot be written ---


@pytest.mark.parametrize("name", ["depth.jpg", "depth", "depth.png.bak", ".png", "depth.json"])
def test_an_unknown_suffix_is_refused(tmp_path, depth_map, name):
    """The message names the file and lists the suffixes."""
    with pytest.raises(InputError, match=r"cannot write .*suffix must be one of .png, .tiff"):
        depth_map.save(tmp_path / name)
    assert files_in(tmp_path) == {}


@pytest.mark.parametrize("suffix", [".tiff", ".npz", ".exr"])
def test_an_encoding_for_a_format_without_one_is_refused(tmp_path, depth_map, suffix):
    """Only PNG holds integers."""
    with pytest.raises(InputError, match="encoding is for .png"):
        depth_map.save(tmp_path / f"depth{suffix}", "kitti")
    assert files_in(tmp_path) == {}


def test_an_unknown_encoding_is_refused(tmp_path, depth_map):
    """And nothing is written."""
    with pytest.raises(InputError, match="encoding must be one of"):
        depth_map.save(tmp_path / "depth.png", "inches")
    assert files_in(tmp_path) == {}


def test_a_depth_beyond_the_encoding_is_refused(tmp_path, depth_map):
    """Never wrapped to 16 bits: an error before any file."""
    deep = dataclasses.replace(depth_map, depth=depth_map.depth + np.float32(70))
    with pytest.raises(InputError, match="65.535 m, 1200 pixels are farther"):
        deep.save(tmp_path / "depth.png", "millimetres")
    unbounded = dataclasses.replace(depth_map, max_range=math.inf)
    with pytest.raises(InputError, match="finite max_range"):
        unbounded.save(tmp_path / "depth.png")
    assert files_in(tmp_path) == {}


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_folder_that_is_not_there_is_refused(tmp_path, depth_map, suffix):
    """The message names the folder; it is not made in silence."""
    with pytest.raises(InputError, match="folder .*missing does not exist"):
        depth_map.save(tmp_path / "missing" / f"depth{suffix}")
    assert files_in(tmp_path) == {}


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_path_below_a_file_is_refused(tmp_path, depth_map, suffix):
    """A file is no folder."""
    (tmp_path / "file").write_text("content")
    with pytest.raises(InputError, match="cannot write"):
        depth_map.save(tmp_path / "file" / f"depth{suffix}")
    assert files_in(tmp_path) == {"file": b"content"}


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_folder_as_target_is_refused(tmp_path, depth_map, suffix):
    """A folder is not written over."""
    (tmp_path / f"depth{suffix}").mkdir()
    with pytest.raises(InputError, match="it is a folder"):
        depth_map.save(tmp_path / f"depth{suffix}")
    assert [path.name for path in tmp_path.iterdir()] == [f"depth{suffix}"]


def test_a_folder_in_the_place_of_the_description_is_refused(tmp_path, depth_map):
    """Then the image is not written either."""
    (tmp_path / "depth.png.json").mkdir()
    with pytest.raises(InputError, match="depth.png.json: it is a folder"):
        depth_map.save(tmp_path / "depth.png")
    assert [path.name for path in tmp_path.iterdir()] == ["depth.png.json"]


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write anywhere")
def test_a_folder_without_permission_is_refused(tmp_path, depth_map):
    """The message repeats the system's reason."""
    (tmp_path / "locked").mkdir(mode=0o500)
    with pytest.raises(InputError, match="cannot write .*Permission denied"):
        depth_map.save(tmp_path / "locked" / "depth.png")


# --- a failure in the middle ---


class Broken(Exception):
    """What a writer raises here."""


@pytest.fixture(params=[Broken, KeyboardInterrupt, OSError])
def broken_writers(request, monkeypatch):
    """Every writer writes a few bytes and fails; gives what the caller meets.

    An error of the file system, such as a full disk, is met as an InputError that names the file.
    """

    def fail(file, *args, **kwargs) -> None:
        stream = file if hasattr(file, "write") else Path(file).open("wb")
        stream.write(b"half a file")
        stream.close()
        raise request.param("disk on fire")

    monkeypatch.setattr(saving, "_write_image", fail)
    monkeypatch.setattr(saving, "_write_exr", fail)
    monkeypatch.setattr(saving, "_import_openexr", lambda: None)
    monkeypatch.setattr(np, "savez", fail)
    return InputError if request.param is OSError else request.param


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".exr"])
def test_a_failure_in_the_middle_leaves_nothing(tmp_path, depth_map, broken_writers, suffix):
    """Neither the file, nor its description, nor a temporary one."""
    with pytest.raises(broken_writers):
        depth_map.save(tmp_path / f"depth{suffix}")
    assert files_in(tmp_path) == {}


@pytest.mark.parametrize("suffix", [*SUFFIXES, ".exr"])
def test_a_failure_in_the_middle_leaves_older_files(tmp_path, depth_map, broken_writers, suffix):
    """The older file and its older description stay, byte by byte."""
    (tmp_path / f"depth{suffix}").write_bytes(b"older image")
    (tmp_path / f"depth{suffix}.json").write_bytes(b"older description")
    before = files_in(tmp_path)
    with pytest.raises(broken_writers):
        depth_map.save(tmp_path / f"depth{suffix}")
    assert files_in(tmp_path) == before


def test_a_failure_of_the_description_leaves_nothing(tmp_path, depth_map, monkeypatch):
    """The image is complete by then, but does not get its name."""

    def fail(*args, **kwargs):
        raise Broken

    monkeypatch.setattr(Path, "write_text", fail)
    with pytest.raises(Broken):
        depth_map.save(tmp_path / "depth.png")
    assert files_in(tmp_path) == {}


def test_an_image_that_opencv_refuses_is_an_error(tmp_path, depth_map, monkeypatch):
    """`imencode` only returns False; that is not taken for success."""
    monkeypatch.setattr(cv2, "imencode", lambda *args: (False, None))
    with pytest.raises(InputError, match="40 x 30"):
        depth_map.save(tmp_path / "depth.png")
    assert files_in(tmp_path) == {}


# --- what cannot be read ---


def entries(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an NPZ."""
    with np.load(path) as arrays:
        return dict(arrays)


def test_a_file_that_is_not_there(tmp_path):
    """The message names it."""
    for load in (dw.DepthMap.load, saving.load_camera):
        for name in ("none.npz", "none.json"):
            with pytest.raises(FileNotFoundError, match="there is no such file"):
                load(tmp_path / name)


@pytest.mark.parametrize(
    "content",
    [b"", b"PK", b"not a zip", b"PK\x03\x04" + bytes(100), bytes(1000), b"\x80\x04N."],
    ids=["empty", "two bytes", "text", "zip header", "zeros", "pickle"],
)
def test_a_file_that_is_no_npz_is_refused(tmp_path, content):
    """FileFormatError; the message names the file."""
    path = tmp_path / "depth.npz"
    path.write_bytes(content)
    for load in (dw.DepthMap.load, saving.load_camera):
        with pytest.raises(FileFormatError, match="depth.npz is not a depth map's NPZ"):
            load(path)


def test_a_truncated_npz_is_refused(tmp_path, depth_map):
    """Cut anywhere."""
    path = tmp_path / "depth.npz"
    depth_map.save(path)
    content = path.read_bytes()
    for size in np.linspace(1, len(content) - 1, 40).astype(int):
        path.write_bytes(content[:size])
        with pytest.raises(FileFormatError, match="is not a depth map's NPZ"):
            dw.DepthMap.load(path)


def test_a_damaged_npz_is_refused_or_unharmed(tmp_path, depth_map):
    """A byte turned over: an error, or a byte that carries nothing; never another map."""
    path = tmp_path / "depth.npz"
    depth_map.save(path)
    content = path.read_bytes()
    rng = np.random.default_rng(2)
    refused = 0
    heads = [content.find(b"PK\x01\x02") + i for i in range(0, 60)]  # the list of contents
    for place in [*range(0, 140), *heads, *rng.integers(0, len(content), 150)]:
        damaged = bytearray(content)
        damaged[place] ^= 0xFF
        path.write_bytes(damaged)
        try:
            assert_same(dw.DepthMap.load(path), depth_map)
        except FileFormatError:
            refused += 1
    assert refused > 150


def test_another_npz_is_refused(tmp_path, depth_map):
    """A cloud's file, one without an entry, and one that holds other things in their place."""
    path = tmp_path / "depth.npz"
    dw.PointCloud(np.zeros((3, 3))).save(path)
    with pytest.raises(FileFormatError):
        dw.DepthMap.load(path)
    np.save(tmp_path / "array.npy", depth_map.depth)
    with pytest.raises(FileFormatError):
        dw.DepthMap.load(tmp_path / "array.npy")

    depth_map.save(path)
    good = entries(path)
    for name in good:
        np.savez(path, **{key: value for key, value in good.items() if key != name})
        with pytest.raises(FileFormatError):
            dw.DepthMap.load(path)
    about, camera = json.loads(str(good["about"])), json.loads(str(good["camera"]))
    for change in [
        {"about": np.array("{")},
        {"about": np.array("[]")},
        {"about": np.array(json.dumps(about | {"counts": {"total": 1}}))},
        {"about": np.array(json.dumps(about | {"depth_kind": "euclid"}))},
        {"about": np.array(json.dumps(about | {"max_range_m": "far"}))},
        {"camera": np.array("3")},
        {"camera": np.array(json.dumps(camera | {"K": [[1, 2], [3, 4]]}))},
        {"camera": np.array(json.dumps(camera | {"width": 0}))},
        {"camera": np.array(json.dumps(camera | {"position": None}))},
        {"camera": np.zeros(3)},
        {"depth": good["depth"][:5]},
        {"depth": good["depth"].astype(np.float64)},
        {"depth": good["depth"].ravel()},
        {"index": good["index"][:, :5]},
        {"index": good["index"].astype(np.int64)},
        {"state": good["state"].astype(np.float32)},
        {"camera": np.array(json.dumps(camera | {"width": 7}))},
    ]:
        np.savez(path, **(good | change))
        with pytest.raises(FileFormatError, match="is not a depth map's NPZ"):
            dw.DepthMap.load(path)


def test_an_npz_that_claims_a_huge_map_is_refused(tmp_path, depth_map):
    """A header of 10^12 pixels on a few bytes: an error, not an attempt to allocate them."""
    path = tmp_path / "depth.npz"
    depth_map.save(path)
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        stream, {"descr": "<f4", "fortran_order": False, "shape": (10**6, 10**6)}
    )
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    members["depth.npy"] = stream.getvalue() + bytes(100)
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    with pytest.raises(FileFormatError):
        dw.DepthMap.load(path)


@pytest.mark.parametrize(
    "text",
    ["", "{", "[]", "3", "{}", '{"camera": 3}', '{"camera": {}}', '{"camera": {"K": 5}}', "\x00"],
)
def test_a_json_that_describes_no_depth_map_is_refused(tmp_path, text):
    """The message names the file."""
    path = tmp_path / "depth.json"
    path.write_text(text)
    with pytest.raises(FileFormatError, match="depth.json does not describe a depth map"):
        saving.load_camera(path)
