"""What formats of cameras share: looking into files, errors that name them, whole files."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.camera import Camera
from depthwarp.cameras.pinhole import PinholeCamera, intrinsics_of
from depthwarp.checks import check_positive, check_size
from depthwarp.errors import FileFormatError, InputError

__all__ = [
    "beginning",
    "check_intrinsics",
    "content_errors",
    "ideal_pinhole",
    "read_json",
    "whole_size",
    "write_text",
]

BEGINNING = 4096
"""Bytes of a file that `matches` looks at."""


def beginning(path: Path) -> str:
    """The first `BEGINNING` bytes of a text file; empty for folders and binary files."""
    if not path.is_file():
        return ""
    with path.open("rb") as stream:
        # A cut in the middle of a character is no sign of a binary file.
        text = stream.read(BEGINNING).decode("utf-8-sig", errors="replace")
    return "" if "\0" in text else text


def read_json(path: Path, kind: str) -> Any:
    """The content of a JSON file.

    Raises:
        FileFormatError: It is not JSON, for example because it was cut short.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"))
    # RecursionError: JSON that is nested without end.
    except (ValueError, RecursionError) as error:
        raise FileFormatError(
            f"{path} is not {kind}: not whole JSON ({error}); copy or write it again"
        ) from error


@contextmanager
def content_errors(path: Path, kind: str) -> Iterator[None]:
    """Name the file in every error that its content causes.

    Raises:
        FileFormatError: In place of InputError and of what missing or wrong entries raise.
    """
    try:
        yield
    except FileFormatError:
        raise
    except KeyError as error:
        raise FileFormatError(f"{path} is not {kind}: it has no entry {error}") from error
    except InputError as error:
        raise FileFormatError(f"{path}: {error}") from error
    except (ValueError, TypeError, AttributeError, IndexError) as error:
        raise FileFormatError(f"{path} is not {kind} ({error})") from error


def ideal_pinhole(camera: Camera, where: str) -> PinholeCamera:
    """The camera, if a format that has nothing but ideal pinholes can describe it.

    Raises:
        InputError: Another model, or lens distortion.
    """
    if not isinstance(camera, PinholeCamera):
        raise InputError(f"{where} has no model for a {type(camera).__name__}; use another format")
    if camera.distortion:
        raise InputError(
            f"{where} has no lens distortion, the camera has {camera.distortion}; use format="
            "'opencv', 'colmap' or 'nerfstudio'"
        )
    return camera


def check_intrinsics(matrix: npt.NDArray[np.float64]) -> tuple[float, float, float, float]:
    """fx, fy, cx, cy [px] of a camera matrix, shape (3, 3), before a size is known.

    Raises:
        InputError: Another shape, skew, numbers that are not finite, or a focal length not above 0.
    """
    fx, fy, cx, cy = map(float, intrinsics_of(matrix))
    check_positive("fx", fx, "pixels")
    check_positive("fy", fy, "pixels")
    return fx, fy, cx, cy


def whole_size(width: float, height: float) -> tuple[int, int]:
    """Size (width, height) [px] of numbers in a file.

    Raises:
        InputError: They are not whole numbers above 0.
    """
    return check_size((width, height))  # type: ignore[arg-type]


def write_text(path: Path, text: str) -> None:
    """Write a text file, which appears whole or not at all.

    Raises:
        InputError: A path that cannot be written.
    """
    from depthwarp.io.atomic import atomic_path

    with atomic_path(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="\n")
