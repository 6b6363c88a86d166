"""The scanned room that the examples drive through, in place of `dw.read("room.ply")`."""

from __future__ import annotations

import numpy as np

import depthwarp as dw

__all__ = ["SIZE", "scanned_room"]

SIZE = (8.0, 6.0, 2.7)
"""Along x, y and z, from a corner at the origin [m]."""

BOXES = (
    ((0.0, 0.0, 0.0), SIZE),
    ((2.0, 1.8, 0.0), (2.5, 2.3, 2.7)),
    ((5.4, 3.6, 0.0), (6.0, 4.2, 2.7)),
    ((4.0, 0.0, 0.0), (5.2, 0.6, 0.9)),
)
"""The room itself, two pillars and a sideboard: lowest and highest corner of each [m]."""


def scanned_room(points: int = 60_000, seed: int = 0) -> dw.PointCloud:
    """Points uniform on the faces of all boxes.

    Args:
        points: How many.
        seed: Of the random places.

    Returns:
        A cloud of float32 points [m], shape (points, 3).
    """
    rng = np.random.default_rng(seed)
    low, high = np.array(BOXES).transpose(1, 0, 2)
    areas = np.prod(high - low, axis=1, keepdims=True) / (high - low)  # of faces across each axis
    face = rng.choice(areas.size, points, p=(areas / areas.sum()).ravel())
    box, axis = np.divmod(face, 3)
    share = rng.random((points, 3))
    share[np.arange(points), axis] = rng.integers(0, 2, points)
    places = low[box] + share * (high - low)[box]
    return dw.PointCloud(places.astype(np.float32))
