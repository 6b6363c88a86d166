"""Points of many worlds: which rows of one array are a world's own."""

from __future__ import annotations

from typing import Any

import warp as wp

from depthwarp import arrays
from depthwarp.errors import InputError
from depthwarp.sim.handed import adopt
from depthwarp.sim.status import DeviceStatus
from depthwarp_kernels import spans as kernels

__all__ = ["MOST_POINTS", "WorldPoints"]

MOST_POINTS = (1 << 31) - (1 << 16)
"""Points that 32-bit numbers can count, and some more that threads count on beyond the end."""

LANES = 1024
"""Threads on CUDA that count what stands before their worlds."""


class WorldPoints:
    """Points as they are handed to a step, and the span of each world among them.

    Args:
        worlds: Number of worlds W.
        most: Most points of a world.
        device: Warp device.
        status: Where surplus points are noted.

    Attributes:
        spans: Begin and end of each world's points, `wp.vec2i`, shape (W,).
    """

    def __init__(self, worlds: int, most: int, device: Any, status: DeviceStatus) -> None:
        self._worlds, self._most, self._device = worlds, most, device
        self._status = status
        self._lanes = min(worlds, LANES) if device.is_cuda else 1
        self.spans = arrays.zeros(worlds, wp.vec2i, device)
        self._all_rows: Any = wp.launch(
            kernels.spans_of_rows,
            dim=worlds,
            inputs=[0],
            outputs=[self.spans],
            device=device,
            record_cmd=True,
        )
        self._none = arrays.zeros(1, wp.vec3f, device)

    def take(self, points: Any, counts: Any) -> Any:
        """Find the spans of a step's points.

        Args:
            points: As in `DepthSensor.step`.
            counts: As in `DepthSensor.step`.

        Returns:
            All worlds' points, `wp.vec3f`, shape (N,).

        Raises:
            InputError: Another shape, type or device; or points one behind the other without
                counts.
        """
        if points is None:
            self._take_all(0)
            return self._none
        if _has_rows(points):
            return self._take_rows(points, counts)
        if counts is None:
            raise InputError(
                "counts are missing: how many of the points, one world behind the other, are each "
                f"world's; or hand points of the shape ({self._worlds}, P, 3)"
            )
        rows = adopt("points", points, wp.vec3f, (None,), self._device)
        _check_total(rows.shape[0])
        self._launch(
            kernels.spans_of_counts,
            self._lanes,
            [self._counts(counts), rows.shape[0], self._most, -(-self._worlds // self._lanes)],
        )
        return rows

    def _take_rows(self, points: Any, counts: Any) -> Any:
        """Points of the shape (W, P, 3)."""
        rows = adopt("points", points, wp.vec3f, (self._worlds, None), self._device)
        stride = rows.shape[1]
        _check_total(self._worlds * stride)
        if stride > self._most:
            raise InputError(
                f"points have {stride} rows a world, more than this sensor's "
                f"max_points_per_world = {self._most}"
            )
        if counts is None:
            self._take_all(stride)
        else:
            self._launch(kernels.spans_of_worlds, self._worlds, [self._counts(counts), stride])
        return rows.reshape(rows.shape[0] * stride)

    def _counts(self, counts: Any) -> Any:
        return adopt("counts", counts, wp.int32, (self._worlds,), self._device)

    def _take_all(self, stride: int) -> None:
        """All rows of all worlds. A launch, so that a captured graph has it too."""
        self._all_rows.set_param_at_index(0, stride)
        self._all_rows.launch()

    def _launch(self, kernel: Any, dim: int, inputs: list[Any]) -> None:
        wp.launch(
            kernel,
            dim=dim,
            inputs=inputs,
            outputs=[self.spans, self._status.flags, self._status.surplus],
            device=self._device,
        )


def _check_total(points: int) -> None:
    if points > MOST_POINTS:
        raise InputError(f"{points} points in all are more than {MOST_POINTS}")


def _has_rows(points: Any) -> bool:
    """Whether points are those of each world in a row of its own, (W, P, 3), and not (N, 3)."""
    inner = getattr(getattr(points, "dtype", None), "_shape_", ())  # of Warp's vectors
    return len(getattr(points, "shape", ())) + len(inner) == 3
