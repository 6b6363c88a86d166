"""What every camera model has in common: a size, a pose, a projection and its inverse."""

from __future__ import annotations

import copy
import math
import warnings
from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any, ClassVar, Literal, NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.pose import Pose, check_pose
from depthwarp.checks import check_choice, check_points, check_size
from depthwarp.errors import InputError, LensDomainWarning

__all__ = ["Camera", "DepthImage", "DepthKind", "DeviceLens"]

DepthKind = Literal["range", "z"]
"""`range`: distance along the ray, for most models the Euclidean distance from the camera's centre.
`z`: distance along the optical axis; of a lens that sees beside itself only up to 85 degrees from
the axis: near 90 degrees z goes to 0 whatever the distance."""

Float64Array = npt.NDArray[np.float64]
AnyCamera = TypeVar("AnyCamera", bound="Camera")

DOMAIN_GRID = 65
"""Pixels a side at which a lens's domain is compared with its image."""

PITCH_GRID = 17
"""Pixels a side at which the way between neighbours is measured."""

LEAST_Z_COSINE = math.cos(math.radians(85))
"""Where z depth ends for lenses that see beside themselves, as in the kernel."""


@runtime_checkable
class DepthImage(Protocol):
    """Anything with a depth and its kind, as `DepthMap`."""

    @property
    def depth(self) -> npt.NDArray[np.float32]:
        """Depth [m], shape (H, W), 0 = empty."""
        ...

    @property
    def kind(self) -> DepthKind:
        """Which depth it is."""
        ...


class DeviceLens(NamedTuple):
    """A lens as kernels take it.

    Attributes:
        model: A `depthwarp_kernels.lens.LensModel`.
        numbers: Instance of the model's struct.
        table: Further numbers, shape (M,), float32; empty for most models.
    """

    model: Any
    numbers: Any
    table: npt.NDArray[np.float32]


