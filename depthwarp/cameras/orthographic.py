"""The orthographic camera: parallel rays, as a map or a plan is drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.camera import Camera, DepthKind, DeviceLens
from depthwarp.cameras.pose import Pose, PositionFrame
from depthwarp.checks import check_positive, check_size

__all__ = ["OrthographicCamera"]

Float64Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class OrthographicCamera(Camera):
    """Parallel rays along the camera's X axis; its position is the middle of the image.

    Both kinds of depth are the distance from the image's plane, along the rays; points behind the
    plane are not drawn.

    Attributes:
        pixel_size: Side of a pixel in the scene [m].
        width: Image width [px].
        height: Image height [px].
        pose: Where the middle of the image stands, and where it looks.

    Raises:
        InputError: A pixel size that is not above 0, or a size that is not a positive whole number.

    Example:
        >>> import depthwarp as dw
        >>> plan = dw.OrthographicCamera.looking(0.05, (400, 300), (5, 4, 10), (0, 90, 0))  # down
        >>> plan.cx
        199.5
    """

    pixel_size: float
    width: int
    height: int
    pose: Pose

    def __post_init__(self) -> None:
        check_positive("pixel_size", self.pixel_size, "metres")
        self._check_image()

    @classmethod
    def looking(
        cls,
        pixel_size: float,
        size: Sequence[int],
        position: Sequence[float] = (0.0, 0.0, 0.0),
        orientation: Sequence[float] = (0.0, 0.0, 0.0),
        position_frame: PositionFrame = "world",
    ) -> OrthographicCamera:
        """Camera by where it stands and looks.

        Args:
            pixel_size: Side of a pixel in the scene [m].
            size: (width, height) [px].
            position: The middle of the image [m].
            orientation: C_O = (roll, pitch, yaw) [degrees].
            position_frame: Frame of `position`, see `Pose.from_orientation`.

        Raises:
            InputError: A size or a number out of its range.
        """
        width, height = check_size(size)
        pose = Pose.from_orientation(position, orientation, position_frame)
        return cls(pixel_size, width, height, pose)

    @property
    def cx(self) -> float:
        """Column of the axis [px]."""
        return (self.width - 1) / 2

    @property
    def cy(self) -> float:
        """Row of the axis [px]."""
        return (self.height - 1) / 2

    def depth_of(self, points_camera: Float64Array, kind: DepthKind) -> Float64Array:
        """Distance from the image's plane [m]; see `Camera.depth_of`."""
        return points_camera[..., 0]

    def points_of(
        self, u: Float64Array, v: Float64Array, depth: Float64Array, kind: DepthKind
    ) -> Float64Array:
        """Points of the camera frame that pixels see at a depth; see `Camera.points_of`."""
        y, z = (self.cx - u) * self.pixel_size, (self.cy - v) * self.pixel_size
        return np.stack(np.broadcast_arrays(depth, y, z), axis=-1)

    def image_of(self, points_camera: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Columns u and rows v of points in the camera frame; see `Camera.image_of`."""
        x, y, z = np.moveaxis(points_camera, -1, 0)
        ahead = np.where(x > 0, 1.0, np.nan)
        return (
            (self.cx - y / self.pixel_size) * ahead,
            (self.cy - z / self.pixel_size) * ahead,
        )

    def directions(self, u: npt.ArrayLike, v: npt.ArrayLike) -> Float64Array:
        """The axis, for every pixel; see `Camera.directions`."""
        shape = np.broadcast_shapes(np.shape(u), np.shape(v))
        axis: Float64Array = np.broadcast_to((1.0, 0.0, 0.0), (*shape, 3)).copy()
        return axis

    @cached_property
    def pixel_pitch(self) -> tuple[float, float]:
        """The same at every depth; see `Camera.pixel_pitch`."""
        return 0.0, self.pixel_size

    @cached_property
    def cull_limits(self) -> tuple[float, ...]:
        """Half the image and a pixel more, in y and z [m]; see `Camera.cull_limits`."""
        y, z = (0.5 * (side + 2) * self.pixel_size for side in self.size)
        return -y, y, -z, z

    def device_lens(self, first: int = 0) -> DeviceLens:
        """The lens as kernels take it; see `Camera.device_lens`."""
        from depthwarp_kernels import lens_pinhole

        numbers: Any = lens_pinhole.PinholeLens()
        numbers.fx = numbers.fy = 1 / self.pixel_size
        numbers.cx, numbers.cy = self.cx, self.cy
        return DeviceLens(lens_pinhole.ORTHOGRAPHIC, numbers, np.empty(0, np.float32))
