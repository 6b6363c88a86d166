"""Camera frames: what a frame carries, what a source of frames can do, and how it can fail."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from depthwarp.errors import DepthwarpError, InputError

__all__ = [
    "DeviceLostError",
    "Frame",
    "FrameError",
    "FrameSource",
    "FrameTimeoutError",
    "IncompleteFrameError",
    "PixelFormat",
    "SourceInfo",
]


class FrameError(DepthwarpError):
    """A frame did not arrive as it should."""


class FrameTimeoutError(FrameError):
    """No frame came in time; the next grab may succeed."""


class IncompleteFrameError(FrameError):
    """A frame came damaged or in part; the next grab may succeed."""


class DeviceLostError(FrameError):
    """The camera is gone: it has to be opened again."""


class PixelFormat(StrEnum):
    """How the numbers of a frame are meant; Bayer names give the upper left 2 x 2 pixels by row."""

    MONO = "mono"
    BGR = "bgr"
    BAYER_RGGB = "bayer_rggb"
    BAYER_GRBG = "bayer_grbg"
    BAYER_GBRG = "bayer_gbrg"
    BAYER_BGGR = "bayer_bggr"

    @property
    def is_bayer(self) -> bool:
        """Whether a pixel holds one colour of a mosaic."""
        return self.name.startswith("BAYER")


@dataclass(frozen=True, eq=False)
class Frame:
    """One picture, upright: rows from top to bottom, the laser line runs along the columns.

    Attributes:
        pixels: Shape (H, W), or (H, W, 3) for BGR; uint8 or uint16.
        pixel_format: What the numbers are.
        bits: Significant bits of a number: 8, or 10 to 16 in uint16; full scale is 2^bits - 1.
        exposure_us: Exposure time [microseconds]; NaN where the source does not know.
        gain_db: Gain [dB]; NaN where the source does not know.
        host_time_ns: Clock of this computer when the frame had arrived [ns since 1970].
        camera_time_ns: Clock of the camera [ns], None where it has none.
        sequence: Number of the frame since the source was opened, from 0.

    Raises:
        InputError: Shape, dtype, format and bits that do not fit together.
    """

    pixels: npt.NDArray[np.uint8] | npt.NDArray[np.uint16]
    pixel_format: PixelFormat
    bits: int
    exposure_us: float
    gain_db: float
    host_time_ns: int
    camera_time_ns: int | None
    sequence: int

    def __post_init__(self) -> None:
        wanted = 3 if self.pixel_format is PixelFormat.BGR else 2
        if self.pixels.ndim != wanted or (wanted == 3 and self.pixels.shape[2] != 3):
            raise InputError(
                f"a frame in {self.pixel_format} must have shape "
                f"{'(H, W, 3)' if wanted == 3 else '(H, W)'}, got {self.pixels.shape}"
            )
        most = {np.dtype(np.uint8): 8, np.dtype(np.uint16): 16}.get(self.pixels.dtype, 0)
        if not 1 <= self.bits <= most:
            raise InputError(
                f"a frame must hold uint8 or uint16 with at most that many bits, got "
                f"{self.pixels.dtype} with {self.bits} bits"
            )


@dataclass(frozen=True)
class SourceInfo:
    """What a frame source is.

    Attributes:
        name: Model or kind, for people.
        serial: Serial number, or what identifies the source; a calibration belongs to one.
        size: (width, height) of its upright frames [px].
        pixel_format: Format of its frames.
        is_emulated: Whether no real camera stands behind it.
    """

    name: str
    serial: str
    size: tuple[int, int]
    pixel_format: PixelFormat
    is_emulated: bool


class FrameSource(Protocol):
    """A camera, or what stands in for one: one trigger, one frame. A context manager."""

    def open(self) -> SourceInfo:
        """Take the device.

        Raises:
            InputError: There is no such device; the message lists those that there are.
            FrameError: It is there but cannot be used.
        """
        ...

    def close(self) -> None:
        """Give the device back; harmless when it is not open."""
        ...

    def configure(self, exposure_us: float, gain_db: float) -> None:
        """Set exposure and gain; the next grabbed frame has them.

        Raises:
            InputError: Out of the device's range; the message says the range.
        """
        ...

    def grab(self, timeout_s: float) -> Frame:
        """Trigger one exposure that begins after this call, and wait for its frame.

        Raises:
            FrameTimeoutError: Nothing came in time.
            IncompleteFrameError: The frame is damaged.
            DeviceLostError: The device is gone.
        """
        ...

    def __enter__(self) -> Any:
        """Open."""
        ...

    def __exit__(self, *exception: object) -> None:
        """Close."""
        ...
