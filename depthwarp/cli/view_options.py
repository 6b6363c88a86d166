"""The view that the options of `depthwarp render` describe, in words or by a camera file."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from depthwarp.errors import InputError

if TYPE_CHECKING:
    from depthwarp.cameras import Camera, PositionFrame
    from depthwarp.range_view import RangeView

__all__ = ["FrameChoice", "PoseOptions", "RangeOptions", "described_view", "view_of_file"]

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
    from depthwarp.cameras import Pose, load

    if fov is not None or any(given is not None for given in ranges):
        raise InputError(
            "--camera already says the lens: leave out --fov and the options of the range view"
        )
    camera = load(path, name, size=size)
    position, orientation, frame = pose
    if position is None and orientation is None:
        if frame is not None:
            raise InputError("--position-frame belongs to --position and --orientation")
        return camera
    if position is None or orientation is None:
        raise InputError("give both --position and --orientation, or neither for the file's own")
    return camera.with_pose(Pose.from_orientation(position, orientation, pose.frame))
