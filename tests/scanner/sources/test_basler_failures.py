"""Frames that do not come, and cameras that go: the Basler source in emulation."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from depthwarp.scanner.frames import (
    DeviceLostError,
    FrameError,
    FrameTimeoutError,
    IncompleteFrameError,
    PixelFormat,
)
from tests.scanner.sources.conftest import Open


def test_a_failed_buffer_is_an_incomplete_frame(
    camera: Open, pictures: list[npt.NDArray[np.uint8]]
) -> None:
    """The SDK's words are in the message; the next grab succeeds, and it is a later picture."""
    with camera(pixel_format=PixelFormat.BGR) as source:
        source.grab(2.0)
        nodes = source._camera.GetNodeMap()
        nodes.GetNode("ForceFailedBufferCount").SetValue(1)
        nodes.GetNode("ForceFailedBuffer").Execute()
        with pytest.raises(IncompleteFrameError, match="incompletely grabbed; grab again"):
            source.grab(2.0)
        frame = source.grab(2.0)
        assert frame.sequence == 1
        assert any(np.array_equal(frame.pixels, picture) for picture in pictures[1:])


def test_a_file_that_the_camera_cannot_show_is_an_incomplete_frame(
    camera: Open, tmp_path: Path
) -> None:
    """A damaged picture in the folder comes as the SDK's failure, not as grey."""
    (tmp_path / "f000.png").write_bytes(b"not a picture")
    with camera() as source, pytest.raises(IncompleteFrameError, match="Failed to load"):
        source.grab(2.0)


def test_a_frame_of_another_size_is_refused(camera: Open) -> None:
    """The emulated camera hands over a file that is smaller than it is set to."""
    with (
        camera(features={"Width": 100, "Height": 80}) as source,
        pytest.raises(IncompleteFrameError, match=r"61 x 40 pixels, but it is set to 100 x 80"),
    ):
        source.grab(2.0)


def test_a_late_frame_never_passes_for_the_next(
    camera: Open, pictures: list[npt.NDArray[np.uint8]]
) -> None:
    """After a timeout the picture of the old trigger is dropped, also when it lies ready."""
    with camera(pixel_format=PixelFormat.BGR) as source:
        source.grab(2.0)
        with pytest.raises(FrameTimeoutError, match=r"0815-0000.* within 0 s: allow more time"):
            source.grab(0.0)
        time.sleep(0.2)  # the late picture, the second file, arrives
        # Grabbing afresh begins with the first file: the second would be the late one.
        np.testing.assert_array_equal(source.grab(2.0).pixels, pictures[0])


def test_no_frame_without_a_trigger(
    camera: Open, pylon: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The wait ends when its time is over."""
    with camera() as source:
        monkeypatch.setattr(pylon.InstantCamera, "ExecuteSoftwareTrigger", lambda _: None)
        start = time.monotonic()
        with pytest.raises(FrameTimeoutError, match="within 0.2 s"):
            source.grab(0.2)
        assert 0.15 < time.monotonic() - start < 1.5


def test_a_removed_camera_is_lost_and_opens_again(
    camera: Open, pictures: list[npt.NDArray[np.uint8]]
) -> None:
    """The same source finds the same camera by its serial number, and starts anew."""
    with camera(pixel_format=PixelFormat.BGR) as source:
        source.grab(2.0)
        source._camera.GetNodeMap().GetNode("FirePnPCallback").Execute()
        with pytest.raises(DeviceLostError, match=r"0815-0000.* was removed: plug it in"):
            source.grab(2.0)
        with pytest.raises(DeviceLostError, match="is not open"):
            source.grab(2.0)
        assert source.open().serial == "0815-0000"
        frame = source.grab(2.0)
        assert frame.sequence == 0
        np.testing.assert_array_equal(frame.pixels, pictures[0])


def test_a_removed_camera_takes_no_settings(camera: Open) -> None:
    """The loss is told by the first call that follows it, whichever it is."""
    with camera() as source:
        source._camera.GetNodeMap().GetNode("FirePnPCallback").Execute()
        with pytest.raises(DeviceLostError, match="was removed"):
            source.configure(1000.0, 0.0)


def test_a_removal_ends_the_wait_for_a_frame(
    camera: Open, pylon: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Long before the time is over; the SDK's call to the listener is enough to know."""
    with camera() as source:
        nodes = source._camera.GetNodeMap()
        remove = nodes.GetNode("FirePnPCallback").Execute
        monkeypatch.setattr(pylon.InstantCamera, "ExecuteSoftwareTrigger", lambda _: remove())
        monkeypatch.setattr(pylon.InstantCamera, "IsCameraDeviceRemoved", lambda _: False)
        start = time.monotonic()
        with pytest.raises(DeviceLostError, match="was removed"):
            source.grab(20.0)
        assert time.monotonic() - start < 3.0


def test_what_the_sdk_raises_is_the_loss_of_the_camera(
    camera: Open, pylon: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the midst of work, in the SDK's words; the source opens again."""

    def fail(_: Any) -> None:
        raise pylon.RuntimeException("Link is down. : RuntimeException thrown (file 'x.cpp')")

    with camera() as source:
        with monkeypatch.context() as broken:
            broken.setattr(pylon.InstantCamera, "ExecuteSoftwareTrigger", fail)
            with pytest.raises(DeviceLostError, match="any more: Link is down; check its cable"):
                source.grab(2.0)
        source.open()
        assert source.grab(2.0).sequence == 0


def test_a_camera_in_use_is_a_frame_error(
    camera: Open, pylon: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is there but cannot be opened; nothing stays half open."""

    def fail(_: Any) -> None:
        raise pylon.RuntimeException("The device is controlled by another application.")

    source = camera()
    with monkeypatch.context() as used:
        used.setattr(pylon.InstantCamera, "Open", fail)
        with pytest.raises(FrameError, match="controlled by another application; close other"):
            source.open()
    assert source._camera is None
    source.open()


def test_a_camera_that_left_the_list_is_lost(
    camera: Open, pylon: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """When no word of the removal came, the timeout after it finds out."""
    with camera() as source:
        monkeypatch.setattr(pylon.InstantCamera, "ExecuteSoftwareTrigger", lambda _: None)
        monkeypatch.setenv("PYLON_CAMEMU", "0")
        with pytest.raises(DeviceLostError, match="was removed"):
            source.grab(0.05)
