"""What a camera sees: bounds for culling, a little wider than the image, and a little narrower."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from depthwarp.cameras.camera import Camera

__all__ = ["cone_limits", "plane_limits"]

Float64Array = npt.NDArray[np.float64]

SAMPLES = 129
"""Rays along each border of the image."""

WIDER = 0.002
"""What the bounds are wider or narrower by [rad] at least."""

NOWHERE = (0.0,) * 8
"""Planes inside which nothing lies."""


def plane_limits(camera: Camera) -> tuple[float, ...]:
    """Planes through the centre: four that hold all rays of a camera that looks ahead, four within.

    Returns:
        (n_y, n_x) of the inward normals of the left and right plane and (n_z, n_x) of the upper
        and lower one, each of length 1; then the same of four planes between which all rays are
        rays of the image, or zeros where that cannot be told.
    """
    borders = _border_rays(camera)
    rays = borders.reshape(-1, 3)
    # Where the lens reaches only a part of the image, its border rays do not bound the rest.
    if not (len(rays) and (rays[:, 0] > 0).all()):
        return _planes(math.pi / 2, -math.pi / 2) * 2 + NOWHERE
    across, down = (np.arctan2(borders[..., axis], borders[..., 0]) for axis in (1, 2))
    # A border bulges between its rays by less than the bend of three.
    margins = [
        WIDER + 2 * float(np.abs(np.diff(angles, 2)).max()) for angles in (across[:2], down[2:])
    ]
    outer = tuple(
        _planes(
            min(float(angles.max()) + margin, math.pi / 2),
            max(float(angles.min()) - margin, -math.pi / 2),
        )
        for angles, margin in zip((across, down), margins, strict=True)
    )
    return outer[0] + outer[1] + _inner_planes(camera, across, down, margins)


def _inner_planes(
    camera: Camera, across: Float64Array, down: Float64Array, margins: list[float]
) -> tuple[float, ...]:
    """The largest rectangle of angles that no border crosses, if it lies in the image.

    A border is a closed curve, so a rectangle that it does not touch is inside as a whole if its
    middle is.
    """
    left, right, upper, lower = range(4)
    high_y, low_y = across[left].min() - margins[0], across[right].max() + margins[0]
    high_z, low_z = down[upper].min() - margins[1], down[lower].max() + margins[1]
    if high_y <= low_y or high_z <= low_z:
        return NOWHERE
    middle = np.tan([0.5 * (high_y + low_y), 0.5 * (high_z + low_z)])
    pixel = np.concatenate(camera.image_of(np.array([[1.0, *middle]])))
    size = np.array(camera.size)
    is_inside = bool((np.abs(pixel - 0.5 * (size - 1)) < 0.5 * size).all())  # not for NaN
    if not is_inside:
        return NOWHERE
    return _planes(float(high_y), float(low_y)) + _planes(float(high_z), float(low_z))


def _planes(high: float, low: float) -> tuple[float, ...]:
    """Inward normals of two planes at angles from the axis [rad]."""
    return -math.cos(high), math.sin(high), math.cos(low), -math.sin(low)


def cone_limits(camera: Camera, most: float) -> tuple[float, ...]:
    """Cosine and sine of an angle about the axis that holds all rays, at most `most` [rad]."""
    from_axis = np.arccos(np.clip(_border_rays(camera)[..., 0], -1, 1))
    margin = WIDER + 2 * np.abs(np.diff(from_axis, 2)).max()
    angle = most if np.isnan(margin) else min(float(from_axis.max() + margin), most)
    return math.cos(angle), math.sin(angle)


def _border_rays(camera: Camera) -> Float64Array:
    """Rays along the outer edges of the image: left, right, upper, lower; shape (4, SAMPLES, 3)."""
    right, bottom = camera.width - 0.5, camera.height - 0.5
    u, v = np.linspace(-0.5, right, SAMPLES), np.linspace(-0.5, bottom, SAMPLES)
    start = np.full(SAMPLES, -0.5)
    columns = np.stack([start, np.full(SAMPLES, right), u, u])
    rows = np.stack([v, v, start, np.full(SAMPLES, bottom)])
    return camera.directions(columns, rows)
