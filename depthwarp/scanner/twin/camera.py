"""The twin's camera: a frame source that renders what the head sees when a frame is grabbed."""

from __future__ import annotations

import time
from collections import Counter, deque
from enum import StrEnum

from depthwarp.errors import InputError
from depthwarp.scanner.frames import (
    DeviceLostError,
    Frame,
    FrameError,
    FrameTimeoutError,
    IncompleteFrameError,
    SourceInfo,
)
from depthwarp.scanner.twin.head import HeadState
from depthwarp.scanner.twin.renderer import Shot, TwinRenderer

__all__ = ["EXPOSURE_RANGE_US", "GAIN_RANGE_DB", "CameraFault", "TwinCamera"]

EXPOSURE_RANGE_US = (10.0, 1_000_000.0)
GAIN_RANGE_DB = (0.0, 24.0)


class CameraFault(StrEnum):
    """What can be made to go wrong with a grab."""

    TIMEOUT = "timeout"
    INCOMPLETE = "incomplete"
    LOST = "lost"
    WRONG_SIZE = "wrong_size"


class TwinCamera:
    """A `FrameSource` whose frames are rendered from where the head truly is.

    Repeated grabs at one angle with the same settings differ by their noise; a scan that comes
    back to an angle later, or in another process, gets the same frames there.

    Args:
        renderer: What renders.
        head: Where the head points and whether the laser is lit, read at each grab.
        serial: Serial number after "TWIN-".
    """

    def __init__(self, renderer: TwinRenderer, head: HeadState, serial: str = "0001") -> None:
        self.renderer = renderer
        self.head = head
        self._serial = f"TWIN-{serial}"
        self._exposure_us, self._gain_db = 2000.0, 0.0
        self._faults: deque[CameraFault] = deque()
        self._opened_ns: int | None = None
        self._lost = False
        self._sequence = 0
        self._angle: float | None = None
        self._repeats: Counter[tuple[bool, float, float]] = Counter()

    def open(self) -> SourceInfo:
        """Start the camera's clock and its count of frames."""
        self._opened_ns = time.monotonic_ns()
        self._lost = False
        self._sequence = 0
        self._angle = None
        return SourceInfo(
            name="depthwarp twin",
            serial=self._serial,
            size=self.renderer.geometry.lens.size,
            pixel_format=self.renderer.sensor.pixel_format,
            is_emulated=True,
        )

    def close(self) -> None:
        """Close; harmless when it is not open."""
        self._opened_ns = None

    def configure(self, exposure_us: float, gain_db: float) -> None:
        """Set exposure and gain; the next grabbed frame has them.

        Raises:
            InputError: Out of `EXPOSURE_RANGE_US` or `GAIN_RANGE_DB`.
        """
        for name, value, (least, most), unit in (
            ("exposure_us", exposure_us, EXPOSURE_RANGE_US, "us"),
            ("gain_db", gain_db, GAIN_RANGE_DB, "dB"),
        ):
            if not least <= value <= most:
                raise InputError(f"{name} must be from {least} to {most} {unit}, got {value}")
        self._exposure_us, self._gain_db = float(exposure_us), float(gain_db)

    def fail(self, fault: CameraFault, grabs: int = 1) -> None:
        """Make the next grabs go wrong, after those that were asked for before.

        Args:
            fault: What goes wrong. A lost camera stays lost until it is opened again.
            grabs: How many grabs.
        """
        self._faults.extend([fault] * grabs)

    def grab(self, timeout_s: float) -> Frame:
        """Render the scene as the head stands now.

        The time that rendering takes does not count against `timeout_s`: it stands for no time of
        a real camera. A timeout that was asked for is raised at once.

        Raises:
            FrameTimeoutError: Asked for with `fail`.
            IncompleteFrameError: Asked for with `fail`.
            DeviceLostError: Asked for with `fail`, until the camera is opened again.
            FrameError: The camera is not open.
        """
        if self._lost:
            raise DeviceLostError(f"camera {self._serial} is gone: open it again")
        if self._opened_ns is None:
            raise FrameError(f"camera {self._serial} is not open: call open() first")
        fault = self._faults.popleft() if self._faults else None
        if fault is CameraFault.LOST:
            self._lost = True
            raise DeviceLostError(f"camera {self._serial} has been unplugged: open it again")
        if fault is CameraFault.TIMEOUT:
            raise FrameTimeoutError(f"no frame from camera {self._serial} in {timeout_s} s")
        sequence = self._sequence
        self._sequence += 1
        if fault is CameraFault.INCOMPLETE:
            raise IncompleteFrameError(
                f"frame {sequence} of camera {self._serial} came incomplete: grab again"
            )
        camera_time_ns = time.monotonic_ns() - self._opened_ns
        pixels = self.renderer.render(self._shot())
        if fault is CameraFault.WRONG_SIZE:
            pixels = pixels[: len(pixels) // 2].copy()
        return Frame(
            pixels=pixels,
            pixel_format=self.renderer.sensor.pixel_format,
            bits=self.renderer.sensor.bits,
            exposure_us=self._exposure_us,
            gain_db=self._gain_db,
            host_time_ns=time.time_ns(),
            camera_time_ns=camera_time_ns,
            sequence=sequence,
        )

    def __enter__(self) -> TwinCamera:
        self.open()
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _shot(self) -> Shot:
        """What is seen now, with the count of such frames since the head came to this angle."""
        angle, laser_on = float(self.head.true_angle), bool(self.head.laser_on)
        if angle != self._angle:
            self._angle = angle
            self._repeats.clear()
        key = (laser_on, self._exposure_us, self._gain_db)
        number = self._repeats[key]
        self._repeats[key] += 1
        return Shot(angle, laser_on, self._exposure_us, self._gain_db, number)
