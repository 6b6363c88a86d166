"""PyTorch's scatter, and PyTorch3D's points of one pixel, on depthwarp's device."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch

import depthwarp as dw
from benchmarks.peers import Float32Array, OneByOne, corner_matrix

__all__ = ["PyTorch3D", "Torch"]


class Torch(OneByOne):
    """`scatter_reduce_` with `amin`, the whole cloud at once: in blocks it is slower."""

    name = "torch"
    version = torch.__version__

    def __init__(self, device: str) -> None:
        self.device = device

    def load(self, points_world: Float32Array, max_range: float) -> None:
        self._points = torch.from_numpy(points_world).to(self.device)
        self._max_range = max_range

    def view(self, camera: dw.PinholeCamera) -> Any:
        matrix = torch.from_numpy(corner_matrix(camera).astype(np.float32)).to(self.device)
        return matrix[:, :3].T.contiguous(), matrix[:, 3], camera.size

    def run(self) -> None:
        super().run()
        if self.device != "cpu":
            torch.cuda.synchronize()

    def draw(self, view: Any) -> Any:
        width, height = view[2]
        nearest = torch.full((height * width,), torch.inf, device=self.device)
        column, row, z = self.pixels(view)
        nearest.scatter_reduce_(0, row * width + column, z, "amin")
        return torch.where(torch.isinf(nearest), 0, nearest).reshape(height, width)

    def pixels(self, view: Any) -> tuple[Any, Any, Any]:
        """Column, row and z of the points that fall into the image."""
        rotation, translation, (width, height) = view
        uz, vz, z = torch.addmm(translation, self._points, rotation).unbind(1)
        inside = (uz >= 0) & (uz < width * z) & (vz >= 0) & (vz < height * z)
        drawn = (inside & (z <= self._max_range)).nonzero().squeeze(1)
        z = z[drawn]
        # A quotient may be rounded up to the image's border.
        column = (uz[drawn] / z).long().clamp(max=width - 1)
        return column, (vz[drawn] / z).long().clamp(max=height - 1), z

    def images(self) -> Sequence[Float32Array]:
        return [image.cpu().numpy() for image in self._images]


class PyTorch3D(Torch):
    """`rasterize_points` with one point a pixel.

    It draws discs round points in normalized coordinates: X to the left, Y up, the image's shorter
    side from -1 to 1. So that every point falls into its own pixel alone, points are moved to
    their pixel's centre and the discs are half as wide as a pixel.
    """

    name = "PyTorch3D"

    def __init__(self, device: str) -> None:
        import pytorch3d
        from pytorch3d.renderer.points import rasterize_points
        from pytorch3d.structures import Pointclouds

        super().__init__(device)
        self.version = pytorch3d.__version__
        self._rasterize, self._clouds = rasterize_points, Pointclouds

    def draw(self, view: Any) -> Any:
        width, height = view[2]
        column, row, z = self.pixels(view)
        shorter = min(width, height)
        left, up = (width - 1 - 2 * column) / shorter, (height - 1 - 2 * row) / shorter
        _, depth, _ = self._rasterize(
            self._clouds([torch.stack([left, up, z], dim=1)]),
            image_size=(height, width),
            radius=0.5 / shorter,
            points_per_pixel=1,
        )
        return depth[0, :, :, 0].clamp(min=0)  # -1 where no point fell
