"""Point clouds in files: one module a format, chosen by the suffix."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterable
from pathlib import Path

from depthwarp.cloud import PointCloud
from depthwarp.errors import CapacityError, FileFormatError, InputError
from depthwarp.io.atomic import check_target
from depthwarp.io.columns import Offset
from depthwarp.io.kitti import read_kitti
from depthwarp.io.npz import read_npz, write_npz
from depthwarp.io.pcd import read_pcd
from depthwarp.io.ply import read_ply, write_ply
from depthwarp.io.text import read_pts, read_text

__all__ = ["READERS", "WRITERS", "check_writable", "read", "write"]

READERS: dict[str, Callable[[Path, Offset | None], PointCloud]] = {
    ".ply": read_ply,
    ".pcd": read_pcd,
    ".xyz": read_text,
    ".txt": read_text,
    ".csv": read_text,
    ".pts": read_pts,
    ".npz": read_npz,
    ".bin": read_kitti,
}
"""The reader of each suffix."""

WRITERS: dict[str, Callable[[PointCloud, Path], None]] = {
    ".ply": write_ply,
    ".npz": write_npz,
}
"""The writer of each suffix."""


def read(path: str | os.PathLike[str], *, offset: Offset | None = None) -> PointCloud:
    """Read a point cloud; the suffix chooses the format.

    Points that are not finite are kept, in the file's order. Colour is uint8; floating-point
    and 16-bit colour keep their values. Times stay in the file's unit.

    Args:
        path: A .ply, .pcd, .xyz, .txt, .csv, .pts, .npz or KITTI .bin file.
        offset: x, y, z [m] to subtract in float64 before coordinates become float32, for map
            coordinates such as UTM. The cloud is then relative to that place.

    Returns:
        The points and every attribute that the file has, by name.

    Raises:
        FileNotFoundError: There is no such file.
        InputError: An unknown suffix, a folder, or coordinates so large that float32 would move a
            point by more than 1 mm.
        FileFormatError: The content is not what the suffix or the header says.
        CapacityError: The cloud does not fit the memory.

    Example:
        >>> import depthwarp as dw
        >>> cloud = dw.read("survey.ply", offset=(500_000, 5_400_000, 0))  # doctest: +SKIP
    """
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: there is no such file; check the name and the folder")
    if path.is_dir():
        raise InputError(f"{path}: a folder; give the name of a point cloud file in it")
    reader = READERS.get(path.suffix.lower())
    if reader is None:
        raise InputError(_unknown_suffix("read", path, READERS))
    if path.stat().st_size == 0:
        raise FileFormatError(f"{path}: the file is empty (0 bytes); copy or write it again")
    if offset is not None and (len(offset) != 3 or not all(map(math.isfinite, offset))):
        raise InputError(f"offset must be three finite numbers x, y, z [m], got {offset}")
    try:
        return reader(path, offset)
    except CapacityError:
        raise
    except MemoryError as error:
        raise CapacityError(
            f"{path}: {path.stat().st_size / 1e9:.3g} GB of points do not fit the memory; split "
            "the file"
        ) from error


def write(cloud: PointCloud, path: str | os.PathLike[str]) -> None:
    """Write a point cloud with its attributes; the suffix, .ply or .npz, chooses the format.

    The file appears whole or not at all.

    Raises:
        InputError: An unknown suffix, an attribute that the format cannot hold, or a path that
            cannot be written.
    """
    path = Path(path)
    check_writable(path)
    WRITERS[path.suffix.lower()](cloud, path)


def check_writable(path: Path) -> None:
    """Refuse a name that a cloud cannot be written to, before any work is done.

    Raises:
        InputError: An unknown suffix, or a folder that does not exist.
    """
    if path.suffix.lower() not in WRITERS:
        raise InputError(_unknown_suffix("write", path, WRITERS))
    check_target(path)


def _unknown_suffix(verb: str, path: Path, known: Iterable[str]) -> str:
    return f"cannot {verb} {path}: unknown suffix '{path.suffix}'; known are {', '.join(known)}"
