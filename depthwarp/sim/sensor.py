"""A depth camera in every one of many worlds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp

from depthwarp import arrays
from depthwarp.cameras import Camera, DepthKind
from depthwarp.checks import check_count
from depthwarp.cloud import PointCloud
from depthwarp.devices import resolve_device
from depthwarp.errors import InputError
from depthwarp.filters import Filter, check_filters
from depthwarp.prepared import PreparedCloud
from depthwarp.rendering.config import RenderConfig
from depthwarp.rendering.handed import check_outputs
from depthwarp.rendering.ragged import OUTPUTS, RaggedPlan
from depthwarp.rendering.views import ViewPlan
from depthwarp.sim.composition import Composition
from depthwarp.sim.handed import adopt, stream_scope
from depthwarp.sim.noise import SensorNoise
from depthwarp.sim.static_map import prepared_map
from depthwarp.sim.status import DeviceStatus, WorldStatus
from depthwarp.sim.worlds import MOST_POINTS, WorldPoints
from depthwarp_kernels import poses as pose_kernels
from depthwarp_kernels import spans as span_kernels

__all__ = ["DepthSensor"]


class DepthSensor:
    """Depth cameras of W worlds, C in each: points and poses new with every step.

    A camera sees the points of its own world and, if there is one, the static map that all worlds
    share. What counts as nearest, and the bits of it, are those of `dw.render`.

    Args:
        num_worlds: Number of worlds W.
        cameras_per_world: Cameras C of a world.
        size: Image size (width, height) [px]; None for the model's own.
        model: The lens: a camera, whose pose does not matter; or one for each of the C cameras,
            all of one model and size.
        max_points_per_world: Most points of a world; what is beyond is not drawn, and noted.
        device: As in `dw.render`.
        outputs: What `step` returns: some of `"depth"`, `"index"`, `"state"`.
        filters: As in `dw.render`.
        noise: What a real sensor does to its depths; None for nothing.
        depth: As in `dw.render`.
        min_range: As in `dw.render` [m].
        max_range: As in `dw.render` [m].
        static_map: Points that all worlds share; a cloud that is not yet prepared is prepared here.
            Their indices come first: with S of them, point i of a world has the index S + i.

    Raises:
        InputError: Numbers that are not positive, a size that is not the model's, cameras of
            several models or sizes, an unknown output, or what `dw.render` refuses.
        DeviceError: The device is not on this machine.
        CapacityError: The buffers do not fit the device's memory.

    Example:
        >>> import numpy as np, depthwarp as dw
        >>> lens = dw.PinholeCamera.from_fov((90, 90), (8, 8))
        >>> sensor = dw.sim.DepthSensor(2, 1, (8, 8), lens, max_points_per_world=1, device="cpu")
        >>> points = np.array([[[2, 0, 0]], [[3, 0, 0]]], np.float32)
        >>> poses = np.tile(lens.pose.optical_from_world.astype(np.float32), (2, 1, 1, 1))
        >>> sensor.step(points, poses)["depth"].numpy().max(axis=(1, 2, 3))
        array([2., 3.], dtype=float32)
        >>> sensor.status().is_clean
        True
    """

    def __init__(
        self,
        num_worlds: int,
        cameras_per_world: int,
        size: tuple[int, int] | None,
        model: Camera | Sequence[Camera],
        max_points_per_world: int,
        device: str | None = None,
        outputs: Sequence[str] = ("depth",),
        filters: Sequence[Filter] | None = None,
        noise: SensorNoise | None = None,
        *,
        depth: DepthKind = "range",
        min_range: float = 0.0,
        max_range: float = 15.0,
        static_map: PointCloud | PreparedCloud | None = None,
    ) -> None:
        self._worlds = check_count("num_worlds", num_worlds, 1)
        self._cameras = check_count("cameras_per_world", cameras_per_world, 1)
        self._outputs = check_outputs(outputs, tuple(OUTPUTS))
        lenses = _lenses(model, self._cameras, size)
        self._device = resolve_device(device)
        config = RenderConfig(depth, min_range, max_range, check_filters(filters))
        views = [ViewPlan(lens) for lens in lenses] * self._worlds
        # Noise, like filters, works on all maps; a depth of another renderer is compared with ours.
        written = tuple(OUTPUTS) if noise is not None else ("depth", *self._outputs)
        static = prepared_map(static_map, self._device)
        most = check_count("max_points_per_world", max_points_per_world, 1)
        if most + (0 if static is None else len(static)) > MOST_POINTS:
            raise InputError(
                f"max_points_per_world and the points of static_map together are more than "
                f"{MOST_POINTS}, the largest index"
            )
        self._plan = RaggedPlan(views, config, written, self._device, static=static)
        self._has_map = static is not None
        self._status = DeviceStatus(self._worlds, self._device)
        self._points = WorldPoints(
            self._worlds,
            most,
            self._device,
            self._status,
        )
        self._composition = Composition(self._plan.maps, config)
        self._noise = None
        if noise is not None:
            self._noise = noise.build(self._plan.maps, self._worlds, lenses, depth)
        worlds = np.repeat(np.arange(self._worlds, dtype=np.int32), self._cameras)
        self._world_of: Any = wp.array(worlds, dtype=wp.int32, device=self._device)
        # Recorded once: a launch of its own costs the host as long as a small step takes.
        device_views = self._plan.device_views.arrays[0]
        self._views = self._worlds * self._cameras
        self._look: Any = wp.launch(
            pose_kernels.look_from_worlds,
            dim=self._views,
            inputs=[
                arrays.zeros(self._views, wp.mat44f, self._device),
                self._cameras,
            ],
            outputs=[device_views, self._status.flags],
            device=self._device,
            record_cmd=True,
        )
        width, height = lenses[0].size
        self._shape = (self._worlds, self._cameras, height, width)
        self._maps = {
            name: getattr(self._plan.maps, name).reshape(self._shape) for name in self._outputs
        }
        for module in (pose_kernels, span_kernels):
            wp.load_module(module, device=self._device)

    @property
    def device(self) -> Any:
        """Warp device on which it draws."""
        return self._device

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of what `step` returns."""
        return self._outputs

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """Shape of a map: (worlds, cameras, height, width)."""
        return self._shape

    def step(
        self,
        points: Any,
        poses: Any,
        counts: Any = None,
        out: Mapping[str, Any] | None = None,
        *,
        scene_depth: Any = None,
    ) -> dict[str, Any]:
        """Draw all worlds.

        After the first call it allocates nothing on the device, compiles nothing and, on CUDA, does
        not wait for the device; it can be captured in a graph (`wp.ScopedCapture`, on CUDA and on
        the CPU, where one thread replays it), and a replay gives the bits of a call. A graph reads
        and writes the arrays that were handed when it was captured, so keep them. On a CPU the call
        returns when the images are done.

        Arrays may be of Warp, torch, JAX, or anything with DLPack, on the sensor's device; on a
        CPU also of NumPy. They are used where they are, and never copied or converted.

        Args:
            points: World-local points [m], float32, shape (W, P, 3), P at most
                `max_points_per_world`; or, with `counts`, of all worlds one behind the other, shape
                (N, 3); None for the static map alone.
            poses: World to OpenCV's optical axes, float32, shape (W, C, 4, 4). A pose that is not
                finite or no rotation (within 0.001) leaves its image empty, and is noted.
            counts: Points of each world, int32, shape (W,): of (W, P, 3) the first of its rows.
            out: Arrays by the names of outputs, shape (W, C, height, width), that the results are
                written to.
            scene_depth: Depth images of another renderer, float32 [m], shape (W, C, height, width),
                of the same kind of depth; 0, infinite or NaN where it sees nothing. The nearer of
                both is kept, after the filters and before the noise; where that is theirs, the
                index is -1 and the state MEASURED.

        Returns:
            The outputs by name, `wp.array` of the shape (W, C, height, width): depth [m], float32,
            0 = empty; index, int32, -1 = no point; state, uint8 (`dw.State`). They are the sensor's
            (or those of `out`) and hold until the next step.

        Raises:
            InputError: An array of another device, type or shape, or not contiguous; an unknown
                output in `out`; neither points nor a static map. Nothing was drawn then.
        """
        if points is None and not self._has_map:
            raise InputError("points are missing, and there is no static map to draw instead")
        _check_mapping(out)
        handed = (points, poses, counts, scene_depth, *(out or {}).values())
        with stream_scope(handed, self._device):
            targets = self._targets(out or {})
            looks = adopt("poses", poses, wp.mat44f, self._shape[:2], self._device)
            scene = None
            if scene_depth is not None:
                scene = adopt("scene_depth", scene_depth, wp.float32, self._shape, self._device)
            rows = self._points.take(points, counts)
            self._look_from(looks)
            self._plan.draw(rows, self._points.spans, self._world_of)
            if scene is not None:
                self._composition.keep_nearer(scene)
            if self._noise is not None:
                self._noise()
            for name, target in targets.items():
                wp.copy(target, self._maps[name])
        return {**self._maps, **targets}

    def status(self) -> WorldStatus:
        """What went wrong since the last call of this; waits for the device.

        Of steps that `jax_step` runs, those that are done: wait for their results first.
        """
        return self._status.read()

    def restart_noise(self) -> None:
        """Let the noise begin anew: the same numbers as from the first step on.

        On CUDA it is queued on Warp's current stream: call it under the stream of the steps.
        """
        if self._noise is not None:
            self._noise.reset()

    def _look_from(self, looks: Any) -> None:
        self._look.set_param_at_index(0, looks.reshape(self._views))
        self._look.launch()

    def _targets(self, out: Mapping[str, Any]) -> dict[str, Any]:
        """The arrays that results are copied to."""
        unknown = [name for name in out if name not in self._maps]
        if unknown:
            raise InputError(
                f"out holds {unknown[0]!r}, which is no output of this sensor: {self._outputs}"
            )
        return {
            name: adopt(f"out[{name!r}]", array, OUTPUTS[name], self._shape, self._device, True)
            for name, array in out.items()
        }


def _check_mapping(out: Mapping[str, Any] | None) -> None:
    if out is not None and not isinstance(out, Mapping):
        raise InputError(
            'out must be arrays by the names of the outputs, {"depth": array}, got '
            f"{type(out).__name__}"
        )


def _lenses(
    model: Camera | Sequence[Camera], cameras: int, size: tuple[int, int] | None
) -> list[Camera]:
    """One lens for each camera of a world, all of one size."""
    lenses = [model] * cameras if isinstance(model, Camera) else list(model)
    if len(lenses) != cameras or not all(isinstance(lens, Camera) for lens in lenses):
        raise InputError(
            f"model must be a camera, or one for each of the {cameras} cameras of a world, got "
            f"{model!r}"
        )
    for lens in lenses:
        if size is not None and tuple(size) != lens.size:
            raise InputError(
                f"size is {tuple(size)} and the model's own {lens.size}: make the model for that "
                "size (its focal length depends on it)"
            )
        if lens.size != lenses[0].size or type(lens) is not type(lenses[0]):
            raise InputError("all cameras of a sensor must be of one model and size")
    return lenses
