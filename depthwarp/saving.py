"""Writing and reading depth maps; the suffix chooses the format."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

import depthwarp
from depthwarp.cameras import Camera
from depthwarp.cameras.description import camera_from_dict, camera_to_dict
from depthwarp.checks import check_choice
from depthwarp.depth_map import DepthMap, RenderStats, State
from depthwarp.encodings import EncodingName, encode_depth, get_encoding
from depthwarp.errors import FileFormatError, InputError, MissingExtraError
from depthwarp.io.atomic import atomic_path, check_target
from depthwarp.io.npz import read_arrays

__all__ = [
    "check_output",
    "describe_depth_map",
    "load_camera",
    "load_depth_map",
    "save_depth_map",
]

SUFFIXES = (".png", ".tiff", ".tif", ".exr", ".npz")

ARRAYS = ("depth", "index", "state", "camera", "about")
"""What a depth map's NPZ holds; the last two are JSON."""

KIND, REMEDY = "a depth map's NPZ", "write it with DepthMap.save"
"""What a file that cannot be loaded ought to be, and what to do then."""


def save_depth_map(
    depth_map: DepthMap, path: str | os.PathLike[str], encoding: EncodingName | None = None
) -> None:
    """Write a depth map, and for an image the file that says how to read it; see `DepthMap.save`.

    Raises:
        InputError: An unknown suffix or encoding, a depth that the encoding cannot hold, or a file
            that cannot be written.
        MissingExtraError: `.exr` without the package OpenEXR.
    """
    path = Path(path)
    suffix = check_output(path, encoding, depth_map.max_range)
    if suffix == ".npz":
        with atomic_path(path) as temporary:
            _write_npz(temporary, depth_map)
        return
    if suffix == ".png":
        write, meaning = _png_writer(depth_map, encoding or "range16")
    else:
        write, meaning = _float_writer(depth_map, suffix)
    description = json.dumps(describe_depth_map(depth_map) | meaning, indent=2) + "\n"
    # Both files are complete before either gets its name.
    with ExitStack() as files:
        sidecar = files.enter_context(atomic_path(path.with_name(path.name + ".json")))
        image = files.enter_context(atomic_path(path))
        write(image)
        sidecar.write_text(description)


def check_output(path: Path, encoding: EncodingName | None = None, max_range: float = 15.0) -> str:
    """Return the suffix of a file that a depth map can be written to, before any work is done.

    Raises:
        InputError: An unknown suffix, an encoding that the format has no use for or that cannot
            hold `max_range`, or a folder that does not exist.
        MissingExtraError: `.exr` without the package OpenEXR.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"cannot write {path}: suffix must be one of {', '.join(SUFFIXES)}")
    if encoding is not None and suffix != ".png":
        raise InputError(f"cannot write {path}: encoding is for .png, {suffix} is float32 metres")
    if suffix == ".png":
        get_encoding(encoding or "range16", max_range)
    if suffix == ".exr":
        _import_openexr()
    check_target(path)
    return suffix


def load_camera(path: str | os.PathLike[str]) -> Camera:
    """The camera of a depth map that was saved: of its `.npz`, or of the `.json` beside its image.

    Raises:
        FileNotFoundError: There is no such file.
        FileFormatError: The file does not describe a depth map.
    """
    path = Path(path)
    if path.suffix.lower() == ".npz":
        return load_depth_map(path).camera
    try:
        return camera_from_dict(json.loads(path.read_text(encoding="utf-8"))["camera"])
    except FileNotFoundError as error:
        raise FileNotFoundError(f"{path}: there is no such file; check the name") from error
    except (KeyError, ValueError, TypeError) as error:
        raise FileFormatError(
            f"{path} does not describe a depth map ({error}): give the .json or .npz of one"
        ) from error


def load_depth_map(path: str | os.PathLike[str]) -> DepthMap:
    """Read a depth map's NPZ.

    Raises:
        FileNotFoundError: There is no such file.
        FileFormatError: The file is not a depth map's NPZ.
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: there is no such file; check the name")
    if path.suffix.lower() != ".npz":
        raise FileFormatError(f"{path} is not {KIND} (its suffix is not .npz): {REMEDY}")
    arrays = read_arrays(path, KIND, REMEDY)
    try:
        missing = [name for name in ARRAYS if name not in arrays]
        if missing:
            raise ValueError(f"no array '{missing[0]}'; it has {', '.join(arrays) or 'no arrays'}")
        about = json.loads(str(arrays["about"]))
        max_range = about["max_range_m"]
        depth_map = DepthMap(
            depth=arrays["depth"],
            index=arrays["index"],
            state=arrays["state"],
            camera=camera_from_dict(json.loads(str(arrays["camera"]))),
            kind=check_choice("depth_kind", about["depth_kind"], ("range", "z")),
            min_range=float(about["min_range_m"]),
            max_range=math.inf if max_range is None else float(max_range),
            stats=RenderStats(**about["counts"]),
            filters=tuple(str(text) for text in about["filters"]),
        )
        _check_arrays(depth_map)
    # RecursionError: JSON that is nested without end.
    except (KeyError, ValueError, TypeError, RecursionError) as error:
        raise FileFormatError(f"{path} is not {KIND} ({error}): {REMEDY}") from error
    return depth_map


