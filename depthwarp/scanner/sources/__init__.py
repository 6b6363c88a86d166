"""Where frames come from: Basler cameras, OpenCV cameras, videos, folders of images."""

from __future__ import annotations

import os

from depthwarp.errors import InputError, MissingExtraError
from depthwarp.scanner.frames import FrameSource, PixelFormat
from depthwarp.scanner.sources.base import CameraEntry
from depthwarp.scanner.sources.basler import BaslerSource
from depthwarp.scanner.sources.basler_sdk import list_basler_cameras, load_sdk
from depthwarp.scanner.sources.folder import FolderSource
from depthwarp.scanner.sources.opencv import OpenCvSource, list_opencv_cameras
from depthwarp.scanner.sources.video import VideoSource

__all__ = [
    "BaslerSource",
    "CameraEntry",
    "FolderSource",
    "OpenCvSource",
    "VideoSource",
    "list_cameras",
    "open_source",
]

FORMS = "basler, basler:SERIAL, opencv:NUMBER, opencv:VIDEO or folder:PATH"


def open_source(
    spec: str,
    *,
    rotation: int = 0,
    pixel_format: PixelFormat | None = None,
    bits: int | None = None,
) -> FrameSource:
    """Make the frame source that a text names; `with`, or its `open`, takes the device.

    Example:
        ```python
        with open_source("basler:40012345", rotation=90) as camera:
            camera.configure(exposure_us=2000.0, gain_db=0.0)
            frame = camera.grab(timeout_s=2.0)
        ```

    Args:
        spec: `basler`, `basler:SERIAL`, `opencv:NUMBER`, `opencv:VIDEO` or `folder:PATH`.
        rotation: How far the camera is rolled, clockwise seen from behind it: 0, 90, 180 or 270
            [degrees]. Frames come out upright.
        pixel_format: Format of the raw frames: what a Basler camera is to send, or how the images
            of a folder are meant.
        bits: Significant bits of a number, likewise.

    Raises:
        InputError: No such kind of source, or an argument that the kind does not take.
    """
    kind, _, name = spec.partition(":")
    path = os.path.expanduser(name)
    if kind == "basler":
        return BaslerSource(name or None, rotation=rotation, pixel_format=pixel_format, bits=bits)
    if kind == "folder" and name:
        return FolderSource(path, rotation=rotation, pixel_format=pixel_format, bits=bits)
    if kind == "opencv" and name:
        if pixel_format is not None or bits is not None:
            raise InputError(f"'{spec}' takes no pixel_format or bits: OpenCV gives 8-bit BGR")
        if name.isascii() and name.isdigit():
            return OpenCvSource(int(name), rotation=rotation)
        return VideoSource(path, rotation=rotation)
    raise InputError(f"a frame source must be {FORMS}, got '{spec}'")


def list_cameras() -> list[CameraEntry]:
    """Cameras that this computer can see: Basler's, if pypylon is there, and the system's own."""
    try:
        found = list_basler_cameras(load_sdk())
    except MissingExtraError:
        found = []
    return found + list_opencv_cameras()
