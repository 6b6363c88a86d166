"""What the sources that read through `cv2.VideoCapture` share."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

from depthwarp.scanner.frames import IncompleteFrameError, PixelFormat

__all__ = ["as_picture", "quiet_opencv"]


@contextmanager
def quiet_opencv() -> Iterator[None]:
    """Keep OpenCV's own log off stderr for a moment: what goes wrong is raised as an error."""
    logging: Any = getattr(cv2.utils, "logging", cv2)  # OpenCV 4 has the calls at the top
    level = logging.getLogLevel()
    logging.setLogLevel(0)
    try:
        yield
    finally:
        logging.setLogLevel(level)


def as_picture(
    read: object, label: str, expected: tuple[int, ...] | None = None
) -> tuple[npt.NDArray[np.uint8], PixelFormat]:
    """Check what `VideoCapture` gave: BGR (H, W, 3), or grey (H, W).

    Args:
        read: What it gave, None if nothing.
        label: What error messages call the source.
        expected: Shape of the pictures so far.

    Raises:
        IncompleteFrameError: It is neither, or its shape is not the expected one.
    """
    if read is None:
        raise IncompleteFrameError(f"{label} gave an empty picture")
    picture = np.asarray(read)
    if picture.ndim == 3 and picture.shape[2] == 1:
        picture = picture[:, :, 0]
    is_picture = picture.ndim == 2 or (picture.ndim == 3 and picture.shape[2] == 3)
    if picture.dtype != np.uint8 or not is_picture:
        raise IncompleteFrameError(
            f"{label} gave an array of shape {picture.shape}, {picture.dtype}: expected 8-bit "
            "grey or BGR pictures; choose such a format in its driver"
        )
    if expected is not None and picture.shape != expected:
        raise IncompleteFrameError(
            f"{label} gave a picture of shape {picture.shape}, but its first had {expected}: "
            "open it again after a change of its format"
        )
    return picture, PixelFormat.BGR if picture.ndim == 3 else PixelFormat.MONO
