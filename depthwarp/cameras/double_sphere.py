"""The double sphere camera: a fisheye whose projection and inverse need no trigonometry."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.camera import Camera, DeviceLens
from depthwarp.cameras.limits import cone_limits
from depthwarp.cameras.pinhole import check_focal
from depthwarp.cameras.pose import Pose
from depthwarp.errors import InputError

__all__ = ["DoubleSphereCamera"]

Float64Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class DoubleSphereCamera(Camera):
    """A double sphere camera (Usenko, Demmel, Cremers 2018), equations (40) to (50) there.

    It sees beside and behind itself as far as its numbers let it, of z depth up to 85 degrees.

    Attributes:
        fx: Focal length along columns [px].
        fy: Focal length along rows [px].
        cx: Principal point, column [px], pixel centres at whole numbers.
        cy: Principal point, row [px].
        xi: Displacement of the second sphere, above -1 and below 1.
        alpha: Displacement of the pinhole, from 0 to below 1.
        width: Image width [px].
        height: Image height [px].
        pose: Where the camera stands and looks.

    Raises:
        InputError: A number out of its range or not finite.

    Warns:
        LensDomainWarning: The lens's domain is smaller than the image.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    xi: float
    alpha: float
    width: int
    height: int
    pose: Pose

    ahead_only: ClassVar[bool] = False

    def __post_init__(self) -> None:
        check_focal(self.fx, self.fy, self.cx, self.cy)
        if not -1 < self.xi < 1:
            raise InputError(f"xi must be above -1 and below 1, got {self.xi}")
        if not 0 <= self.alpha < 1:
            raise InputError(f"alpha must be from 0 to below 1, got {self.alpha}")
        self._check_image()
        self.warn_of_lost_pixels()

    @property
    def least_cosine(self) -> float:
        """Cosine of the greatest angle from the axis that is drawn.

        The edge is a ray from the second sphere's centre: below an alpha of 1/2 the one that the
        pinhole sees at infinity, above it the one that is drawn farthest out. The paper's (44) is
        an approximation: for a negative xi and a small alpha it lets in points that fold back.
        """
        alpha, xi = self.alpha, self.xi
        cosine = -alpha / (1 - alpha) if alpha <= 0.5 else -(1 - alpha) / alpha
        # Where that ray meets the unit sphere about the first centre, xi behind the second.
        way = xi * cosine + math.sqrt(1 - xi * xi * (1 - cosine * cosine))
        return way * cosine - xi

    def image_of(self, points_camera: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Columns u and rows v of points in the camera frame; see `Camera.image_of`."""
        x, y, z = np.moveaxis(points_camera, -1, 0)
        distance = np.sqrt(x * x + y * y + z * z)
        x = np.where(x > self.least_cosine * distance, x, np.nan)
        forward = self.xi * distance + x
        second = np.sqrt(y * y + z * z + forward * forward)
        below = self.alpha * second + (1 - self.alpha) * forward
        return self.cx - self.fx * (y / below), self.cy - self.fy * (z / below)

    def directions(self, u: npt.ArrayLike, v: npt.ArrayLike) -> Float64Array:
        """Unit vectors along the rays of pixels, in the camera frame; see `Camera.directions`."""
        right = (np.asarray(u, dtype=np.float64) - self.cx) / self.fx
        down = (np.asarray(v, dtype=np.float64) - self.cy) / self.fy
        right, down = np.broadcast_arrays(right, down)
        alpha, xi, square = self.alpha, self.xi, right * right + down * down
        with np.errstate(all="ignore"):
            root = np.sqrt(1 - (2 * alpha - 1) * square)
            forward = (1 - alpha * alpha * square) / (alpha * root + 1 - alpha)
            way = forward * xi + np.sqrt(forward * forward + (1 - xi * xi) * square)
            way = way / (forward * forward + square)
        ray = np.stack([way * forward - xi, -way * right, -way * down], axis=-1)
        # Beyond the domain the formulas go on and give rays that are drawn elsewhere.
        ray[~(ray[..., 0] > self.least_cosine)] = np.nan
        return ray

    @cached_property
    def cull_limits(self) -> tuple[float, ...]:
        """What the lens sees at most; see `Camera.cull_limits`."""
        return cone_limits(self, math.acos(max(self.least_cosine, -1.0)))

    def device_lens(self, first: int = 0) -> DeviceLens:
        """The lens as kernels take it; see `Camera.device_lens`."""
        from depthwarp_kernels import lens_fisheye

        numbers: Any = lens_fisheye.DoubleSphereLens()
        numbers.fx, numbers.fy, numbers.cx, numbers.cy = self.fx, self.fy, self.cx, self.cy
        numbers.xi, numbers.alpha = self.xi, self.alpha
        numbers.least_cosine = self.least_cosine
        return DeviceLens(lens_fisheye.DOUBLE_SPHERE, numbers, np.empty(0, np.float32))
