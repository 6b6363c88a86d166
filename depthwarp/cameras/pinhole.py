"""The pinhole camera: rays through one centre onto a plane, bent by a real lens or not."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.brown import BrownDistortion
from depthwarp.cameras.camera import Camera, DeviceLens
from depthwarp.cameras.limits import plane_limits
from depthwarp.cameras.pose import Pose, PositionFrame
from depthwarp.checks import (
    check_finite_vector,
    check_fov,
    check_matrix,
    check_positive,
    check_size,
)
from depthwarp.errors import InputError

__all__ = ["PinholeCamera", "check_focal", "intrinsics_of"]

Float64Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class PinholeCamera(Camera):
    """A pinhole camera, with OpenCV's lens distortion or without.

    Pixel centres are at whole numbers (OpenCV): the image spans u from -0.5 to width - 0.5. A
    distorted lens has a domain: points so far off the axis that the model would fold them back
    into the image are not drawn.

    Attributes:
        fx: Focal length along columns [px].
        fy: Focal length along rows [px].
        cx: Principal point, column [px].
        cy: Principal point, row [px].
        width: Image width [px].
        height: Image height [px].
        pose: Where the camera stands and looks.
        distortion: Brown-Conrady or rational coefficients in OpenCV's order: (k1, k2, p1, p2[, k3[,
            k4, k5, k6[, s1, s2, s3, s4[, tau_x, tau_y]]]]); empty for an ideal lens. Trailing
            zeros are dropped.

    Raises:
        InputError: A focal length that is not above 0, a principal point that is not finite, a
            size that is not a positive whole number, or coefficients in another number.

    Warns:
        LensDomainWarning: The lens's domain is smaller than the image.

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
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        check_focal(self.fx, self.fy, self.cx, self.cy)
        self._check_image()
        coefficients = BrownDistortion.from_coefficients(self.distortion).coefficients
        object.__setattr__(self, "distortion", coefficients)
        if coefficients:
            self.warn_of_lost_pixels()

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
            distortion: Lens distortion coefficients in OpenCV's order, see `distortion` of the
                class; None or zeros for an ideal lens.
            optical_from_world: World to optical axes (X right, Y down, Z forward), shape (4, 4),
                column vectors [m]; the identity when None.

        Raises:
            InputError: Wrong shapes, numbers that are not finite, skew, a matrix that is not a
                rotation, or coefficients in another number than OpenCV's.

        Warns:
            LensDomainWarning: The lens's domain is smaller than the image.
        """
        fx, fy, cx, cy = intrinsics_of(K)
        width, height = check_size(size)
        transform = np.eye(4) if optical_from_world is None else optical_from_world
        return cls(
            fx=fx,
            fy=fy,
            cx=cx,
            cy=cy,
            width=width,
            height=height,
            pose=Pose.from_optical(transform),
            distortion=() if distortion is None else tuple(np.ravel(distortion).tolist()),
        )

    @property
    def K(self) -> Float64Array:
        """Intrinsic matrix [px], shape (3, 3), float64."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], np.float64)

    @cached_property
    def lens(self) -> BrownDistortion:
        """The distortion, and its domain."""
        return BrownDistortion.from_coefficients(self.distortion)

    def image_of(self, points_camera: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Columns u and rows v of points in the camera frame; see `Camera.image_of`."""
        x = np.where(points_camera[..., 0] > 0, points_camera[..., 0], np.nan)
        right, down = -(points_camera[..., 1] / x), -(points_camera[..., 2] / x)
        if self.distortion:
            right, down = self.lens.apply(right, down)
        return self.cx + self.fx * right, self.cy + self.fy * down

    def directions(self, u: npt.ArrayLike, v: npt.ArrayLike) -> Float64Array:
        """Unit vectors along the rays of pixels, in the camera frame; see `Camera.directions`."""
        right = (np.asarray(u, dtype=np.float64) - self.cx) / self.fx
        down = (np.asarray(v, dtype=np.float64) - self.cy) / self.fy
        if self.distortion:
            with np.errstate(all="ignore"):
                right, down = self.lens.undo(right, down)
        ray = np.stack(np.broadcast_arrays(1.0, -right, -down), axis=-1)
        unit: Float64Array = ray / np.linalg.norm(ray, axis=-1, keepdims=True)
        return unit

    @cached_property
    def cull_limits(self) -> tuple[float, ...]:
        """What the lens sees at most; see `Camera.cull_limits`."""
        return plane_limits(self)

    def device_lens(self, first: int = 0) -> DeviceLens:
        """The lens as kernels take it; see `Camera.device_lens`."""
        import warp as wp

        from depthwarp_kernels import lens_pinhole

        numbers: object
        if not self.distortion:
            model = lens_pinhole.PINHOLE
            numbers = _pinhole_numbers(lens_pinhole.PinholeLens(), self)
        elif not self.lens.is_rational:
            model = lens_pinhole.BROWN
            numbers = _brown_numbers(lens_pinhole.BrownLens(), self)
        else:
            model, lens = lens_pinhole.RATIONAL, self.lens
            full: Any = lens_pinhole.RationalLens()
            full.brown = _brown_numbers(lens_pinhole.BrownLens(), self)
            full.k4, full.k5, full.k6 = lens.k4, lens.k5, lens.k6
            full.prism = wp.vec4f(lens.s1, lens.s2, lens.s3, lens.s4)
            full.tilt = wp.mat33f(*lens.tilt.ravel().tolist())
            numbers = full
        return DeviceLens(model, numbers, np.empty(0, np.float32))


def check_focal(fx: float, fy: float, cx: float, cy: float) -> None:
    """Refuse a focal length that is not above 0 or a principal point that is not finite [px].

    Raises:
        InputError: The message names the number.
    """
    check_positive("fx", fx, "pixels")
    check_positive("fy", fy, "pixels")
    check_finite_vector("principal point (cx, cy)", (cx, cy), 2)


def intrinsics_of(K: npt.ArrayLike) -> tuple[float, float, float, float]:
    """(fx, fy, cx, cy) of an intrinsic matrix.

    Raises:
        InputError: Wrong shape, numbers that are not finite, skew, or a last row that is not
            (0, 0, 1).
    """
    matrix = check_matrix("K", K, 3)
    if matrix[0, 1] != 0 or matrix[1, 0] != 0 or tuple(matrix[2]) != (0.0, 0.0, 1.0):
        raise InputError(
            f"K must be [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] without skew, got {matrix.tolist()}"
        )
    return float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 2]), float(matrix[1, 2])


def _pinhole_numbers(numbers: Any, camera: PinholeCamera) -> Any:
    numbers.fx, numbers.fy, numbers.cx, numbers.cy = camera.fx, camera.fy, camera.cx, camera.cy
    return numbers


def _brown_numbers(numbers: Any, camera: PinholeCamera) -> Any:
    lens = camera.lens
    _pinhole_numbers(numbers, camera)
    numbers.k1, numbers.k2, numbers.k3 = lens.k1, lens.k2, lens.k3
    numbers.p1, numbers.p2 = lens.p1, lens.p2
    numbers.max_square = lens.max_radius**2
    return numbers
