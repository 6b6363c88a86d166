"""Which of many clouds each view looks at, and which points belong to which cloud."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp.errors import InputError
from depthwarp.rendering.handed import check_array

__all__ = ["CloudsOfViews"]


class CloudsOfViews:
    """Offsets of clouds in one array of points and the cloud of each view, on the device.

    Numbers of the host are checked and copied into arrays that are kept; those that are on the
    device are used where they are, and not looked at.

    Args:
        views: Number of views V.
        cloud_of: The cloud of each view, shape (V,); None where view v looks at cloud v.
        device: Warp device.

    Attributes:
        offsets: First point of each cloud and the end of the last, `wp.int32`, shape (C + 1,).
        cloud_of: The cloud of each view, `wp.int32`, shape (V,).

    Raises:
        InputError: `cloud_of` is not the number of a cloud for each view.
    """

    def __init__(self, views: int, cloud_of: Any, device: Any) -> None:
        self._views, self._device = views, device
        self._kept: dict[str, Any] = {}
        self._in_order = np.arange(views, dtype=np.int32)
        self._named = None if cloud_of is None else self._checked(cloud_of)
        self._seen: Any = None
        self.offsets: Any = None
        self.cloud_of: Any = None

    @property
    def are_named(self) -> bool:
        """Whether it was said which cloud each view looks at."""
        return self._named is not None

    def divide(self, points: int, offsets: Any, cloud_of: Any = None) -> None:
        """Divide so many points into clouds, which the views look at as before or anew.

        Raises:
            InputError: Offsets that fall or reach beyond the points; a view that looks at a cloud
                that there is not. Nothing has changed then.
        """
        rows = self._checked_offsets(offsets, points)
        clouds = len(rows) - 1
        named = self._named if cloud_of is None else self._checked(cloud_of)
        if named is None and clouds != self._views:
            raise InputError(
                f"offsets divide the points into {clouds} clouds for {self._views} views: "
                "cloud_of must say which of them each view looks at"
            )
        seen = self._in_order if named is None else named
        if isinstance(seen, np.ndarray) and seen.max() >= clouds:
            raise InputError(
                f"cloud_of[{seen.argmax()}] is cloud {seen.max()}, and offsets divide the points "
                f"into {clouds} clouds"
            )
        self.offsets = self._on_device("offsets", rows)
        if seen is not self._seen:
            self.cloud_of = self._on_device("cloud_of", seen)
        self._named, self._seen = named, seen

    def _checked(self, cloud_of: Any) -> Any:
        """The cloud of each view, where it is."""
        if isinstance(cloud_of, wp.array):
            return check_array("cloud_of", cloud_of, wp.int32, self._device, (self._views,))
        rows = _whole_numbers("cloud_of", cloud_of)
        if len(rows) != self._views:
            raise InputError(
                f"cloud_of must be one cloud for each of {self._views} views, got {len(rows)}"
            )
        for view in np.flatnonzero((rows < 0) | (rows > np.iinfo(np.int32).max))[:1].tolist():
            raise InputError(f"cloud_of[{view}] must be the number of a cloud, got {rows[view]}")
        return rows.astype(np.int32)

    def _checked_offsets(self, offsets: Any, points: int) -> Any:
        """Offsets where they are: those of the host rising, and within the points."""
        on_device = isinstance(offsets, wp.array)
        if on_device:
            rows = check_array("offsets", offsets, wp.int32, self._device)
        else:
            rows = _whole_numbers("offsets", offsets)
        if len(rows) < 2:
            raise InputError(
                "offsets must be the first point of each cloud and the end of the last, at least "
                f"two numbers, got {len(rows)}"
            )
        if on_device:
            return rows
        for cloud in np.flatnonzero(np.diff(rows) < 0)[:1].tolist():
            raise InputError(
                f"offsets must not fall: offsets[{cloud}] = {rows[cloud]}, "
                f"offsets[{cloud + 1}] = {rows[cloud + 1]}"
            )
        if rows[0] < 0 or rows[-1] > points:
            raise InputError(
                f"offsets must lie from 0 to the {points} points, got {rows[0]} to {rows[-1]}"
            )
        return rows.astype(np.int32)

    def _on_device(self, name: str, rows: Any) -> Any:
        """Numbers on the device, in an array that is kept while their count stays the same."""
        if isinstance(rows, wp.array):
            return rows
        kept = self._kept.get(name)
        if kept is None or kept.shape[0] != len(rows):
            kept = self._kept[name] = wp.array(rows, dtype=wp.int32, device=self._device)
        else:
            kept.assign(rows)
        return kept


def _whole_numbers(name: str, values: npt.ArrayLike) -> npt.NDArray[np.int64]:
    numbers = np.asarray(values)
    if numbers.ndim != 1 or numbers.dtype.kind not in "iu":
        raise InputError(
            f"{name} must be whole numbers of one dimension, got {numbers.dtype} of {numbers.shape}"
        )
    return numbers.astype(np.int64)
