"""Views of one plan: their cameras, and the arrays in which kernels read them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import warp as wp

from depthwarp.cameras import Camera
from depthwarp.cameras.camera import DeviceLens
from depthwarp.errors import InputError
from depthwarp.rendering.config import RenderConfig
from depthwarp_kernels.view import View

__all__ = ["DeviceViews", "ViewPlan"]

FLOAT32_MAX = float(np.finfo(np.float32).max)


@dataclass(frozen=True)
class ViewPlan:
    """One view: its camera and, where the paper's segmentation selects the points, its rectangles.

    Attributes:
        camera: Pose and lens.
        line_count: Number of rectangles N_L of (8)(9); 0 without segmentation.
        steps: Growth of the rectangles (7) [m].
    """

    camera: Camera
    line_count: int = 0
    steps: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @cached_property
    def lens(self) -> DeviceLens:
        """The camera's lens as kernels take it, for a table that begins all tables."""
        return self.camera.device_lens()


class DeviceViews:
    """V views on a device, all of one lens model and image size.

    Args:
        views: The views.
        config: Depth kind and bounds.
        device: Warp device.
        culls: Whether kernels ask which blocks of a cloud a view may see; what they need for that
            takes the host longer than all the rest.

    Attributes:
        model: The `LensModel` of all of them.
        size: (width, height) [px].
        count: Number of views V.
        has_range_views: Whether (8)(9) select the points.
        arrays: `View`s, the model's structs and the lenses' tables: the kernels' first arguments.

    Raises:
        InputError: No view; views of different models or sizes, or with and without segmentation;
            or a model without the kind of depth that is asked for.
    """

    def __init__(
        self, views: Sequence[ViewPlan], config: RenderConfig, device: Any, culls: bool = True
    ) -> None:
        if len({(view.camera.size, view.line_count > 0) for view in views}) != 1:
            raise InputError(
                "views must be at least one, all of one image size, all with or all without "
                "segmentation"
            )
        self._config, self._culls = config, culls
        self.size = views[0].camera.size
        self.count = len(views)
        self.has_range_views = views[0].line_count > 0
        self.model = views[0].lens.model
        numbers, lenses, table = self._host_arrays(views)
        self.arrays: list[Any] = [
            wp.array(numbers, dtype=View, device=device),
            wp.array(lenses, dtype=self.model.struct, device=device),
            wp.array(table, dtype=wp.float32, device=device),
        ]

    def replace(self, views: Sequence[ViewPlan]) -> None:
        """Look from elsewhere: as many views of the same model and size.

        Raises:
            InputError: Another number of views, another model or size.
        """
        same = {(view.camera.size, view.line_count > 0) for view in views}
        if len(views) != self.count or same != {(self.size, self.has_range_views)}:
            raise InputError(
                f"a plan of {self.count} views of {self.size[0]} x {self.size[1]} px can only look "
                "from elsewhere with as many of that size: make another plan"
            )
        for array, values in zip(self.arrays, self._host_arrays(views), strict=True):
            array.assign(values)

    def _host_arrays(self, views: Sequence[ViewPlan]) -> tuple[Any, Any, Any]:
        """Views, lenses and tables as NumPy arrays."""
        struct: Any = View
        numbers: Any = np.zeros(len(views), struct.numpy_dtype())
        lenses: list[Any] = []
        tables: list[np.ndarray[Any, np.dtype[np.float32]]] = []
        first = 0
        for row, view in zip(numbers, views, strict=True):
            view.camera.check_kind(self._config.depth)
            lens = view.camera.device_lens(first) if first else view.lens
            first += len(lens.table)
            if lens.model is not self.model:
                raise InputError("views of one plan must all be of one camera model")
            lenses.append(lens.numbers)
            tables.append(lens.table)
            _fill(row, view, self._config)
            if self._culls:
                limits = view.camera.cull_limits
                row["limits"][: len(limits)] = limits
        # Never empty: of an empty array a compiler does not know that its numbers adjoin.
        table = np.concatenate([*tables, [0]]).astype(np.float32)
        return numbers, wp.array(lenses, dtype=self.model.struct, device="cpu").numpy(), table


def _fill(row: Any, plan: ViewPlan, config: RenderConfig) -> None:
    """Write a view's numbers into a record of the `View` struct."""
    camera, pose = plan.camera, plan.camera.pose
    row["rotation"] = pose.camera_from_world
    row["position"], row["shift"] = pose.position, pose.shift
    row["width"], row["height"] = camera.size
    row["min_range"] = config.min_range
    row["max_range"] = min(config.max_range, FLOAT32_MAX)  # a range that overflows is too far
    row["line_count"], row["steps"] = plan.line_count, plan.steps
