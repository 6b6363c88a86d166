"""A loop over the points, compiled by numba: what one writes when NumPy is not enough."""

from __future__ import annotations

from typing import Any

import numba
import numpy as np

from benchmarks.peers import Float32Array, OneByOne

__all__ = ["Numba"]


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


class Numba(OneByOne):
    """The loop above, on one thread."""

    name = "numba"
    version = numba.__version__
    device = "cpu"

    def draw(self, view: Any) -> Float32Array:
        """Draw one image."""
        matrix, (width, height) = view
        nearest = np.full((height, width), np.inf, dtype=np.float32)
        draw(self._points, matrix, width, height, np.float32(self._max_range), nearest)
        nearest[np.isinf(nearest)] = 0
        return nearest
