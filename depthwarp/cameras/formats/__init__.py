"""Cameras in files: one module a format, found by the file's name and the beginning of its content.

Every format module has `NAME`, `CONVENTION` (one sentence: axes, direction of the transform, pixel
centres, units), `matches(path)`, `read_rig(path)` and `write_rig(rig, path)`; a format of
trajectories has `read_trajectory(path)` and `write_trajectory(trajectory, path)` in their place.
"""

from __future__ import annotations

import importlib
import json
import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from depthwarp.cameras.camera import Camera
from depthwarp.cameras.formats.content import beginning
from depthwarp.cameras.rig import Rig
from depthwarp.checks import check_choice, check_size
from depthwarp.errors import FileFormatError, InputError

if TYPE_CHECKING:
    from depthwarp.cameras.trajectory import Trajectory

__all__ = [
    "FORMATS",
    "TRAJECTORIES",
    "load",
    "load_rig",
    "load_trajectory",
    "save",
    "save_trajectory",
]

FORMATS: dict[str, str] = {
    "opencv": "OpenCV calibration (.yaml, .xml, .json of cv2.FileStorage)",
    "ros": "ROS CameraInfo (.yaml)",
    "open3d": "Open3D camera (.json)",
    "kitti": "KITTI calibration (calib.txt, calib_cam_to_cam.txt)",
    "colmap": "COLMAP model (folder with cameras.txt or cameras.bin)",
    "nerfstudio": "nerfstudio transforms.json",
}
"""Formats of cameras: their names, which are those of the modules, and what people call them."""

WITHOUT_SIZE = ("opencv", "ros", "kitti", "nerfstudio")
"""Formats whose files may hold no image size; their `read_rig` takes `size` as well."""

KNOWN = "OpenCV, ROS, Open3D, KITTI, COLMAP, nerfstudio, and depthwarp's depth maps"

CLOUDS = (".ply", ".pcd", ".las", ".laz", ".e57", ".xyz", ".pts", ".ptx", ".bin", ".obj", ".stl")
"""Suffixes that point clouds have, and none of the formats of cameras has alone."""

TRAJECTORIES: dict[str, str] = {
    "tum": "TUM trajectory (.txt)",
    "kitti_poses": "poses of KITTI's odometry benchmark (.txt)",
}
"""Formats of poses without a lens."""


def load(
    path: str | os.PathLike[str], name: str | None = None, *, size: Sequence[int] | None = None
) -> Camera:
    """Read one camera; the content chooses the format. See `load_rig` for the formats.

    Args:
        path: A camera file, a COLMAP model's folder, or a depth map's `.npz` or `.json`.
        name: Which of the file's cameras; not needed where there is only one. Of a stereo
            calibration without extrinsics it is read alone, in its own optical frame.
        size: (width, height) [px], for files that hold none.

    Returns:
        The camera; its world is that of the file, see `CONVENTION` of the format's module.

    Raises:
        FileNotFoundError: There is no such file.
        InputError: The file holds several cameras and no name is given, or none of that name; or
            its size is missing or is not `size`.
        FileFormatError: The content is of no known format, or cannot be used.

    Warns:
        LensDomainWarning: The lens's domain is smaller than the image.

    Example:
        >>> import depthwarp as dw
        >>> dw.cameras.load("calib.txt", "P2", size=(1242, 375)).size  # doctest: +SKIP
        (1242, 375)
    """
    rig = _rig_of(path, size, name)
    if name is None:
        if len(rig) == 1:
            return rig.cameras[0]
        raise InputError(
            f"{path} holds {len(rig)} cameras ({_listed(rig.names)}): give the name of one, or "
            "read all with depthwarp.cameras.load_rig"
        )
    if name not in rig:
        one = f"its only camera is '{rig.names[0]}'"
        raise InputError(
            f"{path} has no camera '{name}'; "
            + (one if len(rig) == 1 else f"it has {_listed(rig.names)}")
        )
    return rig[name]


