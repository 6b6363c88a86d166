"""Reading a map back: files that are missing, damaged, or of something else."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest

import depthwarp as dw
from depthwarp import saving
from depthwarp.errors import FileFormatError
from tests.saving.maps import assert_same


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
        {"camera": np.array(json.dumps(camera | {"fx": [[1, 2], [3, 4]]}))},
        {"camera": np.array(json.dumps(camera | {"model": "pancake"}))},
        {"camera": np.array(json.dumps(camera | {"distortion": [1, 2]}))},
        {"camera": np.array(json.dumps(camera | {"width": 0}))},
        {"camera": np.array(json.dumps(camera | {"pose": {"position": None}}))},
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
