"""Panoramas, the natural pictures of a head that turns: columns are azimuths."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, TypeVar

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.camera import Camera, DepthKind, DeviceLens
from depthwarp.cameras.pose import Pose, PositionFrame
from depthwarp.checks import check_finite_vector, check_size
from depthwarp.errors import InputError

__all__ = ["CylindricalCamera", "EquirectangularCamera"]

Float64Array = npt.NDArray[np.float64]
AnyPanorama = TypeVar("AnyPanorama", bound="_Panorama")


@dataclass(frozen=True)
class _Panorama(Camera):
    """Columns are azimuths about the camera's Z axis, leftwards from the right border."""

    width: int
    height: int
    pose: Pose
    azimuths: float
    elevations: tuple[float, float]

    depth_kinds: ClassVar[tuple[DepthKind, ...]] = ("range",)
    ahead_only: ClassVar[bool] = False
    steepest: ClassVar[float]
    default_elevations: ClassVar[tuple[float, float]]

    def __post_init__(self) -> None:
        self._check_image()
        if not 0 < self.azimuths <= 360:
            raise InputError(
                f"azimuths must be above 0 and at most 360 degrees, got {self.azimuths}"
            )
        low, high = check_finite_vector("elevations", self.elevations, 2)
        if not -self.steepest <= low < high <= self.steepest:
            raise InputError(
                f"elevations must be (lowest, highest) from {-self.steepest:g} to "
                f"{self.steepest:g} degrees, got {low, high}"
            )
        object.__setattr__(self, "elevations", (low, high))

    @classmethod
    def looking(
        cls: type[AnyPanorama],
        size: Sequence[int],
        position: Sequence[float] = (0.0, 0.0, 0.0),
        orientation: Sequence[float] = (0.0, 0.0, 0.0),
        position_frame: PositionFrame = "world",
        azimuths: float = 360.0,
        elevations: Sequence[float] | None = None,
    ) -> AnyPanorama:
        """Panorama by where it stands; its middle column looks along `orientation`.

        Args:
            size: (width, height) [px].
            position: P_C [m].
            orientation: C_O = (roll, pitch, yaw) [degrees].
            position_frame: Frame of `position`, see `Pose.from_orientation`.
            azimuths: Width of the picture [degrees], at most 360.
            elevations: (lowest, highest) at the lower and upper border [degrees]; the class's
                default when None.

        Raises:
            InputError: A size or a number out of its range.
        """
        width, height = check_size(size)
        pose = Pose.from_orientation(position, orientation, position_frame)
        low, high = cls.default_elevations if elevations is None else elevations
        return cls(width, height, pose, azimuths, (low, high))

    @property
    def fx(self) -> float:
        """Columns a radian of azimuth."""
        return self.width / math.radians(self.azimuths)

    @property
    def cx(self) -> float:
        """Column of azimuth 0, straight ahead [px]."""
        return (self.width - 1) / 2

    @abstractmethod
    def rise_of(self, elevation: float) -> float:
        """What rows are proportional to, of an elevation [rad]."""

    @property
    def fy(self) -> float:
        """Rows a unit of rise."""
        low, high = (self.rise_of(math.radians(angle)) for angle in self.elevations)
        return self.height / (high - low)

    @property
    def cy(self) -> float:
        """Row of elevation 0 [px]."""
        return self.fy * self.rise_of(math.radians(self.elevations[1])) - 0.5

    @property
    def wraps(self) -> bool:
        """Whether the picture is a full turn."""
        return self.azimuths == 360

    def columns_of(self, points_camera: Float64Array) -> Float64Array:
        """Columns of points; where the picture is a full turn, its ends meet."""
        u = self.cx - self.fx * np.arctan2(points_camera[..., 1], points_camera[..., 0])
        if self.azimuths == 360:
            u = np.where(u < -0.5, u + self.width, u)
            u = np.where(u >= self.width - 0.5, u - self.width, u)
        return np.asarray(u)

    def numbers(self) -> Any:
        """The numbers that kernels take."""
        from depthwarp_kernels import lens_panorama

        numbers: Any = lens_panorama.PanoramaLens()
        numbers.fx, numbers.fy, numbers.cx, numbers.cy = self.fx, self.fy, self.cx, self.cy
        numbers.period = self.width if self.azimuths == 360 else 0
        numbers.least_v, numbers.most_v = self.row_limits()
        return numbers

    @cached_property
    def cull_limits(self) -> tuple[float, ...]:
        """Cosine and sine of the lowest and of the highest elevation, a pixel and more beyond."""
        low, high = (math.radians(angle) for angle in self.elevations)
        wider = 0.01 + (high - low) / self.height
        low, high = max(low - wider, -math.pi / 2), min(high + wider, math.pi / 2)
        return math.cos(low), math.sin(low), math.cos(high), math.sin(high)

    def row_limits(self) -> tuple[float, float]:
        """Least and greatest v of points: a pole at the image's border belongs to it."""
        low, high = self.elevations
        # So far below the border that adding a half in float32 does not round up to it.
        inside = self.height - 0.5 - max(self.height, 1) * 2.5e-7
        return (-0.5 if high == 90 else -math.inf), (inside if low == -90 else math.inf)


