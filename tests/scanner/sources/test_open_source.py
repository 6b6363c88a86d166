"""`open_source` makes the source that a text names."""

from __future__ import annotations

from pathlib import Path

import cv2
import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.frames import PixelFormat
from depthwarp.scanner.sources import (
    BaslerSource,
    FolderSource,
    OpenCvSource,
    VideoSource,
    open_source,
)
from tests.scanner.sources.pictures import colourful


@pytest.mark.parametrize(
    ("spec", "kind"),
    [
        ("basler", BaslerSource),
        ("basler:40012345", BaslerSource),
        ("opencv:0", OpenCvSource),
        ("opencv:turn.avi", VideoSource),
        ("opencv:f_%04d.png", VideoSource),
        ("folder:frames", FolderSource),
    ],
)
def test_each_kind_has_its_source(spec: str, kind: type) -> None:
    """Nothing is opened yet, so none of them need be there."""
    source = open_source(spec, rotation=270)
    assert type(source) is kind
    source.close()


def test_arguments_reach_the_source(tmp_path: Path) -> None:
    """A path with a colon, rotation, format and bits; `with` takes the device."""
    folder = tmp_path / "turn:1"
    folder.mkdir()
    cv2.imwrite(str(folder / "f.png"), colourful(8, 7)[:, :, 0])
    spec = f"folder:{folder}"
    with open_source(spec, rotation=90, pixel_format=PixelFormat.BAYER_RGGB, bits=7) as source:
        assert source.open().size == (7, 8)
        assert source.open().pixel_format is PixelFormat.BAYER_RGGB  # of odd height: R comes up


@pytest.mark.parametrize(
    "spec", ["", "webcam", "opencv", "opencv:", "folder", "folder:", "twin:x", "Basler"]
)
def test_other_texts_are_refused(spec: str) -> None:
    """The message lists the forms."""
    with pytest.raises(InputError, match=r"must be basler, basler:SERIAL, .* got"):
        open_source(spec)


def test_arguments_that_a_kind_does_not_take_are_refused() -> None:
    """Nothing is ignored in silence."""
    with pytest.raises(InputError, match="takes no pixel_format or bits"):
        open_source("opencv:0", pixel_format=PixelFormat.BGR)
    with pytest.raises(InputError, match="takes no pixel_format or bits"):
        open_source("opencv:turn.avi", bits=8)
    for spec in ("basler", "opencv:0", "opencv:turn.avi", "folder:frames"):
        with pytest.raises(InputError, match="rotation must be"):
            open_source(spec, rotation=45)
