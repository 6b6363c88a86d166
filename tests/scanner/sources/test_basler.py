"""The Basler source on the SDK's emulated camera: the path that real cameras take."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from depthwarp.errors import InputError, MissingExtraError
from depthwarp.scanner.frames import (
    DeviceLostError,
    FrameError,
    FrameTimeoutError,
    IncompleteFrameError,
    PixelFormat,
)
from depthwarp.scanner.sources import BaslerSource, CameraEntry, basler, list_cameras
from depthwarp.scanner.sources.basler_sdk import choose_format
from tests.scanner.sources.pictures import BAYER, colourful, mosaic, upright

WIDTH, HEIGHT = 61, 40

Open = Callable[..., BaslerSource]


@pytest.fixture
def pylon(monkeypatch: pytest.MonkeyPatch) -> Any:
    """The SDK with one emulated camera."""
    reason = "pypylon is not installed: pip install pypylon runs the camera tests in emulation"
    module = pytest.importorskip("pypylon.pylon", reason=reason)
    monkeypatch.setenv("PYLON_CAMEMU", "1")
    return module


@pytest.fixture
def pictures(tmp_path: Path) -> list[npt.NDArray[np.uint8]]:
    """Three pictures, which lie as PNG files in the folder that the camera shows."""
    images = [colourful(WIDTH, HEIGHT, seed) for seed in range(3)]
    for index, image in enumerate(images):
        cv2.imwrite(str(tmp_path / f"f{index:03d}.png"), image)
    return images


@pytest.fixture
def camera(pylon: Any, pictures: list[npt.NDArray[np.uint8]], tmp_path: Path) -> Any:
    """Makes sources of the emulated camera, set to show the pictures; closes them in the end."""
    made: list[BaslerSource] = []

    def make(serial: str | None = None, **options: Any) -> BaslerSource:
        features = {
            "Width": WIDTH,
            "Height": HEIGHT,
            "TestImageSelector": "Off",
            "ImageFileMode": "On",
            "ImageFilename": str(tmp_path),
        } | options.pop("features", {})
        made.append(BaslerSource(serial, features=features, **options))
        return made[-1]

    yield make
    for source in made:
        source.close()


@pytest.mark.parametrize("rotation", [0, 90])
def test_frames_are_the_files_pixel_for_pixel(
    camera: Open, pictures: list[npt.NDArray[np.uint8]], rotation: int
) -> None:
    """One trigger, one file, in the order of names and round again; upright."""
    before = time.time_ns()
    with camera(pixel_format=PixelFormat.BGR, rotation=rotation) as source:
        info = source.open()
        frames = [source.grab(2.0) for _ in range(4)]
    assert info.size == ((WIDTH, HEIGHT) if rotation % 180 == 0 else (HEIGHT, WIDTH))
    assert (info.serial, info.is_emulated) == ("0815-0000", True)
    assert info.name == "Basler Emulation"
    for index, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.pixels, upright(pictures[index % 3], rotation))
        assert (frame.pixel_format, frame.bits, frame.sequence) == (PixelFormat.BGR, 8, index)
        assert before <= frame.host_time_ns <= time.time_ns()
        assert frame.camera_time_ns is None  # the emulated camera has no clock
    assert all(a.host_time_ns < b.host_time_ns for a, b in zip(frames, frames[1:], strict=False))


@pytest.mark.parametrize("bits", [8, 12])
@pytest.mark.parametrize("pattern", BAYER)
def test_each_bayer_pattern_has_its_colours_where_its_name_says(
    camera: Open, pictures: list[npt.NDArray[np.uint8]], pattern: PixelFormat, bits: int
) -> None:
    """Of a colourful file; with an odd width, lying on its side."""
    with camera(pixel_format=pattern, bits=bits, rotation=90) as source:
        info, frame = source.open(), source.grab(2.0)
    assert info.pixel_format is frame.pixel_format
    expected = mosaic(upright(pictures[0], 90), frame.pixel_format)
    assert frame.bits == bits
    assert frame.pixels.dtype == (np.uint8 if bits == 8 else np.uint16)
    np.testing.assert_array_equal(frame.pixels >> (bits - 8), expected)


def test_a_camera_clock_is_told_in_nanoseconds(
    camera: Open, monkeypatch: pytest.MonkeyPatch, pylon: Any
) -> None:
    """Ticks count 1 ns, or what an older camera tells as its frequency."""
    monkeypatch.setattr(pylon.GrabResult, "GetTimeStamp", lambda _: 250)
    with camera() as source:
        assert source.grab(2.0).camera_time_ns == 250
        source._ticks_a_second = 125_000_000
        assert source.grab(2.0).camera_time_ns == 2000


def test_the_best_format_is_taken() -> None:
    """Raw colours with many bits first; the older and newer names of BGR; else grey."""
    for offered, name in (
        (("Mono8", "BayerGB8", "BayerGB12", "BGR8"), "BayerGB12"),
        (("Mono8", "BayerGB8", "BGR8"), "BayerGB8"),
        (("Mono8", "Mono12", "RGB8", "BGR8"), "BGR8"),
        (("Mono8", "BGR8Packed"), "BGR8Packed"),
        (("Mono8", "Mono12"), "Mono12"),
    ):
        assert choose_format(offered, None, None, "camera").name == name
    assert choose_format(("BayerBG8", "BayerBG12"), None, 8, "camera").name == "BayerBG8"
    with pytest.raises(InputError, match=r"camera has no .* bgr .* it has Mono8 \(mono, 8 bits\)"):
        choose_format(("Mono8", "RGB8"), PixelFormat.BGR, None, "camera")


def test_exposure_and_gain_are_in_the_next_frame(camera: Open) -> None:
    """Values that the camera rounds are told as it has them; NaN leaves a setting."""
    nan = float("nan")
    with camera() as source:
        source.configure(2000.04, 3.0)
        frame = source.grab(2.0)
        assert frame.exposure_us == pytest.approx(2000.0, abs=0.1)
        assert frame.gain_db == pytest.approx(3.0, abs=1e-4)
        source.configure(nan, 6.0)
        source.configure(500.0, nan)
        frame = source.grab(2.0)
        assert (frame.exposure_us, round(frame.gain_db, 3)) == (500.0, 6.0)


def test_automatic_exposure_is_switched_off(camera: Open) -> None:
    """Whatever the program before left: the exposure is the one that was set."""
    left = {"ExposureAuto": "Continuous", "GainAuto": "Once", "ExposureMode": "TriggerWidth"}
    with camera(features=left) as source:
        nodes = source._camera.GetNodeMap()
        assert [nodes.GetNode(name).GetValue() for name in left] == ["Off", "Off", "Timed"]


@pytest.mark.parametrize(
    ("exposure_us", "gain_db", "message"),
    [
        (0.5, 0.0, r"exposure_us must be from 1 to 1e\+07 .*0815-0000.*, got 0.5"),
        (float("inf"), 0.0, "exposure_us must be from 1 to"),
        (2000.0, 48.5, "gain_db must be from 0 to 48 .*, got 48.5"),
        (2000.0, -1.0, "gain_db must be from 0 to 48"),
    ],
)
def test_out_of_range_settings_are_refused(
    camera: Open, exposure_us: float, gain_db: float, message: str
) -> None:
    """The message says the camera's range; neither setting is changed."""
    with camera() as source:
        source.configure(700.0, 2.0)
        with pytest.raises(InputError, match=message):
            source.configure(exposure_us, gain_db)
        frame = source.grab(2.0)
        assert (frame.exposure_us, round(frame.gain_db, 3)) == (700.0, 2.0)


