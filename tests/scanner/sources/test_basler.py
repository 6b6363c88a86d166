"""The Basler source on the SDK's emulated camera: the path that real cameras take."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from depthwarp.errors import InputError, MissingExtraError
from depthwarp.scanner.frames import (
    PixelFormat,
)
from depthwarp.scanner.sources import BaslerSource, CameraEntry, list_cameras
from depthwarp.scanner.sources.basler_sdk import choose_format
from tests.scanner.sources.conftest import HEIGHT, WIDTH, Open
from tests.scanner.sources.pictures import BAYER, mosaic, upright


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