class Camera(ABC):
    """A camera model: where it stands, the size of its image, and which ray a pixel sees.

    Models are frozen dataclasses with the fields `width`, `height` [px] and `pose`. Pixel centres
    are at whole numbers: the image spans u from -0.5 to width - 0.5. The camera frame is the
    paper's: X forward, Y left, Z up. A model has a domain: a point outside it has no pixel.
    """

    width: int
    height: int
    pose: Pose
    depth_kinds: ClassVar[tuple[DepthKind, ...]] = ("range", "z")
    """The kinds of depth that the model has."""
    ahead_only: ClassVar[bool] = True
    """Whether the model sees nothing beside and behind itself."""

    @abstractmethod
    def image_of(self, points_camera: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Columns u and rows v of points in the camera frame.

        Args:
            points_camera: Points [m], shape (..., 3), float64.

        Returns:
            u and v [px], each shape (...), float64, NaN outside the domain.
        """

    @abstractmethod
    def directions(self, u: npt.ArrayLike, v: npt.ArrayLike) -> Float64Array:
        """Unit vectors along the rays of pixels, in the camera frame.

        Args:
            u: Columns [px], shape (...).
            v: Rows [px], shape (...).

        Returns:
            Shape (..., 3), float64, NaN where no ray of the domain meets the pixel.
        """

    @abstractmethod
    def device_lens(self, first: int = 0) -> DeviceLens:
        """The lens as kernels take it; its table will begin at number `first` of all tables."""

    def _check_image(self) -> None:
        """Refuse a pose or size that is none, and make the size plain numbers.

        Raises:
            InputError: The pose is no `Pose`, or the size not two positive whole numbers.
        """
        check_pose("pose", self.pose)
        width, height = check_size((self.width, self.height))
        object.__setattr__(self, "width", width)
        object.__setattr__(self, "height", height)

    @property
    def size(self) -> tuple[int, int]:
        """Image size (width, height) [px]."""
        return self.width, self.height

    @cached_property
    def cull_limits(self) -> tuple[float, ...]:
        """At most 16 numbers: what the lens sees, as its model's culling reads them."""
        return ()

    @cached_property
    def pixel_pitch(self) -> tuple[float, float]:
        """Way between neighbouring pixels in the scene: (for each metre of depth, constant [m]).

        At a depth z two neighbours are `z * pitch[0] + pitch[1]` metres apart, across their rays.
        Measured in the middle of the image, or as near to it as the lens has rays, along columns
        or rows, whichever is wider. Filters scale their slopes with it.
        """
        columns, rows = (np.unique(np.linspace(0, side - 1, PITCH_GRID)) for side in self.size)
        v, u = (grid.ravel() for grid in np.meshgrid(rows, columns, indexing="ij"))
        nearest = np.argsort(np.hypot(u - columns.mean(), v - rows.mean()), kind="stable")
        u, v = u[nearest], v[nearest]
        # Backwards at the last row, which has no next one.
        beside = np.where(v + 1 <= self.height - 1, v + 1, np.maximum(v - 1, 0))
        rays = self.directions(u, v)
        steps = [self.directions(u + 1, v) - rays, self.directions(u, beside) - rays]
        angles = np.max([np.linalg.norm(step, axis=-1) for step in steps], axis=0)
        seen = angles[np.isfinite(angles)]
        return (float(seen[0]) if seen.size else 0.0), 0.0

    @property
    def wraps(self) -> bool:
        """Whether the first and the last column are neighbours, as those of a full turn are."""
        return False

    def with_pose(self: AnyCamera, pose: Pose) -> AnyCamera:
        """The same lens at another place.

        Raises:
            InputError: Not a `Pose`.
        """
        check_pose("pose", pose)
        camera = copy.copy(self)  # not made anew: nothing of the lens is checked or computed again
        object.__setattr__(camera, "pose", pose)
        return camera

    def to_camera(self, points_world: npt.NDArray[np.floating]) -> Float64Array:
        """World points, shape (N, 3), in the camera frame, float64."""
        return self.pose.to_camera(points_world)

    def to_world(self, points_camera: Float64Array, u: Float64Array) -> Float64Array:
        """Points of the camera frame, shape (..., 3), seen in columns u, in the world frame."""
        return self.pose.to_world(points_camera)

    def depth_of(self, points_camera: Float64Array, kind: DepthKind) -> Float64Array:
        """Depth of points in the camera frame [m], shape (...)."""
        if kind == "z":
            return points_camera[..., 0]
        distance: Float64Array = np.linalg.norm(points_camera, axis=-1)
        return distance

    def points_of(
        self, u: Float64Array, v: Float64Array, depth: Float64Array, kind: DepthKind
    ) -> Float64Array:
        """Points of the camera frame that pixels see at a depth, shape (..., 3)."""
        rays = self.directions(u, v)
        if kind != "z":
            return rays * depth[..., None]
        least = 0.0 if self.ahead_only else LEAST_Z_COSINE
        ahead = np.where(rays[..., 0] > least, rays[..., 0], np.nan)
        return rays * (depth / ahead)[..., None]

    def project(
        self, points_world: npt.NDArray[np.floating], depth: DepthKind = "range"
    ) -> tuple[Float64Array, Float64Array, Float64Array, npt.NDArray[np.bool_]]:
        """Project points in float64: the reference of the kernels.

        Args:
            points_world: Points [m], shape (N, 3).
            depth: Which depth to return.

        Returns:
            Columns u [px], rows v [px] and depth [m], each (N,) float64, NaN where the point is
            outside the lens's domain, at the camera's centre or not finite, or has no z (see
            `DepthKind`); and a mask (N,), true
            where the pixel `(floor(u + 0.5), floor(v + 0.5))` lies in the image.

        Raises:
            InputError: Points of another shape, or a kind of depth that the model does not have.
        """
        self.check_kind(depth)
        with np.errstate(all="ignore"):
            points = self.to_camera(check_points(points_world))
            points[~np.isfinite(points).all(axis=1)] = np.nan
            points[(points == 0).all(axis=1)] = np.nan  # at the centre: in no direction
            if depth == "z":
                wide = not self.ahead_only
                least = LEAST_Z_COSINE * np.linalg.norm(points, axis=1) if wide else 0.0
                points[points[:, 0] <= least] = np.nan
            u, v = self.image_of(points)
            distance = np.where(np.isnan(u), np.nan, self.depth_of(points, depth))
            column, row = np.floor(u + 0.5), np.floor(v + 0.5)
            valid = (column >= 0) & (column < self.width) & (row >= 0) & (row < self.height)
        return u, v, distance, valid

    def unproject(
        self, depth: npt.ArrayLike | DepthImage, kind: DepthKind = "range"
    ) -> Float64Array:
        """The world points that an image of depths shows: the inverse of `project`.

        Args:
            depth: Depth [m], shape (height, width), 0 or not finite where empty; or a `DepthMap`,
                which knows its kind.
            kind: Which depth an array holds.

        Returns:
            Points on the rays through the pixels' centres [m], shape (height, width, 3), float64;
            NaN where the image is empty, no ray meets the pixel, or its ray has no z.

        Raises:
            InputError: Another shape than the camera's, or a kind that the model does not have.
        """
        image: Any = depth
        if isinstance(image, DepthImage):
            image, kind = image.depth, image.kind
        self.check_kind(kind)
        metres = np.asarray(image, dtype=np.float64)
        if metres.shape != (self.height, self.width):
            raise InputError(
                f"depth must have the camera's shape (height, width) = {self.height, self.width}, "
                f"got {metres.shape}"
            )
        grid = np.indices(metres.shape, dtype=np.float64)
        v, u = grid[0], grid[1]
        with np.errstate(all="ignore"):
            metres = np.where(np.isfinite(metres) & (metres > 0), metres, np.nan)
            return self.to_world(self.points_of(u, v, metres, kind), u)

    def check_kind(self, kind: DepthKind) -> None:
        """Refuse a kind of depth that the model does not have.

        Raises:
            InputError: The kind is unknown, or the model has no optical axis to measure along.
        """
        check_choice("depth", kind, ("range", "z"))
        if kind not in self.depth_kinds:
            raise InputError(
                f"{type(self).__name__} has no optical axis to measure depth='z' along: use "
                "depth='range'"
            )

    def lost_share(self) -> float:
        """Share of the image's pixels that no ray of the lens's domain meets, on a grid."""
        columns = np.linspace(0, self.width - 1, min(DOMAIN_GRID, self.width))
        rows = np.linspace(0, self.height - 1, min(DOMAIN_GRID, self.height))
        u, v = np.meshgrid(columns, rows)
        return float(np.isnan(self.directions(u, v)[..., 0]).mean())

    def why_lost(self) -> str:
        """Why pixels are without a ray, and what to do if that should not be."""
        return (
            "the lens model ends or folds back before; those pixels stay empty. If the lens does "
            "see them, check the coefficients and their order, or calibrate with views up to the "
            "corners"
        )

    def warn_of_lost_pixels(self) -> None:
        """Warn where the domain is smaller than the image: some pixels will never be drawn."""
        share = self.lost_share()
        if share > 0:
            # Of larger images the share is that of the grid's pixels.
            about = "about " if max(self.size) > DOMAIN_GRID else ""
            warnings.warn(
                f"{type(self).__name__}: no ray reaches {about}{max(share, 0.001):.1%} of the "
                f"{self.width} x {self.height} image: {self.why_lost()}",
                LensDomainWarning,
                stacklevel=4,
            )
