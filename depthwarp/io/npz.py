"""NPZ, NumPy's zipped arrays: `points` and one array for each attribute."""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np
import numpy.typing as npt
from numpy.lib import format as npy

from depthwarp.cloud import PointCloud
from depthwarp.errors import FileFormatError, InputError
from depthwarp.io.atomic import atomic_path
from depthwarp.io.columns import Offset, points_from_columns

__all__ = ["read_arrays", "read_npz", "write_npz"]

MEMBER_SUFFIX = ".npy"

# Version 3 is for structured arrays, which no attribute is.
HEADER_READERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def read_npz(path: Path, offset: Offset | None) -> PointCloud:
    """Read a cloud's NPZ: `points`, shape (N, 3), and arrays of N rows, the attributes.

    Raises:
        FileFormatError: A damaged archive, no `points`, an array with another number of rows, or
            one of Python objects (reading those could run code).
        InputError: Coordinates that float32 would move by more than 1 mm.
    """
    arrays = read_arrays(path, "a readable NPZ archive", "copy the file again")
    if "points" not in arrays:
        raise FileFormatError(
            f"{path}: no array 'points'; it has {', '.join(arrays) or 'no arrays'}"
        )
    points = arrays.pop("points")
    if points.ndim != 2 or points.shape[1] != 3:
        raise FileFormatError(f"{path}: points must have shape (N, 3), got {points.shape}")
    for name, values in arrays.items():
        if values.ndim == 0 or len(values) != len(points):
            raise FileFormatError(
                f"{path}: array '{name}' must have {len(points)} rows, one a point, got shape "
                f"{values.shape}; an NPZ that holds more than a cloud cannot be read as one"
            )
    columns = [points[:, axis] for axis in range(3)]
    return PointCloud(points_from_columns(columns, path, offset), arrays)


def write_npz(cloud: PointCloud, path: Path) -> None:
    """Write a cloud as an uncompressed NPZ, which keeps every dtype.

    Raises:
        InputError: An attribute of Python objects, or a path that cannot be written.
    """
    # Not np.savez: it takes no array that is called 'file'.
    with atomic_path(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        for name, values in {"points": cloud.points_world, **cloud.attributes}.items():
            if values.dtype.hasobject:
                raise InputError(
                    f"cannot write {path}: attribute '{name}' holds Python objects; make it numbers"
                )
            with archive.open(name + MEMBER_SUFFIX, "w", force_zip64=True) as member:
                npy.write_array(member, values, allow_pickle=False)


def read_arrays(path: Path, kind: str, remedy: str) -> dict[str, npt.NDArray[Any]]:
    """Read every array of an NPZ.

    Args:
        path: File to read.
        kind: What the file ought to be, for the message when it is not.
        remedy: What to do then.

    Returns:
        The arrays by their names, in the machine's byte order.

    Raises:
        FileFormatError: A damaged archive, or a member that is no array or one of Python objects.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            return {
                member.filename.removesuffix(MEMBER_SUFFIX): _array(
                    archive.read(member), member.filename, path
                )
                for member in archive.infolist()
            }
    except FileFormatError:
        raise
    # What zipfile raises for damage: encrypted or unknown methods are a RuntimeError.
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, ValueError) as error:
        raise FileFormatError(f"{path} is not {kind} ({error}): {remedy}") from error


def _array(data: bytes, name: str, path: Path) -> npt.NDArray[Any]:
    """The array of one member, its header checked against the bytes before memory is set aside."""
    stream = io.BytesIO(data)
    try:
        shape, is_fortran, dtype = HEADER_READERS[npy.read_magic(stream)](stream)
    # What the parser of the header's Python literal raises when someone has tampered with it.
    except (KeyError, ValueError, TypeError, SyntaxError, TokenError, RecursionError) as error:
        raise FileFormatError(f"{path}: {name} is not a NumPy array ({error})") from error
    if dtype.hasobject:
        raise FileFormatError(
            f"{path}: {name} holds Python objects, which are not read because they can run code; "
            "save the array as numbers"
        )
    claimed, present = math.prod(shape) * dtype.itemsize, len(data) - stream.tell()
    if claimed != present or min(shape, default=0) < 0:
        raise FileFormatError(
            f"{path}: the header of {name} claims shape {shape} ({claimed} bytes), the file "
            f"holds {present}; it is damaged: write it again"
        )
    flat = np.frombuffer(data, dtype, offset=stream.tell())
    array = flat.reshape(shape, order="F" if is_fortran else "C")
    return array.astype(dtype.newbyteorder("="), order="C")  # a copy: `data` is read-only
