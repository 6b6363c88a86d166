"""The sensor model: what a real depth camera would have measured, after what it should have seen.

Everything is along the depth that the maps hold, `"range"` or `"z"`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from depthwarp import arrays
from depthwarp.cameras import Camera, DepthKind
from depthwarp.checks import check_count, check_positive, is_number
from depthwarp.devices import check_memory
from depthwarp.errors import InputError
from depthwarp.filters.maps import DeviceMaps
from depthwarp.filters.rows import row_launch
from depthwarp_kernels.sim_noise import NoiseModel, add_noise, begin_step

__all__ = ["NoiseStep", "SensorNoise"]

SEEDS = 1 << 64
STEPS = 1 << 32


@dataclass(frozen=True)
class SensorNoise:
    """Imperfections of a depth sensor, each off until it is given.

    They work in this order:

    1. `min_range`: what is nearer becomes empty, also what comes out nearer after all the rest.
    2. `grazing_angle`: a surface seen at an angle a from its normal drops out with the probability
       1 - cos(a) / cos(grazing_angle): 0 up to that angle, 1 at 90 degrees. The normal is that of
       the points of the pixel and of one neighbour along the row and one along the column, those
       nearest to it in depth; a pixel without them stays.
    3. `flying_share`: a pixel beside an edge takes, with this probability, a depth anywhere between
       its own and that of the neighbour across the edge (of its four, the one farthest off), as
       a sensor does whose pixel sees both sides. An edge is a difference in depth above
       `flying_jump` that is not the slope of a surface: neither the line through the points of the
       pixel and its opposite neighbour goes on to the neighbour's point, nor that through the
       neighbour and its next one back to the pixel's, both within `flying_jump`. Empty neighbours
       make no edge.
    4. `disparity_noise`: normal noise with the standard deviation `disparity_noise` z^2, z the
       depth: what a constant error of the disparity, proportional to 1/z, does to z. Without bias;
       values end at 6.66 standard deviations, and what comes out at 0 or below becomes empty.
    5. `disparity_step`: 1/z is rounded to whole multiples of it, so that z has steps that grow as
       `disparity_step` z^2; what is beyond 2 / `disparity_step` rounds to none and becomes empty.
    6. `depth_step`: z is rounded to whole multiples of it; what rounds to 0 becomes empty.

    Dropped pixels are `EMPTY` with depth 0 and index -1. The others keep index and state, flying
    ones too. Pixels without a depth, or erased with theirs kept, stay as they are and count as
    empty. Whatever the result of noise, nothing is cut off at the sensor's `max_range`.

    The random numbers of a pixel depend on the seed, the numbers of the world, the camera and the
    pixel, and on how many steps the sensor has made since its reset, on nothing else: the same on
    every device, for any threads, and whatever else is on or off. Reading neighbours uses each
    camera's own rays, so angles and edges are right for every lens.

    For the first Kinect, Khoshelham and Elberink measured a noise of 1.425e-3 z^2 and steps of
    2.85e-3 z^2 [m] ("Accuracy and resolution of Kinect depth data", Sensors 12, 2012).

    Attributes:
        min_range: Shortest depth that the sensor can measure [m].
        disparity_noise: Standard deviation of 1/z [1/m]; for a stereo pair that of its disparity
            [px] divided by focal length [px] times baseline [m].
        disparity_step: Step of 1/z [1/m]; of the disparity likewise.
        depth_step: Step of z [m]: 0.001 for a sensor that reports millimetres.
        grazing_angle: From this angle off the normal on pixels drop out [degrees], up to 90: none.
        flying_share: Probability that a pixel beside an edge flies, from 0 to 1.
        flying_jump: Least difference in depth of an edge [m].
        seed: A whole number from 0 to below 2^64.

    Raises:
        InputError: A number out of its range; the message names it.

    Example:
        >>> import depthwarp as dw
        >>> kinect = dw.sim.SensorNoise(disparity_noise=1.425e-3, disparity_step=2.85e-3)
    """

    min_range: float = 0.0
    disparity_noise: float = 0.0
    disparity_step: float = 0.0
    depth_step: float = 0.0
    grazing_angle: float = 90.0
    flying_share: float = 0.0
    flying_jump: float = 0.1
    seed: int = 0

    def __post_init__(self) -> None:
        for name, unit in (
            ("min_range", "m"),
            ("disparity_noise", "1/m"),
            ("disparity_step", "1/m"),
            ("depth_step", "m"),
        ):
            _check_between(name, getattr(self, name), math.inf, f" [{unit}]")
        _check_between("grazing_angle", self.grazing_angle, 90.0, " degrees")
        _check_between("flying_share", self.flying_share, 1.0)
        check_positive("flying_jump", self.flying_jump, "m")
        if check_count("seed", self.seed) >= SEEDS:
            raise InputError(f"seed must be below 2^64, got {self.seed}")

    def build(
        self, maps: DeviceMaps, worlds: int, cameras: Sequence[Camera], depth: DepthKind = "range"
    ) -> NoiseStep:
        """Allocate the working memory for these maps and return the step that changes them.

        Args:
            maps: The maps of all worlds, shape (worlds * len(cameras), H, W), world by world.
            worlds: Number of worlds.
            cameras: The cameras of a world, in their order; their poses do not matter.
            depth: The kind of depth in the maps.

        Raises:
            InputError: Maps of another shape than these cameras' images, or a camera without this
                kind of depth.
            CapacityError: The working memory does not fit the device.
        """
        expected = (worlds * len(cameras), *cameras[0].size[::-1]) if len(cameras) else None
        if maps.depth.shape != expected or any(c.size != cameras[0].size for c in cameras):
            raise InputError(
                f"maps of shape {maps.depth.shape} must hold the images of {worlds} worlds with "
                f"{len(cameras)} cameras of one size each, got sizes {[c.size for c in cameras]}"
            )
        pixels = maps.depth.size + (
            6 * len(cameras) * maps.depth[0].size if self.looks_beside else 0
        )
        check_memory(
            f"noise of {maps.depth.shape[0]} images",
            4 * pixels,
            maps.depth.device,
            "simulate fewer worlds at a time, or smaller images",
        )
        return NoiseStep(self, maps, cameras, depth)

    @property
    def looks_beside(self) -> bool:
        """Whether pixels look at their neighbours, and rays are needed."""
        return self._grazing_cosine > 0 or self.flying_share > 0

    @property
    def _grazing_cosine(self) -> float:
        # The cosine of 90 degrees in float64 is not 0.
        return math.cos(math.radians(self.grazing_angle)) if self.grazing_angle < 90 else 0.0

    def device_model(self, cameras: int) -> Any:
        """The numbers as the kernel takes them."""
        model: Any = NoiseModel()
        model.min_range = self.min_range
        model.disparity_noise = self.disparity_noise
        model.disparity_step = self.disparity_step
        model.depth_step = self.depth_step
        model.grazing_cosine = self._grazing_cosine
        model.flying_share = self.flying_share
        model.flying_jump = self.flying_jump
        model.seed_low = int(self.seed) & 0xFFFFFFFF
        model.seed_high = int(self.seed) >> 32
        model.cameras = cameras
        return model


class NoiseStep:
    """The noise of one set of maps, and the number of the step that it is at.

    The number is on the device and is raised there, so that a captured graph goes on with new
    random numbers at each replay. After 2^32 steps the numbers begin again.
    """

    def __init__(
        self, noise: SensorNoise, maps: DeviceMaps, cameras: Sequence[Camera], depth: DepthKind
    ) -> None:
        device = maps.depth.device
        self.steps = arrays.zeros(1, wp.uint32, device)
        self._before = arrays.empty(maps.depth.shape, wp.float32, device)
        self._rays: Any = [
            wp.array(rays, dtype=wp.vec3f, device=device)
            for rays in (_rays_of(cameras, depth) if noise.looks_beside else NO_RAYS)
        ]
        self._wraps: Any = wp.array([int(c.wraps) for c in cameras], dtype=wp.int32, device=device)
        self._begin = row_launch(
            begin_step, maps, [maps.depth, maps.state], [self._before, self.steps]
        )
        self._add = row_launch(
            add_noise,
            maps,
            [self._before, *self._rays, self._wraps, self.steps, noise.device_model(len(cameras))],
            [maps.depth, maps.index, maps.state],
        )

    def __call__(self) -> None:
        """Change the maps as the sensor would: one step.

        Allocates nothing and does not synchronize; graph-capture safe once the kernels are loaded,
        also in Warp's capture on a CPU.
        """
        self._begin()
        self._add()

    def reset(self, step: int = 0) -> None:
        """Say how many steps count as made; the next one repeats what followed that many.

        Allocates nothing and does not synchronize; graph-capture safe.

        Args:
            step: A whole number from 0 to below 2^32.

        Raises:
            InputError: Another number.
        """
        if check_count("step", step) >= STEPS:
            raise InputError(f"step must be below 2^32, got {step}")
        self.steps.fill_(int(step))


NO_RAYS = np.zeros((2, 1, 1, 1, 3), np.float32)
"""What is passed where no pixel looks beside itself."""


def _rays_of(cameras: Sequence[Camera], depth: DepthKind) -> npt.NDArray[np.float32]:
    """Origins and directions, shape (2, C, H, W, 3): a pixel's point is origin + z direction."""
    rays = []
    for camera in cameras:
        camera.check_kind(depth)
        v, u = np.indices((camera.height, camera.width), dtype=np.float64)
        with np.errstate(all="ignore"):  # no ray: NaN
            near, far = (
                camera.points_of(u, v, np.full(u.shape, metres), depth) for metres in (1.0, 2.0)
            )
        rays.append((2 * near - far, far - near))
    both: npt.NDArray[np.float32] = np.stack(rays, axis=1).astype(np.float32)
    return both


def _check_between(name: str, value: float, largest: float, unit: str = "") -> None:
    finite = is_number(value) and math.isfinite(value)
    if not finite or not 0 <= value <= largest:
        bounds = "a finite number from 0" if largest == math.inf else f"from 0 to {largest:g}"
        raise InputError(f"{name} must be {bounds}{unit}, got {value!r}")
