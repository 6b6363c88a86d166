"""A failure in the middle of writing leaves no half a file, and older files as they were."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from depthwarp import saving
from depthwarp.errors import InputError
from tests.saving.maps import SUFFIXES, files_in


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
