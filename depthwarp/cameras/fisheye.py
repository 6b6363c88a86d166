"""Fisheye lenses: distances in the image grow with the angle from the axis, not its tangent."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.camera import Camera, DeviceLens
from depthwarp.cameras.inversion import first_positive_root, invert_increasing
from depthwarp.cameras.limits import cone_limits
from depthwarp.cameras.pinhole import check_focal, intrinsics_of
from depthwarp.cameras.pose import Pose
from depthwarp.checks import check_finite_vector, check_size
from depthwarp.errors import InputError

__all__ = ["FisheyeCamera"]

Float64Array = npt.NDArray[np.float64]

NEWTON_STEPS = 8


@dataclass(frozen=True)
class FisheyeCamera(Camera):
    """The Kannala-Brandt fisheye in OpenCV's form (`cv2.fisheye`).

    A ray at the angle theta from the optical axis is drawn at the distance theta (1 + k1 theta^2 +
    k2 theta^4 + k3 theta^6 + k4 theta^8) from the principal point, times fx or fy. Its domain ends
    where that stops to grow, or at 180 degrees: points beside and behind the camera are drawn
    where the lens sees them, of z depth those up to 85 degrees. Source: Kannala, Brandt 2006.

    Attributes:
        fx: Focal length along columns [px/rad].
        fy: Focal length along rows [px/rad].
        cx: Principal point, column [px], pixel centres at whole numbers.
        cy: Principal point, row [px].
        width: Image width [px].
        height: Image height [px].
        pose: Where the camera stands and looks.
        distortion: (k1, k2, k3, k4); zeros for an equidistant lens.

    Raises:
        InputError: A focal length that is not above 0, a number that is not finite, a size that is
            not a positive whole number, or not four coefficients.

    Warns:
        LensDomainWarning: The lens's domain is smaller than the image.

    Example:
        >>> import depthwarp as dw
        >>> camera = dw.FisheyeCamera(300, 300, 319.5, 239.5, 640, 480, dw.Pose.from_orientation(
        ...     (0, 0, 1), (0, 0, 0)), (-0.01, 0.002, 0, 0))
        >>> camera.size
        (640, 480)
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    pose: Pose
    distortion: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)

    ahead_only: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_focal(self.fx, self.fy, self.cx, self.cy)
        self._check_image()
        coefficients = np.ravel(np.asarray(self.distortion, dtype=np.float64))
        if coefficients.size != 4:
            raise InputError(
                f"distortion must be the 4 fisheye coefficients (k1, k2, k3, k4), "
                f"got {coefficients.size}"
            )
        checked = check_finite_vector("distortion", coefficients.tolist(), 4)
        object.__setattr__(self, "distortion", checked)
        self.warn_of_lost_pixels()

    @classmethod
    def from_matrix(
        cls,
        K: npt.ArrayLike,
        size: Sequence[int],
        distortion: Sequence[float] | None = None,
        optical_from_world: npt.ArrayLike | None = None,
    ) -> FisheyeCamera:
        """Camera by OpenCV's intrinsic and extrinsic matrices.

        Args:
            K: Intrinsics, shape (3, 3): [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] [px].
            size: (width, height) [px].
            distortion: (k1, k2, k3, k4); zeros when None.
            optical_from_world: World to optical axes (X right, Y down, Z forward), shape (4, 4),
                column vectors [m]; the identity when None.

        Raises:
            InputError: As `PinholeCamera.from_matrix`.

        Warns:
            LensDomainWarning: The lens's domain is smaller than the image.
        """
        width, height = check_size(size)
        transform = np.eye(4) if optical_from_world is None else optical_from_world
        coefficients = (0.0,) * 4 if distortion is None else tuple(np.ravel(distortion).tolist())
        return cls(*intrinsics_of(K), width, height, Pose.from_optical(transform), coefficients)

    @property
    def K(self) -> Float64Array:
        """Intrinsic matrix [px], shape (3, 3), float64."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1]], np.float64)

    @cached_property
    def max_angle(self) -> float:
        """Greatest angle from the axis that is drawn [rad], at most pi."""
        k1, k2, k3, k4 = self.distortion
        growth = np.polynomial.Polynomial([1, 3 * k1, 5 * k2, 7 * k3, 9 * k4])
        return min(math.sqrt(first_positive_root(growth)), math.pi)

    def why_lost(self) -> str:
        """Why pixels are without a ray; see `Camera.why_lost`."""
        if self.max_angle < math.pi:
            return super().why_lost()
        return (
            "the lens's circle ends there, at 180 degrees from the axis; the pixels around it stay "
            "empty. If the lens does see them, fx and fy are too small"
        )

    def image_of(self, points_camera: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Columns u and rows v of points in the camera frame; see `Camera.image_of`."""
        x, y, z = np.moveaxis(points_camera, -1, 0)
        aside = np.hypot(y, z)
        theta = np.arctan2(aside, x)
        # Straight behind, at 180 degrees, a ray has no direction in the image.
        theta = np.where((theta <= self.max_angle) & ((aside > 0) | (x > 0)), theta, np.nan)
        scale = np.where(
            aside > 0, self._bend(theta) / np.where(aside > 0, aside, 1.0), 0.0 * theta
        )
        return self.cx - self.fx * (y * scale), self.cy - self.fy * (z * scale)

    def directions(self, u: npt.ArrayLike, v: npt.ArrayLike) -> Float64Array:
        """Unit vectors along the rays of pixels, in the camera frame; see `Camera.directions`."""
        right = (np.asarray(u, dtype=np.float64) - self.cx) / self.fx
        down = (np.asarray(v, dtype=np.float64) - self.cy) / self.fy
        right, down = np.broadcast_arrays(right, down)
        bent = np.hypot(right, down)
        with np.errstate(all="ignore"):
            theta = self._angle_of(bent)
            aside = np.where(bent > 0, np.sin(theta) / np.where(bent > 0, bent, 1.0), theta)
        return np.stack([np.cos(theta), -right * aside, -down * aside], axis=-1)

    @cached_property
    def cull_limits(self) -> tuple[float, ...]:
        """What the lens sees at most; see `Camera.cull_limits`."""
        return cone_limits(self, self.max_angle)

    def device_lens(self, first: int = 0) -> DeviceLens:
        """The lens as kernels take it; see `Camera.device_lens`."""
        from depthwarp_kernels import lens_fisheye

        numbers: Any = lens_fisheye.FisheyeLens()
        numbers.fx, numbers.fy, numbers.cx, numbers.cy = self.fx, self.fy, self.cx, self.cy
        numbers.k1, numbers.k2, numbers.k3, numbers.k4 = self.distortion
        numbers.max_angle = self.max_angle
        return DeviceLens(lens_fisheye.FISHEYE, numbers, np.empty(0, np.float32))

    def _bend(self, theta: Float64Array) -> Float64Array:
        k1, k2, k3, k4 = self.distortion
        square = theta * theta
        return theta * (1 + square * (k1 + square * (k2 + square * (k3 + square * k4))))

    def _angle_of(self, bent: Float64Array) -> Float64Array:
        """Angle that is drawn at a distance, by Newton; NaN beyond the domain."""
        k1, k2, k3, k4 = self.distortion
        theta = invert_increasing(self._bend, bent, self.max_angle)
        for _ in range(NEWTON_STEPS):
            square = theta * theta
            slope = 1 + square * (
                3 * k1 + square * (5 * k2 + square * (7 * k3 + square * (9 * k4)))
            )
            theta = theta - (self._bend(theta) - bent) / slope
        close = np.abs(self._bend(theta) - bent) <= 1e-10 * (1 + bent)
        inside = (theta >= 0) & (theta <= self.max_angle * (1 + 1e-12))
        return np.where(close & inside, theta, np.nan)
