"""Views of one plan: their cameras, and the arrays in which kernels read them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from depthwarp import arrays
from depthwarp.cameras import Camera
from depthwarp.errors import InputError
from depthwarp.rendering.config import RenderConfig
from depthwarp_kernels.view import Limits, View

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


class DeviceViews:
    """V views on a device, all of one lens model and image size.

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

    def __init__(self, views: Sequence[ViewPlan], config: RenderConfig, device: Any) -> None:
        if len({(view.camera.size, view.line_count > 0) for view in views}) != 1:
            raise InputError(
                "views must be at least one, all of one image size, all with or all without "
                "segmentation"
            )
        lenses: list[Any] = []
        tables: list[np.ndarray[Any, np.dtype[np.float32]]] = []
        limits: list[tuple[float, ...]] = []
        models = set()
        for view in views:
            view.camera.check_kind(config.depth)
            lens = view.camera.device_lens(first=sum(map(len, tables)))
            models.add(lens.model)
            lenses.append(lens.numbers)
            tables.append(lens.table)
            limits.append(lens.limits)
        if len(models) != 1:
            raise InputError("views of one plan must all be of one camera model")
        self.model = models.pop()
        self.size = views[0].camera.size
        self.count = len(views)
        self.has_range_views = views[0].line_count > 0
        structs = [
            _view_struct(view, config, lens_limits)
            for view, lens_limits in zip(views, limits, strict=True)
        ]
        self.arrays: list[Any] = [
            wp.array(structs, dtype=View, device=device),
            wp.array(lenses, dtype=self.model.struct, device=device),
            # Never empty: of an empty array a compiler does not know that its numbers adjoin.
            arrays.share(np.concatenate([*tables, [0]]).astype(np.float32), wp.float32, device),
        ]


def _view_struct(plan: ViewPlan, config: RenderConfig, limits: tuple[float, ...]) -> Any:
    camera, pose = plan.camera, plan.camera.pose
    view: Any = View()
    view.rotation = wp.mat33f(*pose.rotation.ravel().tolist())
    view.position = wp.vec3f(*pose.position)
    view.shift = wp.vec3f(*pose.shift)
    view.width, view.height = camera.size
    view.min_range = config.min_range
    view.max_range = min(config.max_range, FLOAT32_MAX)  # a range that overflows is too far
    view.line_count = plan.line_count
    view.steps = wp.vec3f(*plan.steps)
    view.limits = Limits(*limits, *[0.0] * (8 - len(limits)))
    return view
