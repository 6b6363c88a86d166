"""The pinhole camera: straight lines through one centre onto a plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.pose import Pose, PositionFrame
from depthwarp.checks import (
    check_choice,
    check_finite_vector,
    check_fov,
    check_positive,
    check_size,
)
from depthwarp.errors import InputError

__all__ = ["DepthKind", "PinholeCamera"]

DepthKind = Literal["range", "z"]
"""`range`: Euclidean distance from the camera's centre. `z`: distance along the optical axis."""

Float64Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class PinholeCamera:
    """A pinhole camera without lens distortion.

    Pixel centres are at whole numbers (OpenCV): the image spans u from -0.5 to width - 0.5.

    Attributes:
        fx: Focal length along columns [px].
        fy: Focal length along rows [px].
        cx: Principal point, column [px].
        cy: Principal point, row [px].
        width: Image width [px].
        height: Image height [px].
        pose: Where the camera stands and looks.

    Raises:
        InputError: A focal length that is not above 0, a principal point that is not finite, or a
            size that is not a positive whole number.

    Example:
        >>> import depthwarp as dw
        >>> camera = dw.PinholeCamera.from_fov(fov=(60, 45), size=(724, 662), position=(0, 0, 1.2))
        >>> camera.cx
        361.5
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    pose: Pose

    def __post_init__(self) -> None:
        check_positive("fx", self.fx, "pixels")
        check_positive("fy", self.fy, "pixels")
        check_finite_vector("principal point (cx, cy)", (self.cx, self.cy), 2)
        width, height = check_size((self.width, self.height))
        object.__setattr__(self, "width", width)
        object.__setattr__(self, "height", height)

    @classmethod
    def from_fov(
        cls,
        fov: Sequence[float],
        size: Sequence[int],
        position: Sequence[float] = (0.0, 0.0, 0.0),
        orientation: Sequence[float] = (0.0, 0.0, 0.0),
        position_frame: PositionFrame = "world",
    ) -> PinholeCamera:
        """Camera by its field of view, both angles measured through the optical axis.

        Args:
            fov: (horizontal, vertical) [degrees], each above 0 and below 180. The paper measures
                the vertical angle along the side edges instead: see `RangeView`.
            size: (width, height) [px].
            position: P_C [m].
            orientation: C_O = (roll, pitch, yaw) [degrees].
            position_frame: Frame of `position`, see `Pose.from_orientation`.

        Raises:
            InputError: An angle, a size or a number out of its range.
        """
        horizontal, vertical = check_fov(fov)
        width, height = check_size(size)
        return cls(
            fx=(width / 2) / math.tan(math.radians(horizontal) / 2),
            fy=(height / 2) / math.tan(math.radians(vertical) / 2),
            cx=(width - 1) / 2,
            cy=(height - 1) / 2,
            width=width,
            height=height,
            pose=Pose.from_orientation(position, orientation, position_frame),
        )

    @classmethod
    def from_matrix(
        cls,
        K: npt.ArrayLike,
        size: Sequence[int],
        distortion: Sequence[float] | None = None,
        optical_from_world: npt.ArrayLike | None = None,
    ) -> PinholeCamera:
        """Camera by its intrinsic matrix and OpenCV's extrinsic matrix.

        Args:
            K: Intrinsics, shape (3, 3): [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] [px].
            size: (width, height) [px].
            distortion: Lens distortion coefficients; only None or zeros, an ideal lens.
            optical_from_world: World to optical axes (X right, Y down, Z forward), shape (4, 4),
                column vectors [m]; the identity when None.

        Raises:
            InputError: Wrong shapes, numbers that are not finite, skew, a matrix that is not a
                rotation, or a distorted lens.
        """
        matrix = np.asarray(K, dtype=np.float64)
        if matrix.shape != (3, 3) or not np.isfinite(matrix).all():
            raise InputError(f"K must be a finite 3 x 3 matrix, got shape {matrix.shape}")
        if matrix[0, 1] != 0 or matrix[1, 0] != 0 or tuple(matrix[2]) != (0.0, 0.0, 1.0):
            raise InputError(
                "K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] without skew, "
                f"got {matrix.tolist()}"
            )
        if distortion is not None and np.any(np.asarray(distortion, dtype=np.float64)):
            raise InputError(
                "distortion: this camera is an ideal pinhole; undistort the image "
                "(cv2.undistort) and pass the new camera matrix"
            )
        width, height = check_size(size)
        transform = np.eye(4) if optical_from_world is None else optical_from_world
        return cls(
            fx=float(matrix[0, 0]),
            fy=float(matrix[1, 1]),
            cx=float(matrix[0, 2]),
            cy=float(matrix[1, 2]),
            width=width,
            height=height,
            pose=Pose.from_optical(transform),
        )

    @property
    def size(self) -> tuple[int, int]:
        """Image size (width, height) [px]."""
        return self.width, self.height

    @property
    def K(self) -> Float64Array:
        """Intrinsic matrix [px], shape (3, 3), float64."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], np.float64)

    def project(
        self, points_world: npt.NDArray[np.floating], depth: DepthKind = "range"
    ) -> tuple[Float64Array, Float64Array, Float64Array, npt.NDArray[np.bool_]]:
        """Project points in float64: the reference of the kernel, equation (10) and GEOMETRY.

        Args:
            points_world: Points [m], shape (N, 3).
            depth: Which depth to return.

        Returns:
            Columns u [px], rows v [px] and depth [m], each (N,) float64, NaN where the point is not
            ahead of the camera or not finite; and a mask (N,), true where the pixel
            `(floor(u + 0.5), floor(v + 0.5))` lies in the image.
        """
        check_choice("depth", depth, ("range", "z"))
        with np.errstate(all="ignore"):
            x, y, z = self.pose.to_camera(np.asarray(points_world)).T
            ahead = np.isfinite(x) & np.isfinite(y) & np.isfinite(z) & (x > 0)
            x = np.where(ahead, x, np.nan)
            u = self.cx - self.fx * (y / x)
            v = self.cy - self.fy * (z / x)
            distance = np.sqrt(x * x + y * y + z * z) if depth == "range" else x
            column, row = np.floor(u + 0.5), np.floor(v + 0.5)
            valid = (column >= 0) & (column < self.width) & (row >= 0) & (row < self.height)
        return u, v, distance, valid