def load_rig(path: str | os.PathLike[str], *, size: Sequence[int] | None = None) -> Rig:
    """Read all cameras of a file, by name; the content chooses the format.

    Formats: OpenCV's FileStorage, ROS CameraInfo, Open3D's pinhole parameters, KITTI's calibration,
    COLMAP models, nerfstudio's transforms, and depthwarp's own depth maps.

    Args:
        path: A camera file, a COLMAP model's folder, or a depth map's `.npz` or `.json`.
        size: (width, height) [px] of every camera, for files that hold none.

    Returns:
        The cameras; their world is that of the file, see `CONVENTION` of the format's module.

    Raises:
        FileNotFoundError: There is no such file.
        InputError: The size is missing, or the file has one and `size` is another.
        FileFormatError: The content is of no known format, or cannot be used.

    Warns:
        LensDomainWarning: A lens's domain is smaller than its image.
    """
    return _rig_of(path, size, None)


def _rig_of(path: str | os.PathLike[str], size: Sequence[int] | None, alone: str | None) -> Rig:
    """`load_rig`, or of cameras that do not form a rig the one that is named."""
    path = _existing(path)
    checked = None if size is None else check_size(size)
    if _is_depth_map(path):
        from depthwarp.saving import load_camera

        return _of_size(Rig.of({"camera": load_camera(path)}), checked, path)
    name = _format_of(path)
    if name == "opencv":
        rig: Rig = _module(name).read_rig(path, checked, alone)
    elif name in WITHOUT_SIZE:
        rig = _module(name).read_rig(path, checked)
    else:
        rig = _module(name).read_rig(path)
    return _of_size(rig, checked, path)


def load_trajectory(path: str | os.PathLike[str]) -> Trajectory:
    """Read a trajectory: poses by time, without a lens.

    Args:
        path: A TUM trajectory, or the poses of KITTI's odometry benchmark, whose times are the
            numbers of the lines.

    Raises:
        FileNotFoundError: There is no such file.
        FileFormatError: The content is not a trajectory, or cannot be used.
    """
    path = _existing(path)
    for name in TRAJECTORIES:
        if _module(name).matches(path):
            trajectory: Trajectory = _module(name).read_trajectory(path)
            return trajectory
    known = "; ".join(TRAJECTORIES.values())
    raise FileFormatError(f"{path} is not a trajectory; known are {known}")


def save(camera: Camera | Rig, path: str | os.PathLike[str], *, format: str) -> None:
    """Write a camera, or all cameras of a rig; every file appears whole or not at all.

    What each format can hold; other models are described by a depth map's own file:

    - `opencv`: one `PinholeCamera` (any distortion) or `FisheyeCamera`.
    - `ros`: the same, at the origin of its optical frame.
    - `open3d`: `PinholeCamera`s without distortion.
    - `kitti`: up to four parallel `PinholeCamera`s without distortion.
    - `colmap`: `PinholeCamera`s with at most k1, k2, p1, p2, k3 to k6, and `FisheyeCamera`s.
    - `nerfstudio`: all `PinholeCamera`s with at most k1, k2, p1, p2, k3, or all `FisheyeCamera`s,
      or all `EquirectangularCamera`s.

    Args:
        camera: The camera, or the rig.
        path: The file to write; for COLMAP the folder.
        format: One of `opencv`, `ros`, `open3d`, `kitti`, `colmap`, `nerfstudio`.

    Raises:
        InputError: An unknown format, a camera that the format cannot describe, or a path that
            cannot be written.

    Example:
        >>> import depthwarp as dw
        >>> camera = dw.PinholeCamera.from_fov((60, 45), (640, 480))
        >>> dw.cameras.save(camera, "camera.yaml", format="opencv")  # doctest: +SKIP
    """
    check_choice("format", format, tuple(FORMATS))
    if not isinstance(camera, Camera | Rig):
        raise InputError(f"camera must be a Camera or a Rig, got a {type(camera).__name__}")
    rig = camera if isinstance(camera, Rig) else Rig.of({"camera": camera})
    _module(format).write_rig(rig, Path(path))


