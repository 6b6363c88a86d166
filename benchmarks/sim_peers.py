"""Ways to the depth images of many worlds: the sensor, its replayed graph, and a ray caster."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import warp as wp

import depthwarp as dw
from benchmarks.sim_scene import SimScene
from depthwarp import arrays
from depthwarp.devices import usable_cores
from depthwarp.threads import thread_pool

__all__ = ["MAKERS", "LeftOutError", "Rays", "Replayed", "Sensor", "SimPeer"]

Float32Array = npt.NDArray[np.float32]

FINE = 40
"""Squares along each side of a face of the finer mesh: 19,200 triangles in all."""


class LeftOutError(Exception):
    """A peer cannot do the work here; the message says why."""


class SimPeer(Protocol):
    """A way to draw z depth in all worlds, made for a scene on a device.

    Attributes:
        draws_points: Whether its images are those of the points; else those of the mesh.
    """

    name: str
    version: str
    draws_points: bool

    def step(self) -> None:
        """Draw all worlds; on a GPU it need not wait."""

    def images(self) -> Float32Array:
        """Those of the last step [m], shape (worlds, side, side), 0 where there is nothing."""


class Sensor:
    """`dw.sim.DepthSensor`, a call a step."""

    name = "depthwarp"
    version = dw.__version__
    draws_points = True

    def __init__(self, scene: SimScene, device: str) -> None:
        lens, side = scene.lens, scene.side
        self.points = arrays.share(scene.points_world(), wp.vec3f, device)
        self.poses = wp.array(scene.poses(), dtype=wp.mat44f, device=device)
        self.make = lambda: dw.sim.DepthSensor(
            num_worlds=scene.worlds,
            cameras_per_world=1,
            size=(side, side),
            model=lens,
            max_points_per_world=scene.points,
            device=device,
            depth="z",
            max_range=scene.room.max_range_m,
        )
        self.sensor = self.make()

    def step(self) -> None:
        self._depth = self.sensor.step(self.points, self.poses)["depth"]

    def images(self) -> Float32Array:
        images: Float32Array = self._depth.numpy()[:, 0]
        return images


class Replayed(Sensor):
    """The same step as a captured graph; on a CPU one thread replays it."""

    name = "depthwarp, graph"

    def __init__(self, scene: SimScene, device: str) -> None:
        super().__init__(scene, device)
        super().step()
        with wp.ScopedCapture(device=device) as capture:
            super().step()
        self._graph = capture.graph

    def step(self) -> None:
        wp.capture_launch(self._graph)


class Rays:
    """`wp.mesh_query_ray` through every pixel's centre, on a mesh of the same room.

    All worlds share the mesh, which never moves, so its tree is built once and not timed. On a CPU
    all cores trace rays, each those of some worlds.
    """

    version = wp.__version__
    draws_points = False

    def __init__(self, scene: SimScene, device: str, divisions: int = 1) -> None:
        self._device = wp.get_device(device)
        corners, triangles = room_mesh(scene.room.room_m, divisions)
        self.name = f"rays, {len(triangles):,} triangles"
        self._mesh = wp.Mesh(
            wp.array(corners, dtype=wp.vec3f, device=device),
            wp.array(triangles.ravel(), dtype=wp.int32, device=device),
        )
        lens = scene.lens
        self._inner = wp.vec4f(lens.fx, lens.fy, lens.cx, lens.cy)
        self._poses = wp.array(scene.poses()[:, 0], dtype=wp.mat44f, device=device)
        self._depth = wp.zeros((scene.worlds, scene.side, scene.side), device=device)
        self._max_range = scene.room.max_range_m
        parts = min(scene.worlds, 8 * usable_cores()) if self._device.is_cpu else 1
        self._bounds = [scene.worlds * part // parts for part in range(parts + 1)]

    def step(self) -> None:
        if len(self._bounds) == 2:
            self._trace(*self._bounds)
        else:
            list(thread_pool(usable_cores()).map(self._trace, self._bounds[:-1], self._bounds[1:]))

    def images(self) -> Float32Array:
        images: Float32Array = self._depth.numpy()
        return images

    def _trace(self, first: int, end: int) -> None:
        wp.launch(
            trace,
            dim=(end - first, *self._depth.shape[1:]),
            inputs=[self._mesh.id, self._poses, self._inner, self._max_range, first],
            outputs=[self._depth],
            device=self._device,
        )


# A direction whose z is 1 in the camera: the distance along it is z depth.
@wp.kernel(enable_backward=False)
def trace(
    # In:
    mesh: wp.uint64,
    poses: wp.array[wp.mat44f],
    inner: wp.vec4f,
    max_range: float,
    first: int,
    # Out:
    depth_out: wp.array3d[float],
):
    """Depth of the mesh in one pixel of one world."""
    part, row, column = wp.tid()
    world = first + part
    pose = poses[world]
    to_world = wp.transpose(
        wp.mat33f(
            pose[0, 0], pose[0, 1], pose[0, 2],
            pose[1, 0], pose[1, 1], pose[1, 2],
            pose[2, 0], pose[2, 1], pose[2, 2],
        )
    )  # fmt: skip
    origin = -(to_world @ wp.vec3f(pose[0, 3], pose[1, 3], pose[2, 3]))
    x = (float(column) - inner[2]) / inner[0]
    y = (float(row) - inner[3]) / inner[1]
    hit = wp.mesh_query_ray(mesh, origin, to_world @ wp.vec3f(x, y, 1.0), max_range)
    depth_out[world, row, column] = wp.where(hit.result, hit.t, 0.0)


def room_mesh(
    size: tuple[float, float, float], divisions: int
) -> tuple[Float32Array, npt.NDArray[np.int32]]:
    """The six faces of a room, each cut into so many squares along either side.

    Returns:
        Corners [m], shape (V, 3), and the corners of each triangle, shape (T, 3).
    """
    steps = np.linspace(0, 1, divisions + 1)
    first, second = (grid.ravel() for grid in np.meshgrid(steps, steps, indexing="ij"))
    row, column = (grid.ravel() for grid in np.indices((divisions, divisions)))
    a = row * (divisions + 1) + column
    b, c, d = a + 1, a + divisions + 1, a + divisions + 2
    halves = np.concatenate([np.stack([a, b, c], 1), np.stack([b, d, c], 1)])
    corners, triangles = [], []
    for axis in range(3):
        for side in (0.0, 1.0):
            face = np.insert(np.stack([first, second], 1), axis, side, axis=1)
            triangles.append(halves + len(corners) * len(face))
            corners.append(face * size)
    return np.concatenate(corners).astype(np.float32), np.concatenate(triangles).astype(np.int32)


def _torch(scene: SimScene, device: str) -> SimPeer:
    from benchmarks.sim_torch import TorchScatter

    return TorchScatter(scene, device)


MAKERS: dict[str, Callable[[SimScene, str], Any]] = {
    "depthwarp": Sensor,
    "depthwarp, graph": Replayed,
    "torch": _torch,
    "rays": Rays,
    "rays, fine mesh": lambda scene, device: Rays(scene, device, FINE),
}
"""What makes each peer; the sensor first, with which the others are compared."""
