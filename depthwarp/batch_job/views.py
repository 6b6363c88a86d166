"""The views of a batch: lenses, poses and names, read from a file of poses or of cameras."""

from __future__ import annotations

import hashlib
import importlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.batch_job.poses import (
    CSV_COLUMNS,
    NPZ_ARRAY,
    PoseTable,
    csv_poses,
    npz_poses,
    table_of,
)
from depthwarp.cameras import Camera, Pose
from depthwarp.cameras.description import camera_to_dict
from depthwarp.cameras.formats import FORMATS, TRAJECTORIES, load_rig, load_trajectory
from depthwarp.cameras.formats.content import beginning
from depthwarp.cameras.rig import Rig
from depthwarp.errors import FileFormatError, InputError

__all__ = ["Views", "lens_to_dict", "read_views"]

KNOWN = (
    "; ".join([*TRAJECTORIES.values(), *FORMATS.values()])
    + f"; .csv with the columns {','.join(CSV_COLUMNS)}; .npz with {NPZ_ARRAY} (V, 4, 4); "
    "depthwarp's own depth maps"
)

DIGITS = 6
"""Least digits of the names that are numbers."""

IMAGE_SUFFIXES = frozenset(
    ".png .jpg .jpeg .tif .tiff .bmp .webp .exr .ppm .pgm .dng .heic".split()
)
"""Suffixes of images' names, which the names of their depth maps do without."""

LONGEST_PART = 200
"""Most bytes of a name between two slashes: file systems take 255, with the suffix."""


@dataclass(frozen=True, eq=False)
class Views:
    """V views by their numbers.

    Attributes:
        lenses: The different lenses, each a camera somewhere.
        lens_of: Number of each view's lens, shape (V,), int32.
        poses: Where each view is seen from.
        names: Of the views, all different, with `/` between folder and name.
    """

    lenses: tuple[Camera, ...]
    lens_of: npt.NDArray[np.int32]
    poses: PoseTable
    names: Sequence[str]

    def __len__(self) -> int:
        return len(self.poses)

    def camera(self, number: int) -> Camera:
        """The camera of a view."""
        lens: Camera = self.lenses[self.lens_of[number]]
        return lens.with_pose(self.poses[number])

    def poses_hash(self) -> str:
        """A number that other poses, lenses of views or names do not have, in hexadecimal."""
        digest = hashlib.blake2b(self.poses.pose_of.__name__.encode(), digest_size=16)
        for array in (self.poses.rows, self.lens_of):
            digest.update(np.ascontiguousarray(array).tobytes())
        if not isinstance(self.names, Numbered):
            digest.update("\0".join(self.names).encode())
        return digest.hexdigest()


class Numbered(Sequence[str]):
    """Names that are numbers, from 0, all of one length."""

    def __init__(self, count: int) -> None:
        self._count = count
        self._digits = max(DIGITS, len(str(count - 1)))

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, number: Any) -> Any:
        if not 0 <= number < self._count:
            raise IndexError(number)
        return f"{number:0{self._digits}d}"


