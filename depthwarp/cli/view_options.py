"""The view that the options of `depthwarp render` describe, in words or by a camera file."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from depthwarp.errors import FileFormatError, InputError

if TYPE_CHECKING:
    from depthwarp.cameras import Camera, PositionFrame
    from depthwarp.range_view import RangeView

__all__ = [
    "FrameChoice",
    "PoseOptions",
    "RangeOptions",
    "camera_of_file",
    "described_view",
    "is_optical_frame",
    "view_of_file",
]

MOST_NAMES = 8
"""Cameras of a file that a message lists."""

Vector3 = tuple[float, float, float]


class FrameChoice(StrEnum):
    """Readings of the position by name."""

    world = "world"
    rotated = "rotated"


class PoseOptions(NamedTuple):
    """The options that say a pose."""

    position: Vector3 | None
    orientation: Vector3 | None
    position_frame: FrameChoice | None

    @property
    def frame(self) -> PositionFrame:
        """Frame of the position."""
        return "world" if self.position_frame is None else self.position_frame.value


class RangeOptions(NamedTuple):
    """The options of the paper's range view."""

    q_depth_map: float | None
    q_line: float | None
    depth_plane: float | None


def described_view(
    pose: PoseOptions,
    fov: tuple[float, float] | None,
    size: tuple[int, int] | None,
    ranges: RangeOptions,
    camera_name: str | None,
) -> Camera | RangeView:
    """The camera or range view that the options describe.

    Raises:
        InputError: Options are missing, or belong to the other kind of view.
    """
    from depthwarp.cameras import PinholeCamera
    from depthwarp.range_view import RangeView

    position, orientation, _ = pose
    if camera_name is not None:
        raise InputError("--camera-name belongs to --camera FILE")
    if position is None or orientation is None or fov is None:
        raise InputError(
            "give --position X Y Z, --orientation A B G and --fov H V, or --camera FILE"
        )
    q_depth_map, q_line, depth_plane = ranges
    if (size is None) == (q_depth_map is None):
        raise InputError("give either --size W H or --q-depth-map M")
    if size is not None:
        if q_line is not None or depth_plane is not None:
            raise InputError(
                "--q-line and --depth-plane belong to the range view: they go with --q-depth-map"
            )
        return PinholeCamera.from_fov(fov, size, position, orientation, pose.frame)
    return RangeView(
        position=position,
        orientation=orientation,
        fov=fov,
        q_line=0.01 if q_line is None else q_line,
        q_depth_map=q_depth_map or 0.0,
        position_frame=pose.frame,
        depth_plane=depth_plane,
    )


def view_of_file(
    path: Path,
    name: str | None,
    pose: PoseOptions,
    fov: tuple[float, float] | None,
    size: tuple[int, int] | None,
    ranges: RangeOptions,
) -> Camera:
    """The camera of a file, at its own place or at that of the options.

    Raises:
        InputError: Options that contradict the file, or half a pose.
        FileFormatError: The file holds no camera.
    """
    from depthwarp.cameras import Pose

    if fov is not None or any(given is not None for given in ranges):
        raise InputError(
            "--camera already says the lens: leave out --fov and the options of the range view"
        )
    camera = camera_of_file(path, name, size)
    position, orientation, frame = pose
    if position is None and orientation is None:
        if frame is not None:
            raise InputError(
                "--position-frame belongs to --position and --orientation, without which the pose "
                "is that of --camera"
            )
        return camera
    if position is None or orientation is None:
        raise InputError("give both --position and --orientation, or neither for the file's own")
    return camera.with_pose(Pose.from_orientation(position, orientation, pose.frame))


def is_optical_frame(camera: Camera) -> bool:
    """Whether the world of a camera is its own optical frame: so files without a pose are read."""
    from depthwarp.cameras import Pose

    return camera.pose == Pose.from_optical(
        [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    )


def camera_of_file(path: Path, name: str | None, size: tuple[int, int] | None) -> Camera:
    """One camera of a file; what is missing is asked for by the names of the options.

    Raises:
        InputError: The file holds several cameras and no name is given, or none of that name; or
            its size is missing, or is not `size`.
        FileFormatError: The file holds no camera.
    """
    from depthwarp.cameras import load, load_rig

    try:
        if name is not None:
            return load(path, name, size=size)
        rig = load_rig(path, size=size)
    except FileFormatError:
        raise
    except InputError as error:
        if size is not None or "size" not in str(error):
            raise
        raise InputError(f"{error}; on the command line: --size W H") from error
    if len(rig) == 1:
        return rig.cameras[0]
    some = ", ".join(rig.names[:MOST_NAMES]) + ", ..." * (len(rig) > MOST_NAMES)
    raise InputError(f"{path} holds {len(rig)} cameras: --camera-name NAME, one of {some}")
