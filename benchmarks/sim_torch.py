"""The same images by torch's `scatter_reduce_` with `amin`, all worlds at once."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from benchmarks.sim_peers import Float32Array, LeftOutError
from benchmarks.sim_scene import SimScene
from depthwarp.devices import usable_cores

__all__ = ["TorchScatter"]


class TorchScatter:
    """One batched product takes all points to their cameras; points in an image are then scattered.

    Of several ways to write it this was the fastest: coordinates in rows of their own, and only the
    points inside an image divided and scattered.
    """

    name = "torch"
    version = torch.__version__
    draws_points = True

    def __init__(self, scene: SimScene, device: str) -> None:
        if device != "cpu" and not torch.cuda.is_available():
            raise LeftOutError("this torch has no CUDA")
        if device == "cpu":
            torch.set_num_threads(usable_cores())
        lens = scene.lens
        # Takes a world point to (u z, v z, z), where pixel corners are whole numbers.
        to_corner = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
        matrix = (to_corner @ lens.K @ scene.poses()[:, 0, :3]).astype(np.float32)
        self._turn = torch.from_numpy(matrix[:, :, :3].copy()).to(device)
        self._shift = torch.from_numpy(matrix[:, :, 3:].copy()).to(device)
        self._points = torch.from_numpy(scene.points_world()).to(device).transpose(1, 2)
        self._shape = (scene.worlds, scene.side, scene.side)
        self._max_range = scene.room.max_range_m

    def step(self) -> None:
        worlds, height, width = self._shape
        nearest = torch.full((worlds * height * width,), torch.inf, device=self._points.device)
        uz, vz, z = torch.baddbmm(self._shift, self._turn, self._points).unbind(1)
        inside = (uz >= 0) & (uz < width * z) & (vz >= 0) & (vz < height * z)
        world, point = (inside & (z <= self._max_range)).nonzero(as_tuple=True)
        z = z[world, point]
        # A quotient may be rounded up to the image's border.
        column = (uz[world, point] / z).long().clamp_(max=width - 1)
        row = (vz[world, point] / z).long().clamp_(max=height - 1)
        nearest.scatter_reduce_(0, (world * height + row) * width + column, z, "amin")
        self._images: Any = torch.where(torch.isinf(nearest), 0, nearest)

    def images(self) -> Float32Array:
        images: Float32Array = self._images.reshape(self._shape).cpu().numpy()
        return images
