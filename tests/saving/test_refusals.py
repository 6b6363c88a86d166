"""Names, encodings, depths and folders that cannot be written; nothing is left behind."""

from __future__ import annotations

import dataclasses
import math
import os

import numpy as np
import pytest

from depthwarp.errors import InputError
from tests.saving.maps import SUFFIXES, files_in


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
