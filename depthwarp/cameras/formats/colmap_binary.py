"""COLMAP's cameras.bin and images.bin: little endian, without padding."""

from __future__ import annotations

import mmap
import struct
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from depthwarp.cameras.formats.colmap_model import (
    MODELS,
    CameraRecord,
    ImageRecord,
    check_known_model,
)
from depthwarp.errors import FileFormatError, InputError
from depthwarp.io.atomic import atomic_path

__all__ = [
    "NO_POINTS",
    "check_name",
    "read_cameras",
    "read_images",
    "write_cameras",
    "write_images",
]

COUNT = struct.Struct("<Q")
CAMERA = struct.Struct("<IiQQ")
IMAGE = struct.Struct("<I7dI")
POINT_BYTES = 24
"""A 2D point: x and y as doubles, and the number of its 3D point."""

LEAST_CAMERA = CAMERA.size + 2 * 8
LEAST_IMAGE = IMAGE.size + 2 + COUNT.size

LONGEST_NAME = 4096
"""Longest name of an image [byte], as of a path."""

NO_POINTS = COUNT.pack(0)
"""Content of a points3D.bin without a point."""

NAMES = {model.number: name for name, model in MODELS.items()}
OTHER_NAMES = {
    7: "FOV",
    10: "THIN_PRISM_FISHEYE",
    11: "RAD_TAN_THIN_PRISM_FISHEYE",
    12: "SIMPLE_DIVISION",
    13: "DIVISION",
    16: "EUCM",
    17: "EQUIRECTANGULAR",
}
"""COLMAP's models that are no lens here, for the message."""


def read_cameras(path: Path) -> list[CameraRecord]:
    """Read cameras.bin.

    Raises:
        FileFormatError: The size is not what the counts say, or an unknown model.
    """
    cameras = []
    with _opened(path) as data:
        for k in range(data.count("cameras", LEAST_CAMERA)):
            place = f"camera {k + 1} of the file"
            number, model, width, height = data.take(CAMERA, place)
            name = NAMES.get(model, OTHER_NAMES.get(model, f"number {model}"))
            parameters = check_known_model(path, place, name).parameters
            values = data.take(struct.Struct(f"<{len(parameters)}d"), place)
            cameras.append(CameraRecord(number, name, width, height, values))
        data.check_end("cameras")
    return cameras


def read_images(path: Path) -> list[ImageRecord]:
    """Read images.bin; the 2D points are passed over.

    Raises:
        FileFormatError: The size is not what the counts say, or a name that has no end.
    """
    images = []
    with _opened(path) as data:
        for k in range(data.count("images", LEAST_IMAGE)):
            place = f"image {k + 1} of the file"
            number, *pose, camera = data.take(IMAGE, place)
            name = data.take_name(place)
            (points,) = data.take(COUNT, place)
            data.skip(points * POINT_BYTES, f"the {points} points of {place}")
            images.append(ImageRecord(number, tuple(pose[:4]), tuple(pose[4:]), camera, name))
        data.check_end("images")
    return images


def write_cameras(cameras: Sequence[CameraRecord], path: Path) -> None:
    """Write cameras.bin; the file appears whole or not at all."""
    parts = [COUNT.pack(len(cameras))]
    for number, model, width, height, parameters in cameras:
        parts.append(CAMERA.pack(number, MODELS[model].number, width, height))
        parts.append(struct.pack(f"<{len(parameters)}d", *parameters))
    with atomic_path(path) as temporary:
        temporary.write_bytes(b"".join(parts))


def write_images(images: Sequence[ImageRecord], path: Path) -> None:
    """Write images.bin without 2D points; the file appears whole or not at all."""
    parts = [COUNT.pack(len(images))]
    for image in images:
        numbers = (*image.quaternion, *image.translation)
        parts.append(IMAGE.pack(image.number, *numbers, image.camera))
        parts.append(image.name.encode() + b"\0" + COUNT.pack(0))
    with atomic_path(path) as temporary:
        temporary.write_bytes(b"".join(parts))


def check_name(name: str) -> None:
    """Refuse a name that would not come back.

    Raises:
        InputError: It is empty, too long, or has a zero, which ends it.
    """
    if not name or "\0" in name or len(name.encode()) > LONGEST_NAME:
        raise InputError(
            f"a name in images.bin has from 1 to {LONGEST_NAME} bytes and no zero, got {name!r:.80}"
        )


@dataclass
class _Bytes:
    """A file's bytes, read from front to back and never beyond the end."""

    path: Path
    content: mmap.mmap
    at: int = 0

    def take(self, layout: struct.Struct, place: str) -> tuple[Any, ...]:
        start = self.at
        self.skip(layout.size, place)
        return layout.unpack_from(self.content, start)

    def take_name(self, place: str) -> str:
        end = self.content.find(b"\0", self.at, self.at + LONGEST_NAME + 1)
        name = self.content[self.at : max(end, self.at)]
        self.at = end + 1
        try:
            if name:
                return name.decode("utf-8")
        except UnicodeDecodeError:
            pass
        raise FileFormatError(
            f"{self.path}: {place}: no name of at most {LONGEST_NAME} bytes of text; the file is "
            "cut short, damaged or no images.bin of COLMAP"
        )

    def skip(self, size: int, place: str) -> None:
        if size > len(self.content) - self.at:
            raise FileFormatError(
                f"{self.path}: the file ends within {place}; it is cut short: copy it again"
            )
        self.at += size

    def count(self, what: str, least: int) -> int:
        """The number of records that follow, each of at least so many bytes."""
        (count,) = self.take(COUNT, "its first 8 bytes")
        room = (len(self.content) - self.at) // least
        if count > room:
            raise FileFormatError(
                f"{self.path}: it says that it holds {count} {what}, its size is enough for "
                f"{room}; it is cut short or no {what}.bin of COLMAP"
            )
        return int(count)

    def check_end(self, what: str) -> None:
        rest = len(self.content) - self.at
        if rest:
            raise FileFormatError(
                f"{self.path}: {rest} bytes are left behind the last of its {what}; it is damaged "
                f"or no {what}.bin of COLMAP"
            )


@contextmanager
def _opened(path: Path) -> Iterator[_Bytes]:
    if path.stat().st_size == 0:
        raise FileFormatError(f"{path}: the file is empty; copy or write it again")
    with (
        path.open("rb") as file,
        mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content,
    ):
        yield _Bytes(path, content)
