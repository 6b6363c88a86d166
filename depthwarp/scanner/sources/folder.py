"""Frames from a folder of image files, one file a trigger."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from depthwarp.errors import FileFormatError, InputError
from depthwarp.scanner.frames import (
    DeviceLostError,
    Frame,
    FrameError,
    IncompleteFrameError,
    PixelFormat,
    SourceInfo,
)
from depthwarp.scanner.sources.base import UprightSource

__all__ = ["SIDECAR", "FolderSource"]

SUFFIXES = (".png", ".tif", ".tiff", ".bmp")
"""Lossless kinds of file: what a camera's numbers survive in."""

SIDECAR = "frames.json"
"""Says how the images of its folder are meant: `{"pixel_format": "bayer_rggb", "bits": 12}`."""

Image = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


class FolderSource(UprightSource):
    """Images of a folder in the order of their names, as a camera that was there wrote them.

    The order is that of the plain strings, as the emulation of Basler's SDK has it; names whose
    numbers would come out of order (`f10` before `f2`) are refused. A file `frames.json` beside
    the images may say how they are meant; arguments go before it. Without either, grey images are
    monochrome with all their 8 or 16 bits, and colour images are BGR.

    Args:
        folder: Where the images are: PNG, TIFF or BMP, all of one size and kind.
        rotation: How far the camera was rolled, clockwise seen from behind it [degrees].
        pixel_format: What the numbers in the files are, before any turn.
        bits: Significant bits of a number.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        *,
        rotation: int = 0,
        pixel_format: PixelFormat | None = None,
        bits: int | None = None,
    ) -> None:
        self.folder = Path(folder)
        super().__init__(f"image folder {self.folder}", rotation)
        self._wanted_format, self._wanted_bits = pixel_format, bits
        self._files: list[Path] = []
        self._position = 0
        self._shape: tuple[int, ...] = ()
        self._dtype: np.dtype[np.uint8] | np.dtype[np.uint16] = np.dtype(np.uint8)
        self._bits = 8

    def open(self) -> SourceInfo:
        """List the images and look at the first.

        Raises:
            InputError: No such folder, no image in it, names out of order, or an image that is
                not of the kind that the arguments or the sidecar say.
        """
        if self._info is not None:
            return self._info
        self._files = _listed(self.folder)
        self._position = 0
        first = self._files[0]
        try:
            image = _read_image(first)
        except FrameError as error:
            raise FileFormatError(str(error)) from error
        pixel_format, self._bits = self._meaning(first, image)
        self._shape, self._dtype = image.shape, image.dtype
        height, width = image.shape[:2]
        return self._opened_as(
            name="image folder",
            serial=str(self.folder),
            raw_size=(width, height),
            raw_format=pixel_format,
            is_emulated=True,
        )

    def close(self) -> None:
        """Forget the list of files."""
        self._info = None
        self._files = []

    def configure(self, exposure_us: float, gain_db: float) -> None:
        """Do nothing: the pictures are taken; their frames say NaN for exposure and gain."""
        self._require_open()

    def grab(self, timeout_s: float) -> Frame:
        """Read the next image; a damaged one is passed by, so that the next grab goes on.

        Raises:
            IncompleteFrameError: The file is damaged, or of another size or kind than the first.
            DeviceLostError: There are no more.
        """
        self._require_open()
        if self._position == len(self._files):
            raise DeviceLostError(
                f"no more frames: {self.label} ended after {len(self._files)} images"
            )
        path = self._files[self._position]
        self._position += 1
        image = _read_image(path)
        if (image.shape, image.dtype) != (self._shape, self._dtype):
            raise IncompleteFrameError(
                f"{path} holds {_described(image.shape, image.dtype)}, but the first image of "
                f"the folder holds {_described(self._shape, self._dtype)}: take the odd one out"
            )
        if self._bits < 8 * image.dtype.itemsize and image.max() >= 1 << self._bits:
            raise IncompleteFrameError(
                f"{path} holds the number {image.max()}, more than {self._bits} bits can: correct "
                f"'bits' (argument or {SIDECAR})"
            )
        return self._upright_frame(image, self._bits)

    def _meaning(self, path: Path, image: Image) -> tuple[PixelFormat, int]:
        """Format and bits of the images: by argument, by sidecar, or by the image itself."""
        said_format, said_bits = _read_sidecar(self.folder / SIDECAR)
        is_colour = image.ndim == 3
        default = PixelFormat.BGR if is_colour else PixelFormat.MONO
        pixel_format = self._wanted_format or said_format or default
        most = 8 * image.dtype.itemsize
        bits = next(b for b in (self._wanted_bits, said_bits, most) if b is not None)
        if (pixel_format is PixelFormat.BGR) != is_colour:
            raise InputError(
                f"{path} holds {_described(image.shape, image.dtype)}, which cannot be "
                f"{pixel_format}: correct 'pixel_format' (argument or {SIDECAR})"
            )
        if not most - 8 < bits <= most:
            raise InputError(
                f"{path} holds {image.dtype} numbers, of which {bits} bits cannot be the "
                f"significant ones: correct 'bits' (argument or {SIDECAR})"
            )
        return pixel_format, bits


def _listed(folder: Path) -> list[Path]:
    """The images of a folder in the order of their names."""
    if not folder.is_dir():
        raise InputError(f"there is no folder {folder}: give the folder that holds the images")
    try:
        files = sorted(
            (path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES),
            key=lambda path: path.name,
        )
    except OSError as error:
        raise InputError(f"cannot list the folder {folder}: {error.strerror}") from error
    if not files:
        raise InputError(
            f"the folder {folder} holds no images: expected files named *{', *'.join(SUFFIXES)}"
        )
    for before, after in zip(files, files[1:], strict=False):
        if _by_number(before.name) > _by_number(after.name):
            raise InputError(
                f"in the folder {folder} '{before.name}' comes before '{after.name}', so the "
                "images would be out of order: rename them with leading zeros"
            )
    return files


def _by_number(name: str) -> list[tuple[int, str]]:
    """A sorting key that counts runs of digits as numbers, as people read them."""
    parts = re.findall(r"([0-9]+)|([^0-9]+)", name)
    return [(int(digits), "") if digits else (-1, text) for digits, text in parts]


def _read_image(path: Path) -> Image:
    """Decode one image as it is stored, shape (H, W) or (H, W, 3)."""
    try:
        data = np.fromfile(path, np.uint8)
    except OSError as error:
        raise IncompleteFrameError(f"cannot read the image {path}: {error.strerror}") from error
    image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED) if data.size else None
    if image is None:
        raise IncompleteFrameError(
            f"the image {path} is damaged or cut short ({data.size} bytes): copy it again"
        )
    if image.dtype not in (np.uint8, np.uint16) or image.shape[2:] not in ((), (3,)):
        raise IncompleteFrameError(
            f"the image {path} holds {_described(image.shape, image.dtype)}: only grey or "
            "three-colour images of 8 or 16 bits can be frames"
        )
    return image  # type: ignore[return-value]


def _read_sidecar(path: Path) -> tuple[PixelFormat | None, int | None]:
    """Pixel format and bits that a sidecar gives; None for what it does not."""
    if not path.exists():
        return None, None
    try:
        said = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise FileFormatError(f"cannot read {path}: {error}") from error
    if not isinstance(said, dict) or not said.keys() <= {"pixel_format", "bits"}:
        raise FileFormatError(
            f"{path} must hold an object with 'pixel_format' and 'bits', got {said!r}"
        )
    name, bits = said.get("pixel_format"), said.get("bits")
    if name is not None and name not in list(PixelFormat):
        raise FileFormatError(
            f"{path}: pixel_format must be one of {', '.join(PixelFormat)}, got {name!r}"
        )
    if bits is not None and (type(bits) is not int or not 1 <= bits <= 16):
        raise FileFormatError(f"{path}: bits must be a whole number from 1 to 16, got {bits!r}")
    return None if name is None else PixelFormat(name), bits


def _described(shape: tuple[int, ...], dtype: np.dtype[np.generic]) -> str:
    kind = "grey" if len(shape) == 2 else f"{shape[2]}-channel"
    return f"a {shape[1]} x {shape[0]} {kind} {dtype} image"
