"""A folder of images is a frame source: order, depth, meaning, and every kind of bad file."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from depthwarp.errors import FileFormatError, InputError
from depthwarp.scanner.frames import DeviceLostError, IncompleteFrameError, PixelFormat
from depthwarp.scanner.sources import FolderSource
from tests.scanner.sources.pictures import colourful, mosaic, upright


def _fill(folder: Path, count: int = 3, suffix: str = ".png") -> list[npt.NDArray[np.uint8]]:
    images = [colourful(8, 6, seed) for seed in range(count)]
    for index, image in enumerate(images):
        cv2.imwrite(str(folder / f"f{index:03d}{suffix}"), image)
    return images


@pytest.mark.parametrize("suffix", [".png", ".tiff", ".bmp"])
def test_images_come_bit_for_bit_in_order_of_names(tmp_path: Path, suffix: str) -> None:
    """One file a trigger, its numbers untouched; what no file tells is NaN or None."""
    images = _fill(tmp_path, suffix=suffix)
    (tmp_path / "notes.txt").write_text("not an image")
    before = time.time_ns()
    with FolderSource(tmp_path) as source:
        info = source.open()
        frames = [source.grab(1.0) for _ in images]
    assert info.size == (8, 6)
    assert info.pixel_format is PixelFormat.BGR
    assert info.is_emulated
    for index, (frame, image) in enumerate(zip(frames, images, strict=True)):
        np.testing.assert_array_equal(frame.pixels, image)
        assert (frame.sequence, frame.bits, frame.camera_time_ns) == (index, 8, None)
        assert math.isnan(frame.exposure_us) and math.isnan(frame.gain_db)
        assert before <= frame.host_time_ns <= time.time_ns()


def test_the_end_of_the_folder_is_the_loss_of_the_device(tmp_path: Path) -> None:
    """After the last image every grab says so; opening again starts from the first."""
    images = _fill(tmp_path, 1)
    source = FolderSource(tmp_path)
    with source:
        source.grab(1.0)
        for _ in range(2):
            with pytest.raises(DeviceLostError, match=r"no more frames: .* after 1 images"):
                source.grab(1.0)
    with source:
        frame = source.grab(1.0)
    np.testing.assert_array_equal(frame.pixels, images[0])
    assert frame.sequence == 0


@pytest.mark.parametrize("suffix", [".png", ".tif"])
def test_deep_images_keep_all_their_bits(tmp_path: Path, suffix: str) -> None:
    """16-bit files come as uint16, with the bits that the argument says."""
    image = np.random.default_rng(0).integers(0, 4096, (6, 8), dtype=np.uint16)
    cv2.imwrite(str(tmp_path / f"f{suffix}"), image)
    for bits, expected in ((None, 16), (12, 12)):
        with FolderSource(tmp_path, bits=bits) as source:
            frame = source.grab(1.0)
        np.testing.assert_array_equal(frame.pixels, image)
        assert (frame.bits, frame.pixel_format) == (expected, PixelFormat.MONO)


def test_a_sidecar_says_what_the_numbers_are(tmp_path: Path) -> None:
    """Pattern and bits by `frames.json`, renamed with the turn; an argument goes before it."""
    bgr = colourful(8, 7)
    deep = mosaic(bgr, PixelFormat.BAYER_GRBG).astype(np.uint16) * 16
    cv2.imwrite(str(tmp_path / "f.png"), deep)
    sidecar = {"pixel_format": "bayer_grbg", "bits": 12}
    (tmp_path / "frames.json").write_text(json.dumps(sidecar))
    with FolderSource(tmp_path, rotation=90) as source:
        info, frame = source.open(), source.grab(1.0)
    assert info.size == (7, 8)
    assert info.pixel_format is frame.pixel_format
    assert frame.bits == 12
    expected = mosaic(upright(bgr, 90), frame.pixel_format).astype(np.uint16) * 16
    np.testing.assert_array_equal(frame.pixels, expected)
    with FolderSource(tmp_path, pixel_format=PixelFormat.BAYER_BGGR, bits=14) as source:
        frame = source.grab(1.0)
    assert (frame.pixel_format, frame.bits) == (PixelFormat.BAYER_BGGR, 14)


@pytest.mark.parametrize("kept", [0, 20, 200])
def test_a_damaged_file_is_named_and_passed_by(tmp_path: Path, kept: int) -> None:
    """A cut file raises `IncompleteFrameError`; the grab after it gives the next image."""
    images = _fill(tmp_path)
    damaged = tmp_path / "f001.png"
    damaged.write_bytes(damaged.read_bytes()[:kept])
    with FolderSource(tmp_path) as source:
        source.grab(1.0)
        with pytest.raises(IncompleteFrameError, match=r"f001\.png is damaged or cut short"):
            source.grab(1.0)
        np.testing.assert_array_equal(source.grab(1.0).pixels, images[2])


def test_an_image_of_another_size_or_kind_is_refused(tmp_path: Path) -> None:
    """Both sizes and kinds are in the message."""
    _fill(tmp_path)
    cv2.imwrite(str(tmp_path / "f001.png"), colourful(5, 6))
    cv2.imwrite(str(tmp_path / "f002.png"), colourful(8, 6)[:, :, 0])
    with FolderSource(tmp_path) as source:
        source.grab(1.0)
        with pytest.raises(IncompleteFrameError, match=r"f001.* 5 x 6 .* 8 x 6 3-channel"):
            source.grab(1.0)
        with pytest.raises(IncompleteFrameError, match=r"f002.* 8 x 6 grey .* 3-channel"):
            source.grab(1.0)


def test_a_vanished_file_is_named(tmp_path: Path) -> None:
    """A file that was listed but cannot be read is an incomplete frame, not a crash."""
    _fill(tmp_path)
    with FolderSource(tmp_path) as source:
        source.grab(1.0)
        (tmp_path / "f001.png").unlink()
        with pytest.raises(IncompleteFrameError, match=r"cannot read .*f001\.png"):
            source.grab(1.0)


def test_numbers_beyond_the_stated_bits_are_refused(tmp_path: Path) -> None:
    """A frame whose full scale would be wrong does not pass for a good one."""
    cv2.imwrite(str(tmp_path / "f.png"), np.full((4, 4), 4096, np.uint16))
    with (
        FolderSource(tmp_path, bits=12) as source,
        pytest.raises(IncompleteFrameError, match="4096, more than 12 bits"),
    ):
        source.grab(1.0)


def test_names_out_of_numeric_order_are_refused(tmp_path: Path) -> None:
    """`f10` before `f2` would give the turn in the wrong order."""
    for name in ("f1", "f2", "f10"):
        cv2.imwrite(str(tmp_path / f"{name}.png"), colourful(4, 4))
    with pytest.raises(InputError, match=r"'f10\.png' comes before 'f2\.png'.*leading zeros"):
        FolderSource(tmp_path).open()


def test_a_folder_that_is_no_source_is_refused(tmp_path: Path) -> None:
    """Missing, empty, and filled with files that only look like images."""
    with pytest.raises(InputError, match="there is no folder"):
        FolderSource(tmp_path / "none").open()
    with pytest.raises(InputError, match=r"holds no images.*\*\.png"):
        FolderSource(tmp_path).open()
    (tmp_path / "f.png").write_text("hello")
    with pytest.raises(FileFormatError, match="damaged"):
        FolderSource(tmp_path).open()
    cv2.imwrite(str(tmp_path / "f.png"), np.zeros((4, 4, 4), np.uint8))
    with pytest.raises(FileFormatError, match="4-channel"):
        FolderSource(tmp_path).open()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "cannot read"),
        ("[1]", "must hold an object"),
        ('{"format": "mono"}', "must hold an object"),
        ('{"pixel_format": "rggb"}', "bayer_rggb"),
        ('{"pixel_format": 3}', "bayer_rggb"),
        ('{"bits": true}', "whole number from 1 to 16"),
        ('{"bits": 17}', "whole number from 1 to 16"),
        ('{"bits": 12}', "12 bits cannot be"),
        ('{"pixel_format": "bgr"}', "cannot be bgr"),
    ],
)
def test_a_wrong_sidecar_is_refused(tmp_path: Path, text: str, message: str) -> None:
    """Whatever is wrong in it, the message names the file and what is expected."""
    cv2.imwrite(str(tmp_path / "f.png"), colourful(4, 4)[:, :, 0])
    (tmp_path / "frames.json").write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        FolderSource(tmp_path).open()
    assert "frames.json" in str(caught.value)


def test_colour_files_cannot_be_a_mosaic(tmp_path: Path) -> None:
    """A Bayer pattern asked for, three channels found."""
    _fill(tmp_path)
    with pytest.raises(InputError, match=r"3-channel .* cannot be bayer_rggb"):
        FolderSource(tmp_path, pixel_format=PixelFormat.BAYER_RGGB).open()


def test_a_closed_source_says_so(tmp_path: Path) -> None:
    """Closing twice is harmless; grabbing or configuring after it is not silent."""
    _fill(tmp_path)
    source = FolderSource(tmp_path)
    source.close()
    source.open()
    source.configure(1000.0, 0.0)
    source.close()
    source.close()
    with pytest.raises(DeviceLostError, match=r"is not open: call open\(\)"):
        source.grab(1.0)
    with pytest.raises(DeviceLostError, match="is not open"):
        source.configure(1000.0, 0.0)
