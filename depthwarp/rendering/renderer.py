"""A renderer to keep: buffers made once, points and poses new with every call."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp import arrays
from depthwarp.cameras import Camera, DepthKind, Pose
from depthwarp.checks import check_choice
from depthwarp.depth_map import DepthMap
from depthwarp.devices import resolve_device
from depthwarp.errors import InputError
from depthwarp.filters import Filter, check_filters
from depthwarp.prepared import PreparedCloud
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.plan import RenderPlan
from depthwarp.rendering.views import ViewPlan

__all__ = ["Renderer"]

OUTPUTS = ("depth", "index", "state")


class Renderer:
    """Renders the same cameras again and again, on the device, into buffers of its own.

    After the first call `render` compiles nothing and allocates no image; on CUDA it does not wait
    for the device and can be captured in a graph. What it returns stays valid until the next call.

    Args:
        cameras: Cameras of one model and size; their poses hold until others are given.
        max_points: Most points of a call; more are refused.
        outputs: What `render` returns: some of `"depth"`, `"index"`, `"state"`.
        depth: As in `dw.render`.
        filters: As in `dw.render`.
        min_range: As in `dw.render` [m].
        max_range: As in `dw.render` [m].
        device: As in `dw.render`.

    Raises:
        InputError: Cameras of several models or sizes, or none; an unknown output; or what
            `dw.render` refuses.
        DeviceError: The device is not on this machine.
        CapacityError: The buffers do not fit the device's memory.

    Example:
        >>> import numpy as np, depthwarp as dw
        >>> cameras = [dw.PinholeCamera.from_fov((60, 45), (8, 6))] * 2
        >>> renderer = dw.Renderer(cameras, max_points=1000, device="cpu")
        >>> maps = renderer.render(np.array([[2, 0, 0]], np.float32))
        >>> maps["depth"].shape, float(maps["depth"].numpy()[1].max())
        ((2, 6, 8), 2.0)
    """

    def __init__(
        self,
        cameras: Sequence[Camera],
        *,
        max_points: int,
        outputs: Sequence[str] = ("depth", "index"),
        depth: DepthKind = "range",
        filters: Sequence[Filter] | None = None,
        min_range: float = 0.0,
        max_range: float = 15.0,
        device: str | None = None,
    ) -> None:
        for name in outputs:
            check_choice("outputs", name, OUTPUTS)
        if not outputs:
            raise InputError(f"outputs must be some of {', '.join(OUTPUTS)}, got none")
        if max_points < 0:
            raise InputError(f"max_points must be a whole number from 0, got {max_points}")
        for camera in cameras:
            if not isinstance(camera, Camera):
                raise InputError(f"cameras must be cameras, got {type(camera).__name__}")
        self._cameras = tuple(cameras)
        self._max_points, self._outputs = int(max_points), tuple(outputs)
        self._device = resolve_device(device)
        config = RenderConfig(depth, min_range, max_range, check_filters(filters))
        self._plan = RenderPlan([ViewPlan(camera) for camera in cameras], config, self._device)

    @property
    def cameras(self) -> tuple[Camera, ...]:
        """The cameras, with the poses that the host knows of."""
        return self._cameras

    def render(
        self,
        points: Any,
        poses: Any = None,
        *,
        out: Mapping[str, Any] | None = None,
    ) -> dict[str, Any]:
        """Draw points into all views.

        Args:
            points: Points in the world frame [m]: `wp.array` of `wp.vec3f`, shape (N,), on the
                renderer's device; a `PreparedCloud` of it; or, on a CPU, a NumPy array, shape
                (N, 3), float32.
            poses: New poses, world to OpenCV's optical axes: `wp.array` of `wp.mat44f`, shape
                (V,), on the device, taken as they are; or a NumPy array, shape (V, 4, 4), whose
                rotations are checked. None: those of before.
            out: Arrays of the caller to write into, by the names of the outputs: `wp.array` on the
                device of the shape (V, H, W), float32, int32 and uint8.

        Returns:
            The outputs by name, `wp.array`, shape (V, H, W); those of `out`, or the renderer's own,
            which the next call overwrites.

        Raises:
            InputError: Another device, shape or type, more points than `max_points`, or a matrix
                that is not a pose. Nothing is copied between devices in silence.
        """
        cloud = self._checked_points(points)
        self._take_poses(poses)
        self._plan.render(cloud)
        own = self._plan.maps
        results = {name: getattr(own, name) for name in self._outputs}
        if out is None:
            return results
        for name, array in self._checked_out(out, results).items():
            wp.copy(array, results[name])
            results[name] = array
        return results

    def depth_maps(self) -> list[DepthMap]:
        """The maps of the last `render` on the host, with counts; waits for the device.

        Their cameras have the last poses that came from the host.
        """
        return self._plan.depth_maps()

    def _checked_points(self, points: Any) -> Any:
        if isinstance(points, PreparedCloud):
            if points.device != self._device:
                raise InputError(
                    f"the cloud was prepared on {points.device.alias}, the renderer is on "
                    f"{self._device.alias}"
                )
            count, cloud = len(points), points
        elif isinstance(points, np.ndarray):
            if points.dtype != np.float32 or points.ndim != 2 or points.shape[1] != 3:
                raise InputError(
                    f"points must be float32 of the shape (N, 3), got {points.dtype} of "
                    f"{points.shape}"
                )
            if self._device.is_cuda:
                raise InputError(
                    f"points are on the host and the renderer is on {self._device.alias}: bring "
                    "them there once, wp.array(points, dtype=wp.vec3f, device=...)"
                )
            count = len(points)
            cloud = arrays.share_points(np.ascontiguousarray(points), self._device)
        else:
            self._check_array("points", points, wp.vec3f, None)
            count, cloud = points.shape[0], points
        if count > self._max_points:
            raise InputError(
                f"{count} points are more than this renderer's max_points = {self._max_points}"
            )
        return cloud

    def _take_poses(self, poses: Any) -> None:
        if poses is None:
            return
        count = len(self._cameras)
        if isinstance(poses, np.ndarray):
            if poses.shape != (count, 4, 4):
                raise InputError(
                    f"poses must have the shape (V, 4, 4) = {count, 4, 4}, got {poses.shape}"
                )
            self._cameras = tuple(
                camera.with_pose(_pose(matrix, view))
                for view, (camera, matrix) in enumerate(zip(self._cameras, poses, strict=True))
            )
            self._plan.look_from([ViewPlan(camera) for camera in self._cameras])
            return
        self._check_array("poses", poses, wp.mat44f, (count,))
        self._plan.look_from_device(poses)

    def _checked_out(self, out: Mapping[str, Any], results: dict[str, Any]) -> Mapping[str, Any]:
        for name, array in out.items():
            if name not in results:
                raise InputError(
                    f"out holds '{name}', which is no output of this renderer: {self._outputs}"
                )
            self._check_array(f"out['{name}']", array, results[name].dtype, results[name].shape)
        return out

    def _check_array(
        self, name: str, array: Any, dtype: Any, shape: tuple[int, ...] | None
    ) -> None:
        """Refuse what is not a contiguous Warp array of a type and shape on the device."""
        wanted = f"a wp.array of {dtype.__name__} on {self._device.alias}"
        if not isinstance(array, wp.array):
            raise InputError(f"{name} must be {wanted}, got {type(array).__name__}")
        if array.dtype != dtype or array.device != self._device or not array.is_contiguous:
            raise InputError(
                f"{name} must be {wanted}, contiguous, got {array.dtype.__name__} on {array.device}"
            )
        if array.ndim != (1 if shape is None else len(shape)) or shape not in (None, array.shape):
            raise InputError(f"{name} must have the shape {shape or '(N,)'}, got {array.shape}")


def _pose(matrix: npt.NDArray[np.floating[Any]], view: int) -> Pose:
    try:
        return Pose.from_optical(matrix)
    except InputError as error:
        raise InputError(f"poses[{view}]: {error}") from error
