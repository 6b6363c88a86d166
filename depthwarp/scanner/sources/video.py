"""Frames from a video file or from numbered images, through OpenCV's reader."""

from __future__ import annotations

import os
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from depthwarp.errors import FileFormatError, InputError
from depthwarp.scanner.frames import (
    DeviceLostError,
    Frame,
    IncompleteFrameError,
    SourceInfo,
)
from depthwarp.scanner.sources.base import UprightSource
from depthwarp.scanner.sources.capture import as_picture, quiet_opencv

__all__ = ["VideoSource"]


class VideoSource(UprightSource):
    """A video, one frame a trigger, from its beginning each time that it is opened.

    Args:
        path: A video file, or numbered images as `name_%04d.png`. Only lossless coding (FFV1,
            images) leaves the line where the camera saw it.
        rotation: How far the camera was rolled, clockwise seen from behind it [degrees].
    """

    def __init__(self, path: str | os.PathLike[str], *, rotation: int = 0) -> None:
        self.path = Path(path)
        super().__init__(f"video {self.path}", rotation)
        self._capture: cv2.VideoCapture | None = None
        self._first: npt.NDArray[np.uint8] | None = None
        self._shape: tuple[int, ...] = ()

    def open(self) -> SourceInfo:
        """Open the file and look at its first frame.

        Raises:
            InputError: There is no such file, or OpenCV cannot read it as a video.
        """
        if self._info is not None:
            return self._info
        is_numbered = "%" in self.path.name
        if not (self.path.parent.is_dir() if is_numbered else self.path.is_file()):
            raise InputError(f"there is no video {self.path}: give the name of an existing file")
        with quiet_opencv():
            # Numbered images have a reader of their own; the general one would treat them as video.
            backend = cv2.CAP_IMAGES if is_numbered else cv2.CAP_ANY
            capture = cv2.VideoCapture(str(self.path), backend)
            picture = capture.read()[1] if capture.isOpened() else None
        if picture is None:
            capture.release()
            raise FileFormatError(
                f"OpenCV reads no frame from {self.path}: it is damaged, or not a video or a row "
                "of numbered images that this build of OpenCV knows"
            )
        self._capture = capture
        try:
            self._first, pixel_format = as_picture(picture, self.label)
        except IncompleteFrameError as error:
            self.close()
            raise FileFormatError(str(error)) from error
        self._shape = self._first.shape
        height, width = self._shape[:2]
        return self._opened_as(
            name=f"video ({capture.getBackendName()})",
            serial=str(self.path),
            raw_size=(width, height),
            raw_format=pixel_format,
            is_emulated=True,
        )

    def close(self) -> None:
        """Close the file."""
        self._info = self._first = None
        if self._capture is not None:
            self._capture.release()
            self._capture = None

    def configure(self, exposure_us: float, gain_db: float) -> None:
        """Do nothing: the pictures are taken; their frames say NaN for exposure and gain."""
        self._require_open()

    def grab(self, timeout_s: float) -> Frame:
        """Read the next frame; its camera time is its place in the video.

        Raises:
            IncompleteFrameError: The size changed.
            DeviceLostError: There are no more.
        """
        capture = self._require_capture()
        picture, self._first = self._first, None
        if picture is None:
            with quiet_opencv():
                taken = capture.grab()
            if not taken:
                count = round(capture.get(cv2.CAP_PROP_FRAME_COUNT))
                raise DeviceLostError(
                    f"no more frames: {self.label} ended after {self._sequence} frames "
                    f"(its header says {count})"
                )
            picture, _ = as_picture(capture.retrieve()[1], self.label, expected=self._shape)
        return self._upright_frame(picture, 8, camera_time_ns=_place_ns(capture))

    def _require_capture(self) -> cv2.VideoCapture:
        self._require_open()
        assert self._capture is not None, "an open video has its capture"
        return self._capture


def _place_ns(capture: cv2.VideoCapture) -> int | None:
    """Where the latest frame stands in the video [ns]; None where frames have no rate."""
    if not capture.get(cv2.CAP_PROP_FPS) > 0:
        return None
    return round(capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
