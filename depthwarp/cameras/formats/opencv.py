"""OpenCV's calibration files: YAML, XML or JSON of `cv2.FileStorage`.

One camera, with the keys of OpenCV's calibration sample: `camera_matrix` (or `K`),
`distortion_coefficients` (or `D`), `image_width`, `image_height`, and `fisheye_model: 1` if the
four coefficients are those of `cv2.fisheye`. Where the camera stands is either
`optical_from_world` (4 x 4), or `R` or `rvec` with `T` or `tvec`, or not said: then the world is
the camera's own frame. Or two cameras, as of a stereo calibration: `K1`, `D1`, `K2`, `D2` (or
`M1`.., or `cameraMatrix1`, `distCoeffs1`..) with `R` and `T`, named `camera1` and `camera2`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.camera import Camera
from depthwarp.cameras.fisheye import FisheyeCamera
from depthwarp.cameras.formats.content import beginning, content_errors, whole_size, write_text
from depthwarp.cameras.pinhole import PinholeCamera
from depthwarp.cameras.rig import Rig
from depthwarp.errors import FileFormatError, InputError

__all__ = ["CONVENTION", "NAME", "matches", "read_rig", "write_rig"]

NAME = "opencv"

CONVENTION = (
    "Optical axes (X right, Y down, Z forward), transforms from the world to these axes, for two "
    "cameras from the first to the second, whose frame is the world; pixel centres at whole "
    "numbers; the unit of translations is that of the calibration board, taken as metres."
)

KIND = "an OpenCV calibration"

Float64Array = npt.NDArray[np.float64]

STEREO_KEYS = (
    ("K1", "D1", "K2", "D2"),
    ("M1", "D1", "M2", "D2"),
    ("cameraMatrix1", "distCoeffs1", "cameraMatrix2", "distCoeffs2"),
)

MODELS: dict[str, type[PinholeCamera] | type[FisheyeCamera]] = {
    "pinhole": PinholeCamera,
    "plumb_bob": PinholeCamera,
    "rational_polynomial": PinholeCamera,
    "fisheye": FisheyeCamera,
    "equidistant": FisheyeCamera,
}
"""What a text under `camera_model` or `distortion_model` means; OpenCV itself writes none."""


def matches(path: Path) -> bool:
    """Whether the file begins as those that `cv2.FileStorage` writes, and holds a matrix."""
    text = beginning(path)
    begins = text.lstrip().startswith(("%YAML", "<?xml", "<opencv_storage", "{"))
    return begins and "opencv-matrix" in text


def read_rig(path: Path, size: tuple[int, int] | None = None) -> Rig:
    """Read the one or the two cameras of a file.

    Args:
        path: The file.
        size: (width, height) [px], used if the file holds none.

    Raises:
        InputError: Neither the file nor `size` says how large the image is.
        FileFormatError: The file was cut short, an entry is missing or cannot be used, or the lens
            model is unknown.
    """
    with content_errors(path, KIND):
        file = _Storage(path)
        model = _model(file, path)
        own_size = _size(file)
    image_size = own_size or size
    if image_size is None:
        raise InputError(
            f"{path} holds no image_width and image_height: give size=(width, height) [px]"
        )
    with content_errors(path, KIND):
        pair = next((keys for keys in STEREO_KEYS if keys[0] in file and keys[2] in file), None)
        if pair is None:
            camera = model.from_matrix(
                file.matrix("camera_matrix", "K"),
                image_size,
                _distortion(file, "distortion_coefficients", "D"),
                _optical_from_world(file),
            )
            return Rig.of({"camera": camera})
        if not ("R" in file and "T" in file):
            raise FileFormatError(
                f"{path} holds two cameras, but not R and T between them: copy both from the "
                "file of extrinsics, which cv2.stereoCalibrate gave as well"
            )
        transforms: list[Float64Array | None] = [None, _optical_from_world(file)]
        cameras: list[Camera] = [
            model.from_matrix(
                file.matrix(pair[2 * k]), image_size, _distortion(file, pair[2 * k + 1]), transform
            )
            for k, transform in enumerate(transforms)
        ]
    return Rig(("camera1", "camera2"), tuple(cameras))


def write_rig(rig: Rig, path: Path) -> None:
    """Write one camera with its pose; the suffix, .yaml, .yml, .xml or .json, chooses the syntax.

    Raises:
        InputError: Several cameras, a model that OpenCV does not have, an unknown suffix, or a path
            that cannot be written.
    """
    import cv2

    suffix = path.suffix.lower()
    if suffix not in (".yaml", ".yml", ".xml", ".json"):
        raise InputError(f"cannot write {path}: suffix must be one of .yaml, .yml, .xml, .json")
    if len(rig) != 1:
        raise InputError(
            f"cannot write {path}: an OpenCV calibration holds one camera, the rig has {len(rig)}; "
            "write each to a file of its own"
        )
    camera = rig.cameras[0]
    if not isinstance(camera, PinholeCamera | FisheyeCamera):
        raise InputError(
            f"cannot write {path}: OpenCV has no model for a {type(camera).__name__}; it has "
            "PinholeCamera and FisheyeCamera"
        )
    file = cv2.FileStorage(suffix, cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY)
    file.write("image_width", camera.width)
    file.write("image_height", camera.height)
    file.write("fisheye_model", int(isinstance(camera, FisheyeCamera)))
    # The coefficients last: a file that was cut short lacks them, and is refused.
    file.write("optical_from_world", camera.pose.optical_from_world)
    file.write("camera_matrix", camera.K)
    file.write("distortion_coefficients", np.array([camera.distortion or (0.0,) * 5]))
    write_text(path, file.releaseAndGetString())


class _Storage:
    """The top of a `cv2.FileStorage`, whose errors say which entry is wrong."""

    def __init__(self, path: Path) -> None:
        import cv2

        flags = cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY
        try:
            self.storage = cv2.FileStorage(path.read_text(encoding="utf-8-sig"), flags)
            self.keys = tuple(self.storage.root().keys())
        # SystemError: what cv2 5 raises for text that it cannot parse.
        except (cv2.error, SystemError) as error:
            raise FileFormatError(
                f"{path} is not {KIND}: cv2.FileStorage cannot read it; copy or write it again if "
                "it was cut short"
            ) from error

    def __contains__(self, key: str) -> bool:
        return key in self.keys

    def node(self, *keys: str) -> Any:
        """The entry under the first of some keys that the file has."""
        found = next((key for key in keys if key in self), None)
        if found is None:
            raise KeyError(" or ".join(keys))
        return self.storage.getNode(found)

    def matrix(self, *keys: str) -> Float64Array:
        """A matrix of numbers, shape (rows, columns), float64."""
        node, name = self.node(*keys), " or ".join(keys)
        # Not node.mat(): on a damaged file that can end the program.
        if not node.isMap():
            raise ValueError(f"{name} is not a matrix")
        shape = tuple(int(side.real()) for side in self._sides(node))
        values = _items(node.getNode("data"))
        if len(values) != np.prod(shape) or not all(v.isInt() or v.isReal() for v in values):
            raise ValueError(f"{name} does not hold {' x '.join(map(str, shape))} numbers")
        return np.array([value.real() for value in values], dtype=np.float64).reshape(shape)

    def _sides(self, node: Any) -> list[Any]:
        """Rows and cols of a matrix, or its sizes, as cv2 5 writes those of a vector."""
        sides = _items(node.getNode("sizes")) or [node.getNode("rows"), node.getNode("cols")]
        if not all(side.isInt() and side.real() >= 0 for side in sides):
            raise ValueError("a matrix without whole numbers of rows and columns")
        return sides

    def number(self, *keys: str) -> float:
        """A number."""
        node = self.node(*keys)
        if not (node.isInt() or node.isReal()):
            raise ValueError(f"{' or '.join(keys)} is not a number")
        return float(node.real())


def _items(node: Any) -> list[Any]:
    """The items of a sequence; one number alone is a sequence too: XML does not tell them apart."""
    if node.isSeq():
        return [node.at(k) for k in range(node.size())]
    return [node] if node.isInt() or node.isReal() else []


def _model(file: _Storage, path: Path) -> type[PinholeCamera] | type[FisheyeCamera]:
    if "xi" in file:
        raise FileFormatError(
            f"{path}: the entry xi says that the lens is of cv2.omnidir's model, which depthwarp "
            "does not have; calibrate it as cv2.fisheye"
        )
    for key in ("distortion_model", "camera_model"):
        if key in file:
            name = file.node(key).string()
            if name not in MODELS:
                raise FileFormatError(
                    f"{path}: unknown {key} '{name}'; known are {', '.join(MODELS)}"
                )
            return MODELS[name]
    is_fisheye = "fisheye_model" in file and file.number("fisheye_model") != 0
    return FisheyeCamera if is_fisheye else PinholeCamera


def _size(file: _Storage) -> tuple[int, int] | None:
    if "image_width" not in file and "image_height" not in file:
        return None
    return whole_size(file.number("image_width"), file.number("image_height"))


def _distortion(file: _Storage, *keys: str) -> Sequence[float]:
    coefficients: list[float] = file.matrix(*keys).ravel().tolist()
    return coefficients


def _optical_from_world(file: _Storage) -> Float64Array | None:
    """The transform of the file; None if it has none."""
    if "optical_from_world" in file:
        return file.matrix("optical_from_world")
    rotations = [key for key in ("R", "rvec") if key in file]
    translations = [key for key in ("T", "tvec") if key in file]
    if not (rotations or translations):
        return None
    if not (rotations and translations):
        raise KeyError("T or tvec" if rotations else "R or rvec")
    rotation, translation = file.matrix(rotations[0]), file.matrix(translations[0])
    if rotation.size == 3:
        import cv2

        rotation = np.asarray(cv2.Rodrigues(rotation.reshape(3, 1))[0], dtype=np.float64)
    if rotation.shape != (3, 3) or translation.size != 3:
        raise ValueError(
            f"{rotations[0]} and {translations[0]} must be a rotation and 3 numbers, got "
            f"{rotation.size} and {translation.size} numbers"
        )
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = rotation, translation.ravel()
    return transform
