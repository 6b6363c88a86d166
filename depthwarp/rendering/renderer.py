"""A renderer to keep: buffers made once, points and poses new with every call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp

from depthwarp.cameras import Camera, DepthKind
from depthwarp.checks import check_count
from depthwarp.depth_map import DepthMap
from depthwarp.devices import resolve_device
from depthwarp.errors import InputError
from depthwarp.filters import Filter, check_filters
from depthwarp.prepared import PreparedCloud
from depthwarp.rendering.clouds import CloudsOfViews
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.handed import (
    check_array,
    check_cameras,
    check_outputs,
    check_points,
    check_poses,
)
from depthwarp.rendering.plan import RenderPlan
from depthwarp.rendering.ragged import OUTPUTS, RaggedPlan
from depthwarp.rendering.views import DeviceViews, ViewPlan

__all__ = ["Renderer"]


class Renderer:
    """Renders the same cameras again and again, on the device, into buffers of its own.

    The first call decides what it draws: without `offsets` one cloud into all views; with them many
    clouds, each view the one that `cloud_of` names, which suits thousands of small clouds and
    images (worlds of a simulation, objects of a data set). It also allocates the buffers and
    compiles; the calls after it do neither, and on CUDA they do not wait for the device and can be
    captured in a graph. What they return is the renderer's and stays valid until the next call.

    Of many clouds only the `outputs` are allocated. Of one cloud only `"index"` can be left out,
    which halves the Z-buffer. Filters work on all maps, so with them all are there.

    Args:
        cameras: Cameras of one model and size, one for each view; their poses hold until others
            are given.
        max_points: Most points of a call, of all clouds together; more are refused.
        outputs: What `render` returns: some of `"depth"`, `"index"`, `"state"`.
        cloud_of: With `offsets`: the cloud that each view looks at, shape (V,), whole numbers or
            `wp.array` of `wp.int32`; None where view v looks at cloud v.
        depth: As in `dw.render`.
        filters: As in `dw.render`.
        min_range: As in `dw.render` [m].
        max_range: As in `dw.render` [m].
        device: As in `dw.render`.

    Raises:
        InputError: Cameras of several models or sizes, or none; an unknown output; or what
            `dw.render` refuses.
        DeviceError: The device is not on this machine.

    Example:
        >>> import numpy as np, depthwarp as dw
        >>> cameras = [dw.PinholeCamera.from_fov((60, 45), (8, 6))] * 2
        >>> renderer = dw.Renderer(cameras, max_points=1000, device="cpu")
        >>> maps = renderer.render(np.array([[2, 0, 0]], np.float32))
        >>> maps["depth"].shape, float(maps["depth"].numpy()[1].max())
        ((2, 6, 8), 2.0)
        >>> clouds = np.array([[2, 0, 0], [3, 0, 0], [4, 0, 0]], np.float32)
        >>> many = dw.Renderer(cameras, max_points=1000, device="cpu")
        >>> maps = many.render(clouds, offsets=[0, 1, 3])
        >>> maps["depth"].numpy().max(axis=(1, 2)), maps["index"].numpy().max(axis=(1, 2))
        (array([2., 3.], dtype=float32), array([0, 0], dtype=int32))
    """

    def __init__(
        self,
        cameras: Sequence[Camera],
        *,
        max_points: int,
        outputs: Sequence[str] = ("depth", "index"),
        cloud_of: Any = None,
        depth: DepthKind = "range",
        filters: Sequence[Filter] | None = None,
        min_range: float = 0.0,
        max_range: float = 15.0,
        device: str | None = None,
    ) -> None:
        self._outputs = check_outputs(outputs, tuple(OUTPUTS))
        self._max_points = check_count("max_points", max_points)
        self._cameras = check_cameras(cameras)
        self._device = resolve_device(device)
        self._config = RenderConfig(depth, min_range, max_range, check_filters(filters))
        # Refuses views that cannot be one plan's.
        DeviceViews(self._view_plans(), self._config, self._device, culls=False)
        self._clouds = CloudsOfViews(len(self._cameras), cloud_of, self._device)
        self._one: RenderPlan | None = None
        self._many: RaggedPlan | None = None

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras, with the poses that the host knows of."""
        return self._cameras

    def render(
        self,
        points: Any,
        poses: Any = None,
        *,
        offsets: Any = None,
        cloud_of: Any = None,
        out: Mapping[str, Any] | None = None,
    ) -> dict[str, Any]:
        """Draw points into all views.

        Args:
            points: Points in the world frame [m]: `wp.array` of `wp.vec3f`, shape (N,), on the
                renderer's device; a `PreparedCloud` of it (without `offsets`); or, on a CPU, a
                `PointCloud` or a NumPy array, shape (N, 3), float32, used where they are. Of many
                clouds one behind the other.
            poses: New poses, world to OpenCV's optical axes: `wp.array` of `wp.mat44f`, shape
                (V,), on the device, taken as they are; or a NumPy array, shape (V, 4, 4), whose
                rotations are checked, which takes the host some 70 us a view. None: those of
                before.
            offsets: First point of each cloud, and the end of the last: `wp.array` of `wp.int32`,
                shape (C + 1,), on the device; or whole numbers on the host, which are checked and
                copied there. None: the points are one cloud.
            cloud_of: Another `cloud_of` than before, see the class.
            out: Arrays of the caller to write into, by the names of the outputs: `wp.array` on the
                device of the shape (V, H, W), float32, int32 and uint8.

        Returns:
            The outputs by name, `wp.array`, shape (V, H, W); those of `out`, or the renderer's own,
            which the next call overwrites. `"index"` counts from the first point of the view's own
            cloud.

        Raises:
            InputError: Another device, shape or type, more points than `max_points`, a matrix that
                is not a pose, offsets that fall or reach beyond the points, or a cloud that there
                is not. Nothing is copied from the device to be looked at: numbers that are there
                are bounded instead. A cloud ends at the latest with the points, and a view of a
                cloud that there is not is empty.
            CapacityError: In the first call: the buffers do not fit the device's memory.
        """
        if out is not None and not isinstance(out, Mapping):
            raise InputError(
                'out must be arrays by the names of the outputs, {"depth": array}, got '
                f"{type(out).__name__}"
            )
        cloud = check_points(points, self._max_points, self._device)
        cameras = self._checked_poses(poses)
        plan = self._plan(cloud, offsets, cloud_of)
        if isinstance(poses, np.ndarray):
            self._cameras = cameras
            plan.look_from(self._view_plans())
        elif poses is not None:
            plan.look_from_device(poses)
        if isinstance(plan, RaggedPlan):
            plan.render(cloud, self._clouds.offsets, self._clouds.cloud_of)
        else:
            plan.render(cloud)
        results = {name: getattr(plan.maps, name) for name in self._outputs}
        if out is None:
            return results
        for name, array in self._checked_out(out, results).items():
            wp.copy(array, results[name])
            results[name] = array
        return results

    def depth_maps(self) -> list[DepthMap]:
        """The maps of the last `render` on the host, with counts; waits for the device.

        Their cameras have the last poses that came from the host.

        Raises:
            InputError: Nothing was rendered yet; or depth and index are not both among the outputs.
        """
        if self._many is not None:
            return self._many.depth_maps()
        if self._one is None:
            raise InputError("nothing was rendered yet: call render(points) first")
        return self._one.depth_maps()

    def _view_plans(self) -> list[ViewPlan]:
        return [ViewPlan(camera) for camera in self._cameras]

    def _plan(self, cloud: Any, offsets: Any, cloud_of: Any) -> RenderPlan | RaggedPlan:
        """The plan that the first call chose, made by it; with the clouds of this call."""
        if offsets is None:
            if cloud_of is not None or self._clouds.are_named or self._many is not None:
                raise InputError(
                    "offsets are missing: which points belong to which cloud; for one cloud in all "
                    "views, make another renderer"
                )
            if self._one is None:
                with_index = "index" in self._outputs
                self._one = RenderPlan(
                    self._view_plans(), self._config, self._device, with_index=with_index
                )
            return self._one
        if self._one is not None:
            raise InputError(
                "offsets: this renderer has drawn one cloud into all views and has the buffers for "
                "that: make another for many clouds"
            )
        if isinstance(cloud, PreparedCloud):
            raise InputError("offsets divide plain points, not a PreparedCloud, which is one cloud")
        self._clouds.divide(cloud.shape[0], offsets, cloud_of)
        if self._many is None:
            self._many = RaggedPlan(self._view_plans(), self._config, self._outputs, self._device)
        return self._many

    def _checked_poses(self, poses: Any) -> tuple[Camera, ...]:
        """The cameras at the poses, if those come from the host."""
        count = len(self._cameras)
        if isinstance(poses, np.ndarray):
            placed = zip(self._cameras, check_poses(poses, count), strict=True)
            return tuple(camera.with_pose(pose) for camera, pose in placed)
        if poses is not None:
            check_array("poses", poses, wp.mat44f, self._device, (count,))
        return self._cameras

    def _checked_out(self, out: Mapping[str, Any], results: dict[str, Any]) -> Mapping[str, Any]:
        for name, array in out.items():
            if name not in results:
                raise InputError(
                    f"out holds '{name}', which is no output of this renderer: {self._outputs}"
                )
            dtype, shape = results[name].dtype, results[name].shape
            check_array(f"out['{name}']", array, dtype, self._device, shape)
        return out