def save_trajectory(
    trajectory: Trajectory, path: str | os.PathLike[str], *, format: str = "tum"
) -> None:
    """Write a trajectory; the file appears whole or not at all.

    Args:
        trajectory: Poses by time.
        path: The file to write.
        format: `tum`, or `kitti_poses`, which has no room for the times.

    Raises:
        InputError: An unknown format, or a path that cannot be written.
    """
    check_choice("format", format, tuple(TRAJECTORIES))
    _module(format).write_trajectory(trajectory, Path(path))


def _module(name: str) -> Any:
    # On first use: some formats need OpenCV, which is slow to import.
    return importlib.import_module(f"depthwarp.cameras.formats.{name}")


def _existing(path: str | os.PathLike[str]) -> Path:
    if not os.fspath(path):
        raise InputError("the path of the file is empty; give its name")
    path = Path(path)
    if not path.exists():
        raise FileNotFoundError(f"{path}: there is no such file; check the name and the folder")
    if path.is_file() and path.stat().st_size == 0:
        raise FileFormatError(f"{path}: the file is empty (0 bytes); copy or write it again")
    return path


def _is_depth_map(path: Path) -> bool:
    return path.suffix.lower() == ".npz" or '"depthwarp depth map"' in beginning(path)


def _format_of(path: Path) -> str:
    """The format that knows the file.

    Raises:
        FileFormatError: None does; or it is a trajectory, which has no lens.
    """
    for name in FORMATS:
        if _module(name).matches(path):
            return name
    if any(_module(name).matches(path) for name in TRAJECTORIES):
        raise FileFormatError(
            f"{path} is a trajectory: it has poses and no lens; read it with "
            "depthwarp.cameras.load_trajectory"
        )
    what = "folder" if path.is_dir() else "file"
    guess = _guess(path)
    raise FileFormatError(
        f"{path}: a {what} of no known camera format" + (f": {guess}" if guess else f" ({KNOWN})")
    )


def _guess(path: Path) -> str | None:
    """What a path is in place of a camera file, and what to do; None if it is not easily seen."""
    if path.is_dir():
        parts = [Path("sparse", "0"), Path("sparse"), Path("0")]
        models = [path / part for part in parts if _module("colmap").matches(path / part)]
        if models:
            return f"a COLMAP project, whose model is {models[0]}"
        return "an empty path means this folder; give a file" if path == Path() else None
    if path.suffix.lower() in CLOUDS:
        return "it seems to be a point cloud; read it with depthwarp.read"
    if path.suffix.lower() == ".json":
        try:
            json.loads(path.read_text(encoding="utf-8-sig"))
        except json.JSONDecodeError as error:
            return f"broken JSON, line {error.lineno}: {error.msg}"
        except (ValueError, RecursionError):
            return "it is not JSON"
    lines = [line for line in beginning(path).splitlines() if not line.lstrip().startswith("#")]
    if lines and re.fullmatch(r"([-+.\deE]+[\s,;]+){6,7}[-+.\deE]+[\s,;]*", lines[0]):
        return "it seems to be a trajectory; TUM's lines are: timestamp tx ty tz qx qy qz qw"
    return None


def _of_size(rig: Rig, size: tuple[int, int] | None, path: Path) -> Rig:
    """The rig, if every camera has the size that was asked for."""
    for name, camera in rig.items():
        if size is not None and camera.size != size:
            raise InputError(
                f"{path}: camera '{name}' is {camera.width} x {camera.height} pixels by the file, "
                f"size says {size[0]} x {size[1]}; leave size out"
            )
    return rig


def _listed(names: Sequence[str], most: int = 12) -> str:
    more = f", ... ({len(names) - most} more)" if len(names) > most else ""
    return ", ".join(names[:most]) + more
