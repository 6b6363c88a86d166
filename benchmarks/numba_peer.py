"""A loop over the points, compiled by numba: what one writes when NumPy is not enough."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
import numpy.typing as npt

import depthwarp as dw

__all__ = ["Numba"]

Float32Array = npt.NDArray[np.float32]


@numba.njit(fastmath=False)
def draw(points: Any, matrix: Any, width: int, height: int, max_range: float, nearest: Any) -> None:
    """Keep the smallest z of each pixel; `matrix` (3, 4) takes a point to (u z, v z, z)."""
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        depth = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2] * z + matrix[2, 3]
        if depth <= 0 or depth > max_range:
            continue
        u = (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2] * z + matrix[0, 3]) / depth
        v = (matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2] * z + matrix[1, 3]) / depth
        if u >= 0 and v >= 0 and u < width and v < height:
            row, column = int(v), int(u)
            nearest[row, column] = min(nearest[row, column], depth)


class Numba:
    """The loop above, on one thread."""

    name = "numba"
    version = numba.__version__
    device = "cpu"

    def prepare(
        self, points_world: Float32Array, camera: dw.PinholeCamera, max_range: float
    ) -> None:
        """Points, and one matrix for pose, lens and the half pixel."""
        to_corner = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])  # pixel corners at integers
        transform = to_corner @ camera.K @ camera.pose.optical_from_world[:3]
        self._matrix = transform.astype(np.float32)
        self._points, self._size, self._max_range = points_world, camera.size, max_range

    def run(self) -> None:
        """Draw one image."""
        width, height = self._size
        nearest = np.full((height, width), np.inf, dtype=np.float32)
        draw(self._points, self._matrix, width, height, np.float32(self._max_range), nearest)
        nearest[np.isinf(nearest)] = 0
        self._depth = nearest

    def image(self) -> Float32Array:
        """The image of the last run [m]."""
        return self._depth
