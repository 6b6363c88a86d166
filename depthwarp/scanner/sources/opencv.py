"""A camera of the operating system (webcam, capture card) through OpenCV."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NoReturn, TypeVar

import cv2

from depthwarp.checks import check_positive
from depthwarp.errors import InputError
from depthwarp.scanner.frames import (
    DeviceLostError,
    Frame,
    FrameError,
    FrameTimeoutError,
    SourceInfo,
)
from depthwarp.scanner.sources.base import CameraEntry, UprightSource
from depthwarp.scanner.sources.capture import as_picture, quiet_opencv

__all__ = ["OpenCvSource", "list_opencv_cameras"]

OPEN_TIMEOUT_S = 10.0
"""How long a camera may take to its first frame."""

QUEUE = 2
"""Pictures that the driver is asked to queue; fewer are not taken by some drivers."""

UNKNOWN_QUEUE = 4
"""Pictures in the queue of a driver that does not tell: as many as OpenCV asks for by itself."""

IN_FLIGHT = 2
"""Pictures older than a call that are not queued yet: one being exposed, one being read out."""

V4L2_EXPOSURE_US = 100.0
"""Unit of the exposure control in Video4Linux [microseconds]."""

V4L2_MANUAL = 1.0
"""Its exposure mode in which the exposure control counts."""


DEVICES = Path("/sys/class/video4linux")
"""Where Linux lists its cameras; other systems have no such list."""

Result = TypeVar("Result")


class OpenCvSource(UprightSource):
    """A free-running camera: of each grab, the pictures that began before it are thrown away.

    Exposure can be set only under Linux (Video4Linux), where its unit is known. Gain is counted in
    the driver's own units everywhere, so only 0, the lowest, can be asked for, and frames say NaN.

    Args:
        number: Which camera, from 0.
        rotation: How far the camera is rolled, clockwise seen from behind it [degrees].
    """

    def __init__(self, number: int, *, rotation: int = 0) -> None:
        super().__init__(f"camera opencv:{number}", rotation)
        if number < 0:
            raise InputError(f"the number of a camera must be 0 or more, got {number}")
        self.number = number
        self._capture: cv2.VideoCapture | None = None
        self._reader: ThreadPoolExecutor | None = None
        self._shape: tuple[int, ...] = ()
        self._exposure_us = math.nan

    def open(self) -> SourceInfo:
        """Take the camera and wait for a first picture.

        Raises:
            InputError: There is no such camera.
            FrameError: It is there but cannot be used.
        """
        if self._info is not None:
            return self._info
        with quiet_opencv():
            capture = cv2.VideoCapture(self.number)
        if not capture.isOpened():
            capture.release()
            self._refuse()
        self._capture = capture
        # A driver that blocks cannot be interrupted: it gets a thread of its own to block.
        self._reader = ThreadPoolExecutor(1, thread_name_prefix=f"depthwarp-opencv-{self.number}")
        capture.set(cv2.CAP_PROP_BUFFERSIZE, QUEUE)
        self._exposure_us = _exposure_us(capture)
        try:
            read, _ = self._within(OPEN_TIMEOUT_S, lambda: _newest(capture, 0))
            picture, pixel_format = as_picture(read, self.label)
        except FrameError as error:
            self.close()
            raise FrameError(
                f"{self.label} opens but gives no picture: {error}; is another program using it?"
            ) from error
        self._shape = picture.shape
        return self._opened_as(
            name=f"OpenCV camera ({capture.getBackendName()})",
            serial=f"opencv:{self.number}",
            raw_size=(picture.shape[1], picture.shape[0]),
            raw_format=pixel_format,
            is_emulated=False,
        )

    def close(self) -> None:
        """Give the camera back, once the driver has returned from what it is doing."""
        self._info = None
        if self._reader is not None:
            self._reader.shutdown(wait=True, cancel_futures=True)
        if self._capture is not None:
            self._capture.release()
        self._capture = self._reader = None

    def configure(self, exposure_us: float, gain_db: float) -> None:
        """Set exposure and gain; NaN leaves one as it is.

        Raises:
            InputError: The camera does not take the exposure, or a gain other than 0 is asked for.
            FrameTimeoutError: The driver does not answer.
            DeviceLostError: The camera is not open.
        """
        capture = self._require_capture()
        if not (math.isnan(gain_db) or gain_db == 0):
            raise InputError(
                f"gain_db must be 0 (the lowest) or NaN (as it is) for {self.label}, whose driver "
                f"does not count gain in dB, got {gain_db}: choose a longer exposure instead"
            )
        if not math.isnan(exposure_us):
            self._set_exposure(capture, check_positive("exposure_us", exposure_us))
        if gain_db == 0:
            self._within(OPEN_TIMEOUT_S, lambda: capture.set(cv2.CAP_PROP_GAIN, 0.0))

    def grab(self, timeout_s: float) -> Frame:
        """Throw away what began before this call, and take the next picture.

        Raises:
            FrameTimeoutError: It did not come in time.
            IncompleteFrameError: It is not a picture of the size that the camera had.
            DeviceLostError: The camera gives no more pictures; it is closed.
        """
        capture = self._require_capture()
        try:
            read, host_time_ns = self._within(timeout_s, lambda: _newest(capture, _stale(capture)))
        except DeviceLostError as error:
            self.close()
            raise DeviceLostError(
                f"{self.label} gives no more pictures: was it unplugged? Plug it in and open it"
            ) from error
        picture, _ = as_picture(read, self.label, expected=self._shape)
        return self._upright_frame(
            picture, 8, exposure_us=self._exposure_us, host_time_ns=host_time_ns
        )

    def _set_exposure(self, capture: cv2.VideoCapture, exposure_us: float) -> None:
        """Set the exposure and make sure that the driver took it."""
        if capture.getBackendName() != "V4L2":
            raise InputError(
                f"exposure_us must be NaN (as it is) for {self.label}: in what unit "
                f"{capture.getBackendName()} counts exposure is not known, got {exposure_us}"
            )

        def change() -> float:
            capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, V4L2_MANUAL)
            capture.set(cv2.CAP_PROP_EXPOSURE, exposure_us / V4L2_EXPOSURE_US)
            return _exposure_us(capture)

        self._exposure_us = self._within(OPEN_TIMEOUT_S, change)
        # Written so that NaN, a camera without the control, fails.
        if not abs(self._exposure_us - exposure_us) <= V4L2_EXPOSURE_US:
            raise InputError(
                f"exposure_us {exposure_us} is not taken by {self.label}, which stands at "
                f"{self._exposure_us}: choose one in the range that 'v4l2-ctl -l' shows"
            )

    def _within(self, timeout_s: float, work: Callable[[], Result]) -> Result:
        """Do something with the camera, after all that was begun before.

        Raises:
            FrameTimeoutError: It is not done in time. It will still run to its end.
        """
        assert self._reader is not None, "only an open camera is worked with"
        future = self._reader.submit(work)
        try:
            return future.result(max(timeout_s, 0.0))
        except TimeoutError:
            future.cancel()
            raise FrameTimeoutError(
                f"{self.label} gave nothing within {timeout_s:.3g} s: allow more time than "
                "its exposure, or check its cable"
            ) from None

    def _require_capture(self) -> cv2.VideoCapture:
        self._require_open()
        assert self._capture is not None, "an open camera has its capture"
        return self._capture

    def _refuse(self) -> NoReturn:
        """Say why the camera could not be opened."""
        seen = list_opencv_cameras()
        if any(entry.spec == f"opencv:{self.number}" for entry in seen):
            raise FrameError(
                f"{self.label} is there but cannot be opened: another program may use it, or the "
                "right to use cameras may be missing (group 'video')"
            )
        there_are = ", ".join(f"{entry.spec} ({entry.name})" for entry in seen)
        raise InputError(
            f"there is no {self.label}: plug it in or give another number; "
            + (f"there are {there_are}" if seen else "no cameras are listed by the system")
        )


def list_opencv_cameras() -> list[CameraEntry]:
    """Cameras that the operating system lists; only Linux can be asked without opening them."""
    entries = []
    for folder in DEVICES.glob("video[0-9]*"):
        try:
            # A camera has several nodes; pictures come from its first.
            if (folder / "index").read_text().strip() == "0":
                name = (folder / "name").read_text().strip()
                entries.append((int(folder.name.removeprefix("video")), name))
        except OSError:  # unplugged while being listed
            continue
    return [CameraEntry(f"opencv:{number}", name, False) for number, name in sorted(entries)]


def _newest(capture: cv2.VideoCapture, skip: int) -> tuple[object, int]:
    """Read past `skip` pictures; the next one (None if damaged) and when it had come [ns].

    Raises:
        DeviceLostError: The driver has no more.
    """
    for _ in range(skip + 1):
        if not capture.grab():
            raise DeviceLostError("the driver gives no pictures")
    host_time_ns = time.time_ns()
    return capture.retrieve()[1], host_time_ns


def _stale(capture: cv2.VideoCapture) -> int:
    """How many pictures may have begun before now and still lie ahead."""
    # Some drivers answer 0 or -1 when they are asked for the length of their queue.
    return (max(int(capture.get(cv2.CAP_PROP_BUFFERSIZE)), 0) or UNKNOWN_QUEUE) + IN_FLIGHT


def _exposure_us(capture: cv2.VideoCapture) -> float:
    """Exposure that the driver tells [microseconds]; NaN where its unit is not known."""
    value = capture.get(cv2.CAP_PROP_EXPOSURE)
    known = capture.getBackendName() == "V4L2" and value > 0
    return value * V4L2_EXPOSURE_US if known else math.nan
