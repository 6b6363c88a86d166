"""COLMAP models: a folder with cameras.txt and images.txt, or the same as .bin.

Saving takes `PinholeCamera`s with at most k1, k2, p1, p2, k3, k4, k5, k6, and `FisheyeCamera`s.
"""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

from depthwarp.cameras.formats import colmap_binary, colmap_text
from depthwarp.cameras.formats.colmap_model import records_of, rig_of
from depthwarp.cameras.rig import Rig
from depthwarp.errors import FileFormatError, InputError
from depthwarp.io.atomic import atomic_path, check_target

__all__ = ["CONVENTION", "NAME", "matches", "read_rig", "write_rig"]

NAME = "colmap"

CONVENTION = (
    "World to camera (quaternion with the scalar first, translation in the model's own unit, read "
    "as [m]), optical axes (X right, Y down, Z forward); the upper left pixel's centre is at "
    "(0.5, 0.5), so principal points are 0.5 px less here."
)

FORMS: dict[str, ModuleType] = {".bin": colmap_binary, ".txt": colmap_text}
"""What reads and writes files of each suffix; where a folder has both, .bin, as in COLMAP."""

OTHER_PARTS = ("points3D", "rigs", "frames")
"""What else a model consists of: not read here, and out of date if cameras are written beside."""


def matches(path: Path) -> bool:
    """Whether it is a folder with a COLMAP model, or one of a model's two files."""
    if path.is_dir():
        return any((path / f"cameras{suffix}").is_file() for suffix in FORMS)
    return path.is_file() and path.stem in ("cameras", "images") and path.suffix in FORMS


def read_rig(path: Path) -> Rig:
    """Read a model; its images' names are the cameras' names.

    A folder or file without images gives the cameras alone, by their numbers, each at the origin
    with its optical axes along the world's. 2D and 3D points are passed over.

    Args:
        path: The model's folder, or one of its files, which stands for it and the one beside it.

    Raises:
        FileFormatError: A file is missing, cut short, or has content that cannot be used.

    Warns:
        LensDomainWarning: A lens's domain is smaller than its image.
    """
    folder, suffix = _model_files(path)
    cameras_path, images_path = folder / f"cameras{suffix}", folder / f"images{suffix}"
    if not cameras_path.is_file():
        raise FileFormatError(
            f"{path}: there is no {cameras_path.name} in {folder}; a COLMAP model has its lenses "
            "there"
        )
    form = FORMS[suffix]
    images = form.read_images(images_path) if images_path.is_file() else None
    return rig_of(form.read_cameras(cameras_path), images, cameras_path, images_path)


def write_rig(rig: Rig, path: Path) -> None:
    """Write a model without points: text, or binary if a .bin file is named or already there.

    The folder is made if its parent is there. Each file appears whole or not at all, the cameras
    last, without which the rest is no model.

    Args:
        rig: Pinhole and fisheye cameras; their names become the images' names.
        path: The folder, or the cameras' or images' file in it.

    Raises:
        InputError: A lens that COLMAP has no model for, a name that it cannot hold, a folder that
            holds another model or cannot be written.
    """
    folder, suffix = _model_files(path)
    cameras, images = records_of(rig)
    form = FORMS[suffix]
    for name in rig.names:
        form.check_name(name)
    _make_folder(folder)
    points = folder / f"points3D{suffix}"
    _check_no_other_model(folder, suffix, points, form.NO_POINTS)
    # COLMAP opens no model without this file.
    with atomic_path(points) as temporary:
        temporary.write_bytes(form.NO_POINTS)
    form.write_images(images, folder / f"images{suffix}")
    form.write_cameras(cameras, folder / f"cameras{suffix}")


def _model_files(path: Path) -> tuple[Path, str]:
    """Folder and suffix of the model that a path means."""
    if path.stem in ("cameras", "images") and path.suffix in FORMS and not path.is_dir():
        return path.parent, path.suffix
    is_binary = (path / "cameras.bin").is_file()
    return path, ".bin" if is_binary else ".txt"


def _make_folder(folder: Path) -> None:
    if folder.is_dir():
        return
    if folder.exists() or folder.suffix in FORMS:
        raise InputError(
            f"cannot write a COLMAP model to {folder}: give a folder, or the file cameras.txt or "
            "cameras.bin in it"
        )
    check_target(folder)
    try:
        folder.mkdir()
    except OSError as error:
        raise InputError(f"cannot make the folder {folder}: {error.strerror}") from error


def _check_no_other_model(folder: Path, suffix: str, points: Path, no_points: bytes) -> None:
    """Refuse a folder whose points would be lost, or whose files would be read in place of ours."""
    parts = ("cameras", "images", *OTHER_PARTS)
    others = [f"{part}{other}" for part in parts for other in FORMS if other != suffix]
    others += [f"{part}{suffix}" for part in OTHER_PARTS]
    there = [name for name in others if (folder / name).exists()]
    if points.is_file() and points.stat().st_size == len(no_points):
        there.remove(points.name)
    if there:
        raise InputError(
            f"cannot write a COLMAP model to {folder}: it holds {', '.join(there)}, which would "
            "no longer fit; choose an empty folder"
        )
