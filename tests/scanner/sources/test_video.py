"""Videos and numbered images are frame sources."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from depthwarp.errors import FileFormatError, InputError
from depthwarp.scanner.frames import DeviceLostError, IncompleteFrameError, PixelFormat
from depthwarp.scanner.sources import VideoSource
from tests.scanner.sources.pictures import colourful, upright


@pytest.fixture
def pictures() -> list[npt.NDArray[np.uint8]]:
    """Four small pictures."""
    return [colourful(64, 48, seed) for seed in range(4)]


@pytest.fixture
def video(tmp_path: Path, pictures: list[npt.NDArray[np.uint8]]) -> Path:
    """The pictures as a lossless video of 10 frames a second."""
    path = tmp_path / "turn.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 10, (64, 48))
    for picture in pictures:
        writer.write(picture)
    writer.release()
    return path


def test_a_lossless_video_comes_bit_for_bit(
    video: Path, pictures: list[npt.NDArray[np.uint8]]
) -> None:
    """Every frame from the first, upright, with its place in the video as the camera's time."""
    with VideoSource(video, rotation=90) as source:
        info = source.open()
        frames = [source.grab(1.0) for _ in pictures]
    assert (info.size, info.pixel_format, info.is_emulated) == ((48, 64), PixelFormat.BGR, True)
    for index, (frame, picture) in enumerate(zip(frames, pictures, strict=True)):
        np.testing.assert_array_equal(frame.pixels, upright(picture, 90))
        assert (frame.sequence, frame.bits) == (index, 8)
        assert frame.camera_time_ns == index * 100_000_000
        assert np.isnan(frame.exposure_us) and np.isnan(frame.gain_db)


def test_the_end_of_the_video_is_the_loss_of_the_device(
    video: Path, pictures: list[npt.NDArray[np.uint8]]
) -> None:
    """Every grab after the last frame says so; opened again, it starts from the first."""
    source = VideoSource(video)
    with source:
        for _ in pictures:
            source.grab(1.0)
        for _ in range(2):
            with pytest.raises(DeviceLostError, match=r"no more frames: .*turn\.avi ended after 4"):
                source.grab(1.0)
    with source:
        np.testing.assert_array_equal(source.grab(1.0).pixels, pictures[0])


def test_numbered_images_are_a_video(
    tmp_path: Path, pictures: list[npt.NDArray[np.uint8]], capfd: pytest.CaptureFixture[str]
) -> None:
    """A pattern stands for the row of images; OpenCV is kept quiet at its end."""
    for index, picture in enumerate(pictures):
        cv2.imwrite(str(tmp_path / f"f_{index:04d}.png"), picture)
    with VideoSource(tmp_path / "f_%04d.png") as source:
        for picture in pictures:
            np.testing.assert_array_equal(source.grab(1.0).pixels, picture)
        with pytest.raises(DeviceLostError, match="no more frames"):
            source.grab(1.0)
    assert capfd.readouterr().err == ""


def test_images_of_another_size_are_refused(tmp_path: Path) -> None:
    """Both shapes are in the message."""
    cv2.imwrite(str(tmp_path / "f_0.png"), colourful(64, 48))
    cv2.imwrite(str(tmp_path / "f_1.png"), colourful(60, 48))
    with VideoSource(tmp_path / "f_%d.png") as source:
        source.grab(1.0)
        with pytest.raises(IncompleteFrameError, match=r"\(48, 60, 3\).*\(48, 64, 3\)"):
            source.grab(1.0)


def test_what_is_not_a_video_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A missing file, a missing folder of numbered images, none in it, and a text."""
    for missing in ("none.avi", "none/f_%04d.png"):
        with pytest.raises(InputError, match="there is no video"):
            VideoSource(tmp_path / missing).open()
    with pytest.raises(FileFormatError, match="reads no frame from"):
        VideoSource(tmp_path / "f_%04d.png").open()
    (tmp_path / "text.avi").write_text("hello")
    with pytest.raises(FileFormatError, match=r"reads no frame from .*text\.avi"):
        VideoSource(tmp_path / "text.avi").open()
    assert capfd.readouterr().err == ""


def test_a_closed_video_says_so(video: Path) -> None:
    """Closing twice is harmless; grabbing after it is not silent."""
    source = VideoSource(video)
    source.close()
    with source:
        source.configure(1000.0, 0.0)
    source.close()
    with pytest.raises(DeviceLostError, match=r"is not open: call open\(\)"):
        source.grab(1.0)
    with pytest.raises(DeviceLostError, match="is not open"):
        source.configure(1000.0, 0.0)
