"""OpenCV's calibration files: YAML, XML or JSON of `cv2.FileStorage`.

One camera, with the keys of OpenCV's calibration sample: `camera_matrix` (or `K`, `cameraMatrix`),
`distortion_coefficients` (or `D`, `distCoeffs`, `dist_coeffs`), `image_width` and `image_height`
(or `image_size`, `imageSize`: [width, height]), and `fisheye_model: 1` if the four coefficients are
those of `cv2.fisheye`. Four coefficients under `D` need `fisheye_model`, 0 or 1, for users store
both kinds so. A file without coefficients may have been cut short, and is refused.

Where the camera stands is either `optical_from_world` (4 x 4), or `R` or `rvec` with `T` or `tvec`,
or not said: then the world is the camera's own frame. Or two cameras, as of a stereo calibration:
`K1`, `D1`, `K2`, `D2` (or `M1`.., or `cameraMatrix1`, `distCoeffs1`..) with `R` and `T`, named
`camera1` and `camera2`; without R and T one of them can be read alone.

Saving takes one `PinholeCamera` (any distortion) or `FisheyeCamera`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.fisheye import FisheyeCamera
from depthwarp.cameras.formats.content import (
    beginning,
    check_intrinsics,
    content_errors,
    whole_size,
    write_text,
)
from depthwarp.cameras.formats.opencv_storage import KIND, Storage
from depthwarp.cameras.pinhole import PinholeCamera
from depthwarp.cameras.rig import Rig
from depthwarp.errors import FileFormatError, InputError

__all__ = ["CONVENTION", "NAME", "matches", "read_rig", "write_rig"]

NAME = "opencv"

CONVENTION = (
    "Optical axes (X right, Y down, Z forward), transforms from the world to these axes, for two "
    "cameras from the first to the second, whose frame is the world; pixel centres at whole "
    "numbers; the unit of translations is that of the calibration board, taken as metres; "
    "coefficients are those of cv2.calibrateCamera, or of cv2.fisheye if `fisheye_model` is 1; 4 "
    "coefficients under `D`, `D1` or `D2` need a `fisheye_model`."
)

Float64Array = npt.NDArray[np.float64]

STEREO_KEYS = (
    ("K1", "D1", "K2", "D2"),
    ("M1", "D1", "M2", "D2"),
    ("cameraMatrix1", "distCoeffs1", "cameraMatrix2", "distCoeffs2"),
)

MATRIX_KEYS = ("camera_matrix", "K", "cameraMatrix")

DISTORTION_KEYS = ("distortion_coefficients", "D", "distCoeffs", "dist_coeffs")

EITHER_KEYS = ("D", "D1", "D2")
"""Where users store the coefficients of `cv2.calibrateCamera` and those of `cv2.fisheye`."""

SIZE_KEYS = ("image_size", "imageSize")

MODEL_KEYS = ("distortion_model", "camera_model")

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


def read_rig(path: Path, size: tuple[int, int] | None = None, alone: str | None = None) -> Rig:
    """Read the one or the two cameras of a file.

    Args:
        path: The file.
        size: (width, height) [px], used if the file holds none.
        alone: Of two cameras without R and T between them, the one to read; its world is its own
            optical frame.

    Raises:
        InputError: Neither the file nor `size` says how large the image is.
        FileFormatError: The file was cut short, an entry is missing or cannot be used, the lens
            model is unknown, or nothing says where two cameras stand.
    """
    with content_errors(path, KIND):
        file = Storage(path)
        model = _model(file, path)
        lenses = _lenses(file)
        own_size = _size(file)
        transforms: list[Float64Array | None] = [None] * (len(lenses) - 1)
        if len(lenses) == 1 or ("R" in file and "T" in file):
            transforms.append(_optical_from_world(file))
        elif alone in lenses:
            lenses = {alone: lenses[alone]}
        else:
            raise FileFormatError(
                f"{path} holds two cameras, but not R and T between them: copy both from the "
                "file of extrinsics, which cv2.stereoCalibrate gave as well, or load one alone by "
                f"its name, {' or '.join(lenses)}"
            )
    image_size = own_size or size
    if image_size is None:
        raise InputError(
            f"{path} holds no image_width and image_height: give size=(width, height) [px]"
        )
    with content_errors(path, KIND):
        cameras = [
            model.from_matrix(matrix, image_size, coefficients, transform)
            for (matrix, coefficients), transform in zip(lenses.values(), transforms, strict=True)
        ]
    return Rig(tuple(lenses), tuple(cameras))


def _lenses(file: Storage) -> dict[str, tuple[Float64Array, Sequence[float]]]:
    """Matrix and coefficients of each camera, by name, checked as far as no size is needed."""
    pair = next((keys for keys in STEREO_KEYS if keys[0] in file and keys[2] in file), None)
    if pair is None:
        lenses = {"camera": (file.matrix(*MATRIX_KEYS), _distortion(file, *DISTORTION_KEYS))}
    else:
        lenses = {
            f"camera{k + 1}": (file.matrix(pair[2 * k]), _distortion(file, pair[2 * k + 1]))
            for k in range(2)
        }
    for matrix, _ in lenses.values():
        check_intrinsics(matrix)
    return lenses


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


def _model(file: Storage, path: Path) -> type[PinholeCamera] | type[FisheyeCamera]:
    if "xi" in file:
        raise FileFormatError(
            f"{path}: the entry xi says that the lens is of cv2.omnidir's model, which depthwarp "
            "does not have; calibrate it as cv2.fisheye"
        )
    for key in MODEL_KEYS:
        if key in file:
            name = file.node(key).string()
            if name not in MODELS:
                raise FileFormatError(
                    f"{path}: unknown {key} '{name}'; known are {', '.join(MODELS)}"
                )
            return MODELS[name]
    is_fisheye = "fisheye_model" in file and file.number("fisheye_model") != 0
    return FisheyeCamera if is_fisheye else PinholeCamera


def _size(file: Storage) -> tuple[int, int] | None:
    if "image_width" not in file and "image_height" not in file:
        key = next((key for key in SIZE_KEYS if key in file), None)
        if key is None:
            return None
        sides = file.matrix(key).ravel().tolist()
        if len(sides) != 2:
            raise ValueError(f"{key} must be [width, height], got {len(sides)} numbers")
        return whole_size(*sides)
    return whole_size(file.number("image_width"), file.number("image_height"))


def _distortion(file: Storage, *keys: str) -> Sequence[float]:
    """The coefficients under one of some keys.

    Raises:
        InputError: There are none, or four of which nothing says of which model they are.
    """
    key = next((key for key in keys if key in file), None)
    if key is None:
        raise InputError(
            f"there is no {' or '.join(keys)}: the file may be cut short; for an ideal lens add "
            f"the line '{keys[0]}: [0, 0, 0, 0, 0]'"
        )
    coefficients: list[float] = file.matrix(key).ravel().tolist()
    is_said = any(name in file for name in ("fisheye_model", *MODEL_KEYS))
    if key in EITHER_KEYS and len(coefficients) == 4 and not is_said:
        raise InputError(
            f"{key} has 4 coefficients, of cv2.calibrateCamera or of cv2.fisheye: add the line "
            "'fisheye_model: 0' for the former, 'fisheye_model: 1' for the latter"
        )
    return coefficients


def _optical_from_world(file: Storage) -> Float64Array | None:
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
