"""A point cloud: positions in metres and named attributes, one row a point."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError

if TYPE_CHECKING:
    from depthwarp.prepared import PreparedCloud

__all__ = ["MAX_POINTS", "PointCloud", "to_float32_points"]

MAX_POINTS = 2**31 - 1
"""Most points of one cloud: a depth map's winner index is int32."""

MAX_ROUNDING_M = 1e-3
"""Largest move [m] of a coordinate that storing it as float32 may cause."""


def to_float32_points(
    points: npt.NDArray[Any], *, name: str = "points_world"
) -> npt.NDArray[np.float32]:
    """Return (N, 3) coordinates as C-contiguous float32, refusing a loss that could be seen.

    Args:
        points: Coordinates [m], shape (N, 3), float32 or float64.
        name: What the array is called in error messages.

    Raises:
        InputError: Wrong shape or dtype, more than `MAX_POINTS` rows, or float64 coordinates so
            large that float32 would move a point by more than 1 mm (map coordinates such as UTM).
    """
    if points.ndim != 2 or points.shape[1] != 3:
        raise InputError(f"{name} must have shape (N, 3), got {points.shape}")
    if points.shape[0] > MAX_POINTS:
        raise InputError(
            f"{name} has {points.shape[0]} points, at most {MAX_POINTS} fit one cloud: split it"
        )
    if points.dtype == np.float32:
        return np.ascontiguousarray(points)
    if points.dtype != np.float64:
        raise InputError(
            f"{name} must be float32 or float64, got {points.dtype}: convert it, "
            "points.astype(np.float32)"
        )
    with np.errstate(over="ignore"):
        rounded = points.astype(np.float32)
    with np.errstate(invalid="ignore"):
        moved = np.abs(rounded.astype(np.float64) - points)
    worst = float(np.max(moved, initial=0.0, where=np.isfinite(points)))
    if worst > MAX_ROUNDING_M:
        raise InputError(
            f"{name}: float32 would move a point by {worst:.3g} m; subtract an offset near the "
            "cloud first (dw.read(..., offset=(x, y, z)), on the command line --offset X Y Z)"
        )
    return np.ascontiguousarray(rounded)


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points in the world frame (right-handed, Z up) with named attributes.

    Attributes:
        points_world: Coordinates [m], shape (N, 3), float32. A float64 array is accepted and
            rounded, unless that would move a point by more than 1 mm. NaN and infinite points are
            kept (their index counts); rendering skips and counts them.
        attributes: Arrays with one row a point, by name. The readers use `color` (N, 3) uint8,
            `intensity` (N,), `normals` (N, 3) float32, `ring` (N,), `time` (N,), and keep
            every other field under its own name.

    Raises:
        InputError: Wrong shape or dtype, or an attribute with another number of rows.

    Example:
        >>> import numpy as np, depthwarp as dw
        >>> cloud = dw.PointCloud(np.zeros((4, 3), np.float32), {"ring": np.arange(4)})
        >>> len(cloud[cloud.attributes["ring"] > 1])
        2
    """

    points_world: npt.NDArray[np.float32]
    attributes: Mapping[str, npt.NDArray[Any]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "points_world", to_float32_points(np.asarray(self.points_world)))
        attributes = {name: np.asarray(values) for name, values in self.attributes.items()}
        for name, values in attributes.items():
            if name == "points":
                raise InputError("attribute name 'points' is taken by the coordinates: rename it")
            if values.ndim == 0 or values.shape[0] != len(self):
                raise InputError(
                    f"attribute '{name}' must have {len(self)} rows, one a point, "
                    f"got shape {values.shape}"
                )
        object.__setattr__(self, "attributes", attributes)

    def __len__(self) -> int:
        """Number of points."""
        return int(self.points_world.shape[0])

    def __getitem__(self, selection: npt.NDArray[Any] | slice) -> PointCloud:
        """The points that a boolean mask, an index array or a slice selects, with attributes."""
        return PointCloud(
            self.points_world[selection],
            {name: values[selection] for name, values in self.attributes.items()},
        )

    def __iter__(self) -> Iterator[Any]:
        """Not iterable: row-by-row loops over a cloud are a mistake; use `points_world`."""
        raise TypeError("PointCloud is not iterable: use cloud.points_world")

    def prepare(
        self, *, device: str | None = None, max_error: float | None = None
    ) -> PreparedCloud:
        """Sort the cloud into blocks that views can skip: worth it from a few views on.

        Args:
            device: Where it will be rendered; None is Warp's default device.
            max_error: What each coordinate of a point may move by [m], e.g. 0.001, so that most
                points take 4 bytes in the place of 12. None keeps them as they are.

        Returns:
            A copy of the points on the device, which `dw.render` and `dw.render_batch` take in the
            place of the cloud; the maps are the same bit for bit, with `max_error` those of its
            `points_world()`.

        Raises:
            InputError: `max_error` is not a finite number above 0.
            DeviceError: The device is not on this machine.
            CapacityError: It does not fit the device's memory.
        """
        from depthwarp.prepared import PreparedCloud

        return PreparedCloud(self, device, max_error)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the points and all attributes to a file; its suffix chooses the format.

        `.ply` is binary little-endian and opens everywhere; `.npz` holds `points` and one array
        for each attribute, with every dtype kept. The file appears whole or not at all.

        Raises:
            InputError: An unknown suffix, an attribute that the format cannot hold, or a path that
                cannot be written.
        """
        from depthwarp.io import write

        write(self, path)

    def __repr__(self) -> str:
        """Number of points and the attributes' names."""
        names = ", ".join(self.attributes) or "no attributes"
        return f"PointCloud({len(self)} points; {names})"