def read_views(
    path: Path, lens: Camera | None = None, *, size: tuple[int, int] | None = None
) -> Views:
    """Read the views that a file says; the content chooses the format.

    Args:
        path: A TUM trajectory, KITTI's odometry poses, a `.csv` or `.npz` of poses, none of which
            has a lens; or any camera file that `load_rig` reads, with lenses and poses.
        lens: The lens of poses without one, a camera that stands anywhere.
        size: (width, height) [px], for camera files that hold none.

    Raises:
        FileNotFoundError: There is no such file.
        InputError: Poses without a lens or cameras with a second one, or names that no file can
            have.
        FileFormatError: The content is of no known format, or cannot be used: a pose that is no
            rotation is named by its line or number.

    Warns:
        LensDomainWarning: A lens's domain is smaller than its image.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path}: there is no such file; check the name and the folder")
    if path.is_file() and path.stat().st_size == 0:
        raise FileFormatError(f"{path}: the file is empty (0 bytes); copy or write it again")
    poses, names, lines = _poses_of(path)
    if poses is not None:
        names = Numbered(len(poses)) if names is None else _file_names(path, names, lines)
        return _posed(path, poses, names, lens)
    if not _is_camera_file(path):
        raise FileFormatError(f"{path}: neither poses nor cameras of a known format: {KNOWN}")
    rig = load_rig(path, size=size)
    if lens is not None:
        raise InputError(
            f"{path} already says the lens of every view: leave out --camera and --fov"
        )
    return _of_rig(path, rig)


def lens_to_dict(camera: Camera) -> dict[str, Any]:
    """A camera as JSON values, without its place."""
    entries = camera_to_dict(camera)
    del entries["pose"], entries["optical_from_world"]
    return entries


def _poses_of(
    path: Path,
) -> tuple[PoseTable | None, Sequence[str] | None, Sequence[int] | None]:
    """Poses, names and their lines of a file without a lens; None of any other."""
    suffix = path.suffix.lower()
    if suffix == ".csv":
        return csv_poses(path)
    if suffix == ".npz":
        return npz_poses(path), None, None
    if any(_module(name).matches(path) for name in TRAJECTORIES):
        return table_of(load_trajectory(path).poses), None, None
    return None, None, None


def _is_camera_file(path: Path) -> bool:
    """Whether some reader of cameras knows the file."""
    if path.suffix.lower() == ".npz" or '"depthwarp depth map"' in beginning(path):
        return True
    return any(_module(name).matches(path) for name in FORMATS)


def _module(name: str) -> Any:
    return importlib.import_module(f"depthwarp.cameras.formats.{name}")


def _posed(path: Path, poses: PoseTable, names: Sequence[str], lens: Camera | None) -> Views:
    """Views of one lens."""
    if lens is None:
        raise InputError(
            f"{path} holds poses and no lens: give --camera FILE, or --fov H V and --size W H"
        )
    own = [getattr(lens, field.name) for field in fields(lens)]  # type: ignore[arg-type]
    if sum(isinstance(value, Pose) for value in own) > 1:
        raise InputError(
            "--camera: this sensor moves while it measures, from its pose to a second one; poses "
            "of a file cannot say both"
        )
    return Views((lens,), np.zeros(len(poses), np.int32), poses, names)


def _of_rig(path: Path, rig: Rig) -> Views:
    """The cameras of a file; equal lenses are one."""
    lenses: dict[str, tuple[int, Camera]] = {}
    lens_of = np.empty(len(rig), np.int32)
    for number, camera in enumerate(rig.cameras):
        key = json.dumps(lens_to_dict(camera))
        lens_of[number] = lenses.setdefault(key, (len(lenses), camera))[0]
    poses = table_of([camera.pose for camera in rig.cameras])
    different = tuple(camera for _, camera in lenses.values())
    return Views(different, lens_of, poses, _file_names(path, rig.names))


def _file_names(path: Path, names: Iterable[str], lines: Sequence[int] | None = None) -> list[str]:
    """Names of views as names of files without a suffix.

    Args:
        path: The file that has them, for messages.
        names: Of the views.
        lines: Where they stand; without it messages give the views' numbers, from 0.

    Raises:
        FileFormatError: A name that leads out of the folder or that no file can have, or two that
            would be one file.
    """
    cleaned: dict[str, tuple[str, str]] = {}
    files = []
    for number, name in enumerate(names):
        place = f"view {number}" if lines is None else f"line {lines[number]}"
        pure = PurePosixPath(name.replace("\\", "/"))
        file = str(pure.with_suffix("") if pure.suffix.lower() in IMAGE_SUFFIXES else pure)
        parts = PurePosixPath(file).parts
        if (
            pure.is_absolute()
            or not parts
            or not file.isprintable()
            or any(
                part == ".." or ":" in part or len(part.encode()) > LONGEST_PART for part in parts
            )
        ):
            raise FileFormatError(
                f"{path}: {place}: the view's name {name[:60]!r} cannot be a file in the output "
                "folder; rename it"
            )
        other = cleaned.get(file.casefold())
        if other is not None:
            raise FileFormatError(
                f"{path}: {other[0]} ({other[1]!r}) and {place} ({name!r}) would be one file; "
                "rename one of the two"
            )
        cleaned[file.casefold()] = place, name
        files.append(file)
    return files