def describe_depth_map(depth_map: DepthMap) -> dict[str, Any]:
    """What a reader of the file has to know, as JSON: units, kind, bounds, camera and counts."""
    height, width = depth_map.depth.shape
    return {
        "format": "depthwarp depth map",
        "version": depthwarp.__version__,
        "width": width,
        "height": height,
        "empty_value": 0,
        "depth_kind": depth_map.kind,
        "min_range_m": depth_map.min_range,
        # JSON has no infinity: null is "no bound".
        "filters": list(depth_map.filters),
        "max_range_m": depth_map.max_range if math.isfinite(depth_map.max_range) else None,
        "camera": camera_to_dict(depth_map.camera),
        "counts": dict(depth_map.stats),
        "pixels": {
            state.name.lower(): int(np.count_nonzero(depth_map.state == state)) for state in State
        },
    }


def _png_writer(
    depth_map: DepthMap, name: EncodingName
) -> tuple[Callable[[Path], None], dict[str, Any]]:
    encoding = get_encoding(name, depth_map.max_range)
    values = encode_depth(depth_map.depth, encoding)
    divisor = "" if encoding.divisor == 1 else f" * {encoding.divisor:g}"
    meaning = {
        "encoding": name,
        "dtype": "uint16",
        "depth_m": f"value / {encoding.factor:g}{divisor}",
        "metres_per_unit": encoding.divisor / encoding.factor,
    }
    return lambda file: _write_image(file, values), meaning


def _float_writer(
    depth_map: DepthMap, suffix: str
) -> tuple[Callable[[Path], None], dict[str, Any]]:
    meaning = {"encoding": "metres", "dtype": "float32", "depth_m": "value", "metres_per_unit": 1.0}
    if suffix == ".exr":
        return lambda file: _write_exr(file, depth_map.depth), meaning
    return lambda file: _write_image(file, depth_map.depth), meaning


def _write_image(file: Path, values: npt.NDArray[Any]) -> None:
    import cv2

    done, content = cv2.imencode(file.suffix, values)
    if not done:
        raise InputError(f"cannot write an image of {values.shape[1]} x {values.shape[0]} pixels")
    file.write_bytes(content.tobytes())  # not cv2.imwrite: it cannot say that the disk is full


def _import_openexr() -> Any:
    try:
        import OpenEXR  # pyright: ignore[reportMissingImports]
    except ImportError as error:
        raise MissingExtraError("writing .exr", "OpenEXR", "exr") from error
    return OpenEXR


def _write_exr(file: Path, depth: npt.NDArray[np.float32]) -> None:
    OpenEXR = _import_openexr()
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"Z": depth}) as image:
        image.write(str(file))


def _write_npz(file: Path, depth_map: DepthMap) -> None:
    with file.open("wb") as stream:
        np.savez(
            stream,
            depth=depth_map.depth,
            index=depth_map.index,
            state=depth_map.state,
            camera=np.array(json.dumps(camera_to_dict(depth_map.camera))),
            about=np.array(json.dumps(describe_depth_map(depth_map))),
        )


def _check_arrays(depth_map: DepthMap) -> None:
    size = depth_map.camera.height, depth_map.camera.width
    for name, dtype in (("depth", np.float32), ("index", np.int32), ("state", np.uint8)):
        array = getattr(depth_map, name)
        if array.shape != size or array.dtype != dtype:
            raise ValueError(
                f"{name} must be {np.dtype(dtype)} of the camera's shape {size}, "
                f"got {array.dtype} of {array.shape}"
            )
