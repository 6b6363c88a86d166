"""What all frame sources share: mounting, numbering of frames, context manager, listing entry."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Self

import numpy as np
import numpy.typing as npt

from depthwarp.scanner.frames import DeviceLostError, Frame, PixelFormat, SourceInfo
from depthwarp.scanner.sources.mounting import (
    check_rotation,
    upright_format,
    upright_pixels,
    upright_size,
)

__all__ = ["CameraEntry", "UprightSource"]


@dataclass(frozen=True)
class CameraEntry:
    """A camera that this computer can see.

    Attributes:
        spec: What `open_source` takes to use it.
        name: Model, for people.
        is_emulated: Whether no real camera stands behind it.
    """

    spec: str
    name: str
    is_emulated: bool


class UprightSource(ABC):
    """A frame source that turns its raw pictures upright and numbers them.

    Args:
        label: What error messages call it.
        rotation: How far the camera is rolled, clockwise seen from behind it [degrees].

    Raises:
        InputError: The rotation is not 0, 90, 180 or 270.
    """

    def __init__(self, label: str, rotation: int) -> None:
        self.label = label
        self.rotation = check_rotation(rotation)
        self._info: SourceInfo | None = None
        self._sequence = 0

    @abstractmethod
    def open(self) -> SourceInfo:
        """Take the device; what it is. Harmless when it is open."""

    @abstractmethod
    def close(self) -> None:
        """Give the device back; harmless when it is not open."""

    @abstractmethod
    def configure(self, exposure_us: float, gain_db: float) -> None:
        """Set exposure and gain; the next grabbed frame has them. NaN leaves one as it is."""

    @abstractmethod
    def grab(self, timeout_s: float) -> Frame:
        """Trigger one exposure that begins after this call, and wait for its frame."""

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _opened_as(
        self,
        name: str,
        serial: str,
        raw_size: tuple[int, int],
        raw_format: PixelFormat,
        is_emulated: bool,
    ) -> SourceInfo:
        """Start the numbering of frames and say what the source is, in upright terms."""
        self._sequence = 0
        self._info = SourceInfo(
            name=name,
            serial=serial,
            size=upright_size(raw_size, self.rotation),
            pixel_format=upright_format(raw_format, raw_size, self.rotation),
            is_emulated=is_emulated,
        )
        return self._info

    def _require_open(self) -> SourceInfo:
        """What the source is, if it is open.

        Raises:
            DeviceLostError: It is not.
        """
        if self._info is None:
            raise DeviceLostError(f"{self.label} is not open: call open() first, or use 'with'")
        return self._info

    def _upright_frame(
        self,
        raw: npt.NDArray[np.uint8] | npt.NDArray[np.uint16],
        bits: int,
        exposure_us: float = float("nan"),
        gain_db: float = float("nan"),
        host_time_ns: int | None = None,
        camera_time_ns: int | None = None,
    ) -> Frame:
        """The next frame from a raw picture that has the source's format and size."""
        frame = Frame(
            pixels=upright_pixels(raw, self.rotation),
            pixel_format=self._require_open().pixel_format,
            bits=bits,
            exposure_us=exposure_us,
            gain_db=gain_db,
            host_time_ns=time.time_ns() if host_time_ns is None else host_time_ns,
            camera_time_ns=camera_time_ns,
            sequence=self._sequence,
        )
        self._sequence += 1
        return frame