@dataclass(frozen=True)
class EquirectangularCamera(_Panorama):
    """Columns are azimuths, rows are elevations: the whole sphere in one picture.

    The middle column looks along the camera's X axis, columns to the left of it see what is left;
    of a full turn the first and the last column meet behind. Depth is the range.

    Attributes:
        width: Image width [px].
        height: Image height [px].
        pose: Where the panorama is seen from.
        azimuths: Width of the picture [degrees], at most 360.
        elevations: (lowest, highest) at the lower and upper border [degrees].

    Raises:
        InputError: A size that is not a positive whole number, or angles out of their range.

    Example:
        >>> import depthwarp as dw
        >>> camera = dw.EquirectangularCamera.looking((720, 360), position=(1, 2, 1.5))
        >>> round(camera.fx * 3.141592653589793)
        360
    """

    azimuths: float = 360.0
    elevations: tuple[float, float] = (-90.0, 90.0)

    steepest: ClassVar[float] = 90.0
    default_elevations: ClassVar[tuple[float, float]] = (-90.0, 90.0)

    def rise_of(self, elevation: float) -> float:
        """The elevation itself."""
        return elevation

    def image_of(self, points_camera: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Columns u and rows v of points in the camera frame; see `Camera.image_of`."""
        level = np.hypot(points_camera[..., 0], points_camera[..., 1])
        v = self.cy - self.fy * np.arctan2(points_camera[..., 2], level)
        return self.columns_of(points_camera), np.clip(v, *self.row_limits())

    def directions(self, u: npt.ArrayLike, v: npt.ArrayLike) -> Float64Array:
        """Unit vectors along the rays of pixels, in the camera frame; see `Camera.directions`."""
        azimuth = (self.cx - np.asarray(u, dtype=np.float64)) / self.fx
        elevation = (self.cy - np.asarray(v, dtype=np.float64)) / self.fy
        azimuth, elevation = np.broadcast_arrays(azimuth, elevation)
        level = np.cos(elevation)
        return np.stack(
            [level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)], axis=-1
        )

    def device_lens(self, first: int = 0) -> DeviceLens:
        """The lens as kernels take it; see `Camera.device_lens`."""
        from depthwarp_kernels import lens_panorama

        return DeviceLens(lens_panorama.EQUIRECTANGULAR, self.numbers(), np.empty(0, np.float32))


@dataclass(frozen=True)
class CylindricalCamera(_Panorama):
    """Columns are azimuths, rows are heights on a cylinder: upright lines stay straight.

    The middle column looks along the camera's X axis, columns to the left of it see what is left;
    of a full turn the first and the last column meet behind. Depth is the range.

    Attributes:
        width: Image width [px].
        height: Image height [px].
        pose: Where the panorama is seen from.
        azimuths: Width of the picture [degrees], at most 360.
        elevations: (lowest, highest) at the lower and upper border [degrees], within 89.

    Raises:
        InputError: A size that is not a positive whole number, or angles out of their range.

    Example:
        >>> import depthwarp as dw
        >>> camera = dw.CylindricalCamera.looking((720, 200), elevations=(-45, 45))
        >>> camera.cy
        99.5
    """

    azimuths: float = 360.0
    elevations: tuple[float, float] = (-45.0, 45.0)

    steepest: ClassVar[float] = 89.0
    default_elevations: ClassVar[tuple[float, float]] = (-45.0, 45.0)

    def rise_of(self, elevation: float) -> float:
        """The tangent of the elevation."""
        return math.tan(elevation)

    def image_of(self, points_camera: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Columns u and rows v of points in the camera frame; see `Camera.image_of`."""
        level = np.hypot(points_camera[..., 0], points_camera[..., 1])
        return self.columns_of(points_camera), self.cy - self.fy * (points_camera[..., 2] / level)

    def directions(self, u: npt.ArrayLike, v: npt.ArrayLike) -> Float64Array:
        """Unit vectors along the rays of pixels, in the camera frame; see `Camera.directions`."""
        azimuth = (self.cx - np.asarray(u, dtype=np.float64)) / self.fx
        rise = (self.cy - np.asarray(v, dtype=np.float64)) / self.fy
        azimuth, rise = np.broadcast_arrays(azimuth, rise)
        ray = np.stack([np.cos(azimuth), np.sin(azimuth), rise], axis=-1)
        unit: Float64Array = ray / np.sqrt(1 + rise * rise)[..., None]
        return unit

    def device_lens(self, first: int = 0) -> DeviceLens:
        """The lens as kernels take it; see `Camera.device_lens`."""
        from depthwarp_kernels import lens_panorama

        return DeviceLens(lens_panorama.CYLINDRICAL, self.numbers(), np.empty(0, np.float32))