def test_older_cameras_have_other_names(camera: Open, monkeypatch: pytest.MonkeyPatch) -> None:
    """`ExposureTimeAbs` is set alike; a gain without a unit can only be the lowest, and is NaN."""
    monkeypatch.setattr(basler, "EXPOSURE_NAMES", ("NoSuchName", "ExposureTimeAbs"))
    monkeypatch.setattr(basler, "GAIN_NAMES", ("NoSuchName", "GainRaw"))
    with camera(features={"GainRaw": 500}) as source:
        source.configure(1500.0, float("nan"))
        assert source._gain.value == 500
        source.configure(1500.0, 0.0)
        frame = source.grab(2.0)
        assert frame.exposure_us == 1500.0
        assert np.isnan(frame.gain_db)
        assert source._gain.value == 192
        with pytest.raises(InputError, match="exposure_us must be from 100 to"):
            source.configure(50.0, 0.0)
        with pytest.raises(InputError, match=r"gain_db must be 0 \(the lowest\)"):
            source.configure(1500.0, 6.0)


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


def test_cameras_are_found_by_serial_number(camera: Open, monkeypatch: pytest.MonkeyPatch) -> None:
    """A wrong number, no camera, several cameras: the message lists those that there are."""
    with pytest.raises(InputError, match=r"serial number 'X1'; there are basler:0815-0000"):
        camera("X1").open()
    monkeypatch.setenv("PYLON_CAMEMU", "2")
    with pytest.raises(InputError, match=r"several .* basler:0815-0000 .*, basler:0815-0001"):
        camera().open()
    assert camera("0815-0001").open().serial == "0815-0001"
    assert CameraEntry("basler:0815-0001", "Emulation", True) in list_cameras()
    monkeypatch.setenv("PYLON_CAMEMU", "0")
    with pytest.raises(InputError, match="no Basler camera was found: check its cable"):
        camera("0815-0001").open()


