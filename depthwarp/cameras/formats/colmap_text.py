"""COLMAP's cameras.txt and images.txt."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from depthwarp.cameras.formats.colmap_model import CameraRecord, ImageRecord, check_known_model
from depthwarp.cameras.formats.content import write_text
from depthwarp.cameras.formats.lines import (
    data_lines,
    finite_numbers,
    text_lines,
    whole_number,
)
from depthwarp.errors import FileFormatError, InputError

__all__ = [
    "NO_POINTS",
    "check_name",
    "read_cameras",
    "read_images",
    "write_cameras",
    "write_images",
]

CAMERA = "CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]"
IMAGE = "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME"
POINTS = "POINTS2D[] as X Y POINT3D_ID"

NO_POINTS = b"# Number of points: 0\n"
"""Content of a points3D.txt without a point."""


def read_cameras(path: Path) -> list[CameraRecord]:
    """Read cameras.txt.

    Raises:
        FileFormatError: A line that is no camera, an unknown model, or fewer cameras than the file
            says; the message names the line.
    """
    cameras = []
    for line, text in data_lines(path):
        words = text.split()
        if len(words) < 4:
            raise FileFormatError(
                f"{path}: line {line}: expected a camera ({CAMERA}), got {len(words)} words; the "
                "file is cut short or no cameras.txt of COLMAP"
            )
        names = check_known_model(path, f"line {line}", words[1]).parameters
        if len(words) != 4 + len(names):
            raise FileFormatError(
                f"{path}: line {line}: {words[1]} has {len(names)} parameters "
                f"({', '.join(names)}), got {len(words) - 4}; the file is cut short or damaged"
            )
        number, width, height = (
            whole_number(path, line, words[k], what)
            for k, what in ((0, "the camera's number"), (2, "the width"), (3, "the height"))
        )
        parameters = finite_numbers(path, line, words[4:], "parameters")
        cameras.append(CameraRecord(number, words[1], width, height, tuple(parameters)))
    _check_count(path, "cameras", len(cameras))
    return cameras


def read_images(path: Path) -> list[ImageRecord]:
    """Read images.txt: two lines an image, of which the second, its 2D points, is passed over.

    Raises:
        FileFormatError: A line that is no image, a second line that is no 2D points, or fewer
            images than the file says; the message names the line.
    """
    images = []
    lines = (entry for entry in text_lines(path) if not entry[1].startswith("#"))
    for line, text in lines:
        if not text:
            continue
        words = text.split(maxsplit=9)
        if len(words) < 10:
            raise FileFormatError(
                f"{path}: line {line}: expected an image ({IMAGE}), got {len(words)} words; the "
                "file is cut short or no images.txt of COLMAP"
            )
        numbers = finite_numbers(path, line, words[1:8], "quaternion and translation")
        images.append(
            ImageRecord(
                whole_number(path, line, words[0], "the image's number"),
                tuple(numbers[:4]),
                tuple(numbers[4:]),
                whole_number(path, line, words[8], "the camera's number"),
                words[9],
            )
        )
        # The last image's line of points may be missing: editors drop empty lines at the end.
        _check_points(path, *next(lines, (line + 1, "")))
    _check_count(path, "images", len(images))
    return images


def write_cameras(cameras: Sequence[CameraRecord], path: Path) -> None:
    """Write cameras.txt with all digits; the file appears whole or not at all."""
    rows = (
        " ".join([str(number), model, str(width), str(height), *map(repr, parameters)])
        for number, model, width, height, parameters in cameras
    )
    _write(path, [CAMERA, f"Number of cameras: {len(cameras)}"], rows)


def write_images(images: Sequence[ImageRecord], path: Path) -> None:
    """Write images.txt with all digits, without 2D points; the file appears whole or not at all."""
    rows = (
        " ".join([str(image.number), *map(repr, image.quaternion + image.translation)])
        + f" {image.camera} {image.name}\n"
        for image in images
    )
    _write(path, [IMAGE, POINTS, f"Number of images: {len(images)}"], rows)


def check_name(name: str) -> None:
    """Refuse a name that COLMAP would not read as it is.

    Raises:
        InputError: It is empty or has white space, at which COLMAP cuts it.
    """
    if len(name.split()) != 1 or name != name.strip() or "\0" in name:
        raise InputError(
            f"COLMAP cuts names in images.txt at white space, got {name!r}: rename it, or write "
            "binary (cameras.bin)"
        )


def _write(path: Path, comments: Iterable[str], rows: Iterable[str]) -> None:
    lines = [*(f"# {comment}" for comment in comments), *rows]
    write_text(path, "\n".join(lines) + "\n")


def _check_points(path: Path, line: int, text: str) -> None:
    """Refuse another image where the points of the one before should be: it would be lost."""
    words = text.split()
    if len(words) % 3 or not all(word.lstrip("-").isdigit() for word in words[2::3]):
        raise FileFormatError(
            f"{path}: line {line}: expected the 2D points of the image above ({POINTS}) or an "
            f"empty line, got '{text[:40]}'; each image has two lines"
        )


def _check_count(path: Path, what: str, found: int) -> None:
    """Compare with the comment that COLMAP writes: what was cut between two lines is missing."""
    for _, text in text_lines(path):
        if not text.startswith("#"):
            return
        said = re.match(rf"# *Number of {what}: *(\d{{1,18}})", text)
        if said and int(said[1]) > found:
            raise FileFormatError(
                f"{path}: it says 'Number of {what}: {said[1]}' and holds {found}; copy it again, "
                "or correct that comment if lines were left out on purpose"
            )
