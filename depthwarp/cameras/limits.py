"""What a camera can see at most: bounds that culling takes, a little wider than the image."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.camera import Camera

__all__ = ["cone_limits", "plane_limits"]

Float64Array = npt.NDArray[np.float64]

SAMPLES = 129
"""Rays along each border of the image."""

WIDER = 0.02
"""What the bounds are wider by [rad]: the curved border between two rays, and rounding."""


def plane_limits(camera: Camera) -> tuple[float, ...]:
    """Four planes through the centre that hold all rays of a camera that looks ahead.

    Returns:
        (n_y, n_x) of the inward normals of the left and right plane and (n_z, n_x) of the lower
        and upper one, each of length 1.
    """
    rays = _border_rays(camera)
    ahead = rays[rays[:, 0] > 0]
    horizontal, vertical = (
        np.arctan2(ahead[:, 1], ahead[:, 0]),
        np.arctan2(ahead[:, 2], ahead[:, 0]),
    )
    limits: list[float] = []
    for angles in (horizontal, vertical):
        # Where the lens reaches only a part of the image, its border rays do not bound the rest.
        whole = len(ahead) == len(rays) and len(rays) > 0 and not np.isnan(angles).any()
        high = min(float(angles.max()) + WIDER, math.pi / 2) if whole else math.pi / 2
        low = max(float(angles.min()) - WIDER, -math.pi / 2) if whole else -math.pi / 2
        limits += [-math.cos(high), math.sin(high), math.cos(low), -math.sin(low)]
    return tuple(limits)


def cone_limits(camera: Camera, most: float) -> tuple[float, ...]:
    """Cosine and sine of an angle about the axis that holds all rays, at most `most` [rad]."""
    rays = _border_rays(camera)
    if np.isnan(rays).any() or not len(rays):
        angle = most
    else:
        angle = min(float(np.arccos(np.clip(rays[:, 0], -1, 1)).max()) + WIDER, most)
    return math.cos(angle), math.sin(angle)


def _border_rays(camera: Camera) -> Float64Array:
    """Rays along the outer edge of the image, shape (4 * SAMPLES, 3)."""
    right, bottom = camera.width - 0.5, camera.height - 0.5
    u, v = np.linspace(-0.5, right, SAMPLES), np.linspace(-0.5, bottom, SAMPLES)
    columns = np.concatenate([u, u, np.full(SAMPLES, -0.5), np.full(SAMPLES, right)])
    rows = np.concatenate([np.full(SAMPLES, -0.5), np.full(SAMPLES, bottom), v, v])
    return camera.directions(columns, rows)