@pytest.mark.parametrize(
    ("features", "message"),
    [
        ({"Width": 99999}, "99999 for its feature 'Width': .*smaller than or equal|99999"),
        ({"Wdith": 100}, "does not take 100 for its feature 'Wdith': .*not available"),
        ({"Width": "wide"}, "'wide' for its feature 'Width': wrong type"),
    ],
)
def test_features_that_the_camera_does_not_take_are_refused(
    camera: Open, features: dict[str, Any], message: str
) -> None:
    """The message names feature and value; the camera is given back."""
    source = camera(features=features)
    with pytest.raises(InputError, match=message):
        source.open()
    assert source._camera is None


def test_settings_are_a_text_that_the_sdk_reads_back(camera: Open, pylon: Any) -> None:
    """They hold the size that was set, and load into a camera of the same model."""
    with camera() as source:
        text = source.settings()
        assert f"\nWidth\t{WIDTH}\n" in text
    with camera() as source:
        source._camera.StopGrabbing()
        pylon.FeaturePersistence.LoadFromString(text, source._camera.GetNodeMap(), True)


def test_closing_leaves_nothing_behind(camera: Open) -> None:
    """Closed twice, closed unopened, closed by an error: no thread of the SDK stays."""
    with camera() as source:  # the SDK starts its own threads at its first use
        source.grab(2.0)
        held = source._camera
    assert not held.IsPylonDeviceAttached()  # given back now, not when Python forgets it
    del held
    source.close()
    camera().close()
    threads = len(os.listdir("/proc/self/task")) if sys.platform == "linux" else 0
    for _ in range(2):
        with pytest.raises(ZeroDivisionError), camera() as source:
            source.grab(2.0)
            raise ZeroDivisionError
    assert threads == (len(os.listdir("/proc/self/task")) if sys.platform == "linux" else 0)


def test_without_pypylon_the_message_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Nothing is imported before the camera is opened."""
    monkeypatch.setitem(sys.modules, "pypylon", None)
    monkeypatch.delitem(sys.modules, "pypylon.pylon", raising=False)
    source = BaslerSource()
    with pytest.raises(MissingExtraError, match=r"pip install \"depthwarp\[basler\]\""):
        source.open()
    assert all(not entry.spec.startswith("basler") for entry in list_cameras())


def test_the_sdk_loads_where_warnings_are_errors(pylon: Any) -> None:
    """Its import warns from C code, which would end the whole interpreter there."""
    code = "from depthwarp.scanner.sources.basler_sdk import load_sdk; load_sdk()"
    subprocess.run([sys.executable, "-W", "error", "-c", code], check=True, timeout=60)
