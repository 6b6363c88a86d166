"""A camera through OpenCV, on a double that runs freely and queues pictures as drivers do."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.frames import (
    DeviceLostError,
    FrameError,
    FrameTimeoutError,
    IncompleteFrameError,
    PixelFormat,
)
from depthwarp.scanner.sources import CameraEntry, OpenCvSource, list_cameras, opencv


class FreeRunningCamera:
    """Stands for `cv2.VideoCapture`: a picture shows the scene of the moment when it began."""

    def __init__(self) -> None:
        self.backend = "V4L2"
        self.queue = 4
        self.tells_queue = True
        self.exposure_range = (1.0, 5000.0)  # of 100 microseconds
        self.properties = {cv2.CAP_PROP_EXPOSURE: 156.0, cv2.CAP_PROP_GAIN: 30.0}
        self.shape: tuple[int, ...] = (6, 8, 3)
        self.scene = 0
        self.opens = True
        self.unplugged = False
        self.damaged = False
        self.runs = threading.Event()
        self.runs.set()
        self.released = 0
        self.begun: deque[int] = deque()
        self.current = 0

    def isOpened(self) -> bool:
        return self.opens

    def getBackendName(self) -> str:
        return self.backend

    def release(self) -> None:
        self.released += 1

    def grab(self) -> bool:
        """Hand over the oldest picture; one more begins in its place."""
        self.runs.wait(10.0)
        while len(self.begun) < self.queue + 2:  # queued, being read out, being exposed
            self.begun.append(self.scene)
        self.current = self.begun.popleft()
        self.begun.append(self.scene)
        return not self.unplugged

    def retrieve(self) -> tuple[bool, npt.NDArray[np.uint8] | None]:
        if self.damaged:
            return False, None
        return True, np.full(self.shape, self.current, np.uint8)

    def get(self, what: int) -> float:
        if what == cv2.CAP_PROP_BUFFERSIZE:
            return float(self.queue) if self.tells_queue else -1.0
        return self.properties.get(what, -1.0)

    def set(self, what: int, value: float) -> bool:
        if what == cv2.CAP_PROP_BUFFERSIZE:
            self.queue = int(value) if self.tells_queue else self.queue
        elif what == cv2.CAP_PROP_EXPOSURE:
            low, high = self.exposure_range
            self.properties[what] = float(round(min(max(value, low), high)))
        elif what in self.properties or what == cv2.CAP_PROP_AUTO_EXPOSURE:
            self.properties[what] = value
        return True


@pytest.fixture
def double(monkeypatch: pytest.MonkeyPatch) -> Iterator[FreeRunningCamera]:
    """The camera that every number opens; no thread is left when the test is over."""
    camera = FreeRunningCamera()
    monkeypatch.setattr(cv2, "VideoCapture", lambda number: camera)
    yield camera
    camera.runs.set()
    assert not [t for t in threading.enumerate() if t.name.startswith("depthwarp-opencv")]


@pytest.mark.parametrize("tells_queue", [True, False])
def test_a_frame_begins_after_the_call(double: FreeRunningCamera, tells_queue: bool) -> None:
    """All that was queued or under way is thrown away, whether or not the queue is known."""
    double.tells_queue = tells_queue
    before = time.time_ns()
    with OpenCvSource(0) as source:
        for scene in range(1, 5):
            double.scene = scene
            frame = source.grab(1.0)
            assert frame.pixels.max() == frame.pixels.min() == scene
            assert frame.sequence == scene - 1
            assert before <= frame.host_time_ns <= time.time_ns()
            assert frame.camera_time_ns is None


def test_a_source_says_what_the_camera_is(double: FreeRunningCamera) -> None:
    """Upright size, format, and that it is real; opening again changes nothing."""
    with OpenCvSource(3, rotation=90) as source:
        info = source.open()
        assert (info.size, info.pixel_format) == ((6, 8), PixelFormat.BGR)
        assert (info.serial, info.is_emulated) == ("opencv:3", False)
        assert source.grab(1.0).pixels.shape == (8, 6, 3)
    assert double.released == 1


def test_a_grey_camera_gives_grey_frames(double: FreeRunningCamera) -> None:
    """With or without a third axis of length 1."""
    for shape in ((6, 8), (6, 8, 1)):
        double.shape = shape
        with OpenCvSource(0) as source:
            frame = source.grab(1.0)
        assert (frame.pixels.shape, frame.pixel_format) == ((6, 8), PixelFormat.MONO)


def test_exposure_is_set_in_the_unit_of_the_driver(double: FreeRunningCamera) -> None:
    """Automatic exposure off, 100 microseconds a step, and the frame says what the driver has."""
    with OpenCvSource(0) as source:
        assert source.grab(1.0).exposure_us == 15600.0
        source.configure(2030.0, 0.0)
        frame = source.grab(1.0)
    assert double.properties[cv2.CAP_PROP_AUTO_EXPOSURE] == 1.0
    assert double.properties[cv2.CAP_PROP_EXPOSURE] == 20.0
    assert double.properties[cv2.CAP_PROP_GAIN] == 0.0
    assert frame.exposure_us == 2000.0
    assert math.isnan(frame.gain_db)


def test_nan_leaves_a_setting(double: FreeRunningCamera) -> None:
    """Exposure and gain stay as they are, with every driver."""
    before = dict(double.properties)
    double.backend = "DSHOW"
    with OpenCvSource(0) as source:
        source.configure(math.nan, math.nan)
        assert math.isnan(source.grab(1.0).exposure_us)
    assert double.properties == before


def test_settings_that_the_driver_does_not_take_are_refused(double: FreeRunningCamera) -> None:
    """Out of its range, in an unknown unit, no control at all, a gain in dB."""
    with OpenCvSource(0) as source:
        with pytest.raises(InputError, match=r"600000.0 is not taken .* stands at 500000.0"):
            source.configure(6e5, 0.0)
        assert source.grab(1.0).exposure_us == 500000.0
        with pytest.raises(InputError, match=r"gain_db must be 0 .* got 6.0"):
            source.configure(2000.0, 6.0)
        for exposure_us in (0.0, -1.0, math.inf):
            with pytest.raises(InputError, match="exposure_us must be a finite number above 0"):
                source.configure(exposure_us, 0.0)
        del double.properties[cv2.CAP_PROP_EXPOSURE]
        double.exposure_range = (math.nan, math.nan)
        double.set = lambda *_: False  # type: ignore[method-assign]
        with pytest.raises(InputError, match=r"is not taken .* stands at nan"):
            source.configure(2000.0, 0.0)
        double.backend = "DSHOW"
        with pytest.raises(InputError, match=r"must be NaN .* unit DSHOW counts"):
            source.configure(2000.0, 0.0)


def test_a_blocked_driver_is_a_timeout_and_the_next_grab_is_fresh(
    double: FreeRunningCamera,
) -> None:
    """The wait ends in time; what the blocked driver gives later is thrown away."""
    with OpenCvSource(7) as source:
        double.scene = 1
        double.runs.clear()
        start = time.monotonic()
        for _ in range(2):
            with pytest.raises(FrameTimeoutError, match=r"opencv:7 gave nothing within 0.05 s"):
                source.grab(0.05)
        assert time.monotonic() - start < 1.0
        double.runs.set()
        double.scene = 2
        frame = source.grab(1.0)
        assert (frame.pixels.max(), frame.sequence) == (2, 0)


def test_an_unplugged_camera_is_lost_and_opens_again(double: FreeRunningCamera) -> None:
    """The source closes itself, and counts anew when it is opened again."""
    with OpenCvSource(0) as source:
        source.grab(1.0)
        double.unplugged = True
        with pytest.raises(DeviceLostError, match="was it unplugged"):
            source.grab(1.0)
        with pytest.raises(DeviceLostError, match=r"is not open: call open\(\)"):
            source.grab(1.0)
        assert double.released == 1
        double.unplugged = False
        source.open()
        assert source.grab(1.0).sequence == 0


def test_damaged_and_changed_pictures_are_incomplete(double: FreeRunningCamera) -> None:
    """A picture that cannot be decoded, and one of another size; then the next one is good."""
    with OpenCvSource(0) as source:
        double.damaged = True
        with pytest.raises(IncompleteFrameError, match="empty picture"):
            source.grab(1.0)
        double.damaged = False
        double.shape = (5, 8, 3)
        with pytest.raises(IncompleteFrameError, match=r"\(5, 8, 3\).*first had \(6, 8, 3\)"):
            source.grab(1.0)
        double.shape = (6, 8, 3)
        assert source.grab(1.0).sequence == 0


def test_a_camera_without_pictures_is_a_frame_error(double: FreeRunningCamera) -> None:
    """It opens, but nothing comes: closed again, with what to look for."""
    double.unplugged = True
    with pytest.raises(FrameError, match="opens but gives no picture.*another program"):
        OpenCvSource(0).open()
    double.unplugged, double.shape = False, (6, 8, 2)
    with pytest.raises(FrameError, match=r"shape \(6, 8, 2\)"):
        OpenCvSource(0).open()
    assert double.released == 2


def test_a_camera_that_is_not_there_is_refused_quietly(capfd: pytest.CaptureFixture[str]) -> None:
    """One clear error from the real OpenCV, and nothing of its own on stderr."""
    with pytest.raises(InputError, match="there is no camera opencv:63: plug it in"):
        OpenCvSource(63).open()
    assert capfd.readouterr().err == ""
    with pytest.raises(InputError, match="must be 0 or more"):
        OpenCvSource(-1)


def test_the_systems_cameras_are_listed(
    double: FreeRunningCamera, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One entry a camera, by number; a listed camera that does not open is in use."""
    monkeypatch.setattr(opencv, "DEVICES", tmp_path)
    for node, index, name in (
        ("video10", 0, "Late"),
        ("video2", 0, "Cam"),
        ("video3", 1, "Cam"),
        ("video4", None, "Gone"),
    ):
        (tmp_path / node).mkdir()
        (tmp_path / node / "name").write_text(f"{name}\n")
        if index is not None:
            (tmp_path / node / "index").write_text(f"{index}\n")
    entries = [CameraEntry("opencv:2", "Cam", False), CameraEntry("opencv:10", "Late", False)]
    assert [entry for entry in list_cameras() if entry.spec.startswith("opencv")] == entries
    double.opens = False
    with pytest.raises(FrameError, match="opencv:2 is there but cannot be opened"):
        OpenCvSource(2).open()
    with pytest.raises(InputError, match=r"no camera opencv:5.*opencv:2 \(Cam\), opencv:10"):
        OpenCvSource(5).open()
