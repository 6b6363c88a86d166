"""A camera and an axis without hardware, light enough to be killed and started again often."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from depthwarp.scanner.axis import AxisState
from depthwarp.scanner.frames import Frame, PixelFormat, SourceInfo

SIZE = (24, 16)


class FakeAxis:
    """Turns at once, on a step grid; remembers everything that it was told."""

    def __init__(
        self, step: float = 0.1125, fails_at: int | None = None, error: Exception | None = None
    ):
        self.step, self.fails_at, self.error = step, fails_at, error
        self.angle, self.laser, self.moves = 0.0, False, 0
        self.log: list[str] = []

    def connect(self) -> str:
        return "fake"

    def reference(self) -> None:
        self.angle = 0.0

    def move_to(self, degrees: float) -> float:
        self.moves += 1
        if self.error is not None and self.moves == self.fails_at:
            raise self.error
        self.angle = round(degrees / self.step) * self.step
        self.log.append("move")
        return self.angle

    def position(self) -> float:
        return self.angle

    def state(self) -> AxisState:
        return AxisState.IDLE

    def set_laser(self, on: bool) -> None:
        self.laser = on
        self.log.append("laser on" if on else "laser off")

    def stop(self) -> None:
        self.laser = False
        self.log.append("stop")

    def close(self) -> None:
        self.stop()

    def __enter__(self) -> FakeAxis:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


class FakeSource:
    """Frames that follow from the axis alone: angle, laser and exposure, not from the past."""

    def __init__(
        self, axis: FakeAxis, errors: Sequence[Exception | None] = (), delay_s: float = 0.0
    ):
        self.axis, self.errors, self.delay_s = axis, list(errors), delay_s
        self.exposure, self.gain, self.sequence = 0.0, 0.0, 0
        self.size = SIZE
        self.laser_seen: list[bool] = []

    @property
    def info(self) -> SourceInfo:
        return SourceInfo("fake", "F-1", SIZE, PixelFormat.MONO, is_emulated=True)

    def open(self) -> SourceInfo:
        return self.info

    def close(self) -> None:
        pass

    def configure(self, exposure_us: float, gain_db: float) -> None:
        self.exposure, self.gain = exposure_us, gain_db

    def grab(self, timeout_s: float) -> Frame:
        if self.errors and (error := self.errors.pop(0)) is not None:
            raise error
        time.sleep(self.delay_s)
        self.laser_seen.append(self.axis.laser)
        seed = [round(self.axis.angle * 1e4), int(self.axis.laser), round(self.exposure)]
        width, height = self.size
        pixels = np.random.default_rng(seed).integers(0, 200, (height, width), dtype=np.uint8)
        self.sequence += 1
        return Frame(
            pixels, PixelFormat.MONO, 8, self.exposure, self.gain, 0, None, self.sequence - 1
        )

    def __enter__(self) -> FakeSource:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
