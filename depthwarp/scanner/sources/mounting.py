"""How the camera is mounted, and how its raw pictures become upright without losing a bit."""

from __future__ import annotations

from typing import Final

import cv2
import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError
from depthwarp.scanner.frames import PixelFormat

__all__ = ["check_rotation", "upright_format", "upright_pixels", "upright_size"]

Pixels = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

CLOCKWISE: Final = {
    90: cv2.ROTATE_90_CLOCKWISE,
    180: cv2.ROTATE_180,
    270: cv2.ROTATE_90_COUNTERCLOCKWISE,
}


def check_rotation(rotation: int) -> int:
    """Return how far the camera is rolled [degrees], clockwise seen from behind it.

    A camera rolled clockwise sees the scene turned counter-clockwise, so a raw picture becomes
    upright when it is turned clockwise by the same angle.

    Raises:
        InputError: Not 0, 90, 180 or 270.
    """
    if rotation not in (0, *CLOCKWISE):
        raise InputError(
            "rotation must be 0, 90, 180 or 270 degrees (how far the camera is rolled clockwise, "
            f"seen from behind), got {rotation!r}"
        )
    return int(rotation)


def upright_pixels(raw: Pixels, rotation: int) -> Pixels:
    """Turn a raw picture, shape (H, W) or (H, W, 3), clockwise by `rotation` degrees."""
    if rotation == 0:
        return raw
    return cv2.rotate(raw, CLOCKWISE[rotation])  # type: ignore[return-value]


def upright_size(raw_size: tuple[int, int], rotation: int) -> tuple[int, int]:
    """Size (width, height) [px] of the upright picture of a raw one of `raw_size`."""
    width, height = raw_size
    return (height, width) if rotation in (90, 270) else (width, height)


def upright_format(
    pixel_format: PixelFormat, raw_size: tuple[int, int], rotation: int
) -> PixelFormat:
    """Format of the upright picture; a Bayer pattern changes its name with the turn.

    Which colour comes to the upper left depends on whether the raw sides are odd or even.

    Args:
        pixel_format: Format of the raw picture.
        raw_size: (width, height) of the raw picture [px].
        rotation: Clockwise turn that makes it upright [degrees].
    """
    if not pixel_format.is_bayer:
        return pixel_format
    # The smallest picture with the same pattern and the same odd or even sides, turned alike.
    width, height = raw_size
    columns, rows = 2 + width % 2, 2 + height % 2
    colours = np.array(list(pixel_format.value.removeprefix("bayer_"))).reshape(2, 2)
    mosaic = np.tile(colours, (2, 2))[:rows, :columns]
    turned = np.rot90(mosaic, -(rotation // 90))
    return PixelFormat("bayer_" + "".join(turned[:2, :2].ravel()))
