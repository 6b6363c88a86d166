"""Cameras that stand fixed to each other, by name: what a calibration file with several holds."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from depthwarp.cameras.camera import Camera
from depthwarp.cameras.pose import Pose, check_pose
from depthwarp.errors import InputError

__all__ = ["Rig"]

MOST_NAMES = 8
"""Names that a message lists."""


@dataclass(frozen=True)
class Rig(Mapping[str, Camera]):
    """Named cameras whose poses share one frame, the rig's: a mapping from name to camera.

    Models and sizes may differ. In a file the rig's frame is the world of that file, for example
    the LiDAR's frame of a KITTI calibration.

    Attributes:
        names: The cameras' names, all different.
        cameras: The cameras, in the same order; the world frame of their poses is the rig's frame.

    Raises:
        InputError: No camera, two of one name, another number of names than of cameras, or an
            entry that is not a camera.

    Example:
        >>> import depthwarp as dw
        >>> left = dw.PinholeCamera.from_fov((60, 45), (640, 480), position=(0, 0.1, 0))
        >>> right = dw.PinholeCamera.from_fov((60, 45), (320, 240), position=(0, -0.1, 0))
        >>> rig = dw.cameras.Rig.of({"left": left, "right": right})
        >>> rig.with_pose(dw.Pose.from_orientation((10, 0, 2), (0, 0, 90)))["right"].size
        (320, 240)
    """

    names: tuple[str, ...]
    cameras: tuple[Camera, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "cameras", tuple(self.cameras))
        if not self.cameras:
            raise InputError("a rig must have at least one camera, got none")
        if len(self.names) != len(self.cameras):
            raise InputError(
                "a rig must have one name for each camera, got "
                f"{len(self.names)} names and {len(self.cameras)} cameras"
            )
        for name, camera in zip(self.names, self.cameras, strict=True):
            if not isinstance(name, str):
                raise InputError(f"a camera's name in a rig must be text, got {name!r}")
            if not isinstance(camera, Camera):
                raise InputError(f"a rig holds cameras, got {type(camera).__name__} as '{name}'")
        if len(self._by_name) < len(self.names):
            name = Counter(self.names).most_common(1)[0][0]
            raise InputError(f"names in a rig must all be different, '{name}' stands twice")

    @cached_property
    def _by_name(self) -> dict[str, Camera]:
        return dict(zip(self.names, self.cameras, strict=True))

    @classmethod
    def of(cls, cameras: Mapping[str, Camera]) -> Rig:
        """Rig of a mapping from name to camera, in its order.

        Raises:
            InputError: No camera, or an entry that is not a camera.
        """
        return cls(tuple(cameras), tuple(cameras.values()))

    def with_pose(self, pose: Pose) -> Rig:
        """The same rig at another place.

        A point of the new world goes into the rig's frame by `pose.to_camera`, and from there into
        a camera's frame by the pose that the camera has in this rig:
        `moved[name].pose.to_camera(p) == self[name].pose.to_camera(pose.to_camera(p))`.
        So `pose.center_world` is where the rig's origin stands in the new world, and the rows of
        `pose.camera_from_world` are the rig's own X, Y and Z axes there, whatever they point at in
        this rig: forward, left and up in a LiDAR's frame; in a frame with OpenCV's optical axes
        they are right, down and forward.

        Args:
            pose: The rig's pose in the new world.

        Raises:
            InputError: Not a `Pose`.
        """
        check_pose("pose", pose)
        return Rig(self.names, tuple(_moved(camera, pose) for camera in self.cameras))

    def __getitem__(self, name: str) -> Camera:
        """The camera of a name.

        Raises:
            KeyError: There is no camera of that name; the message lists those that there are.
        """
        if name not in self._by_name:
            some = ", ".join(self.names[:MOST_NAMES]) + (", ..." * (len(self) > MOST_NAMES))
            raise KeyError(f"no camera '{name}' in the rig; it has {some}")
        return self._by_name[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __len__(self) -> int:
        return len(self.names)


def _moved(camera: Camera, pose: Pose) -> Camera:
    """A camera of the rig in the new world; a sensor that moves has two poses, both are moved."""
    fields = dataclasses.fields(camera)  # type: ignore[arg-type]
    poses = {field.name: getattr(camera, field.name) for field in fields}
    moved = {name: _chained(pose, own) for name, own in poses.items() if isinstance(own, Pose)}
    return dataclasses.replace(camera, **moved)  # type: ignore[type-var]


def _chained(first: Pose, second: Pose) -> Pose:
    """The pose that does what `first` does and then `second`."""
    rotation = second.rotation @ first.rotation
    # The point that both together bring to zero, through `to_world`: rotations may be rounded.
    zero = first.to_world(second.to_world(np.zeros(3)))
    rows = [tuple(float(value) for value in row) for row in rotation]
    return Pose((rows[0], rows[1], rows[2]), tuple(float(value) for value in zero))  # type: ignore[arg-type]
