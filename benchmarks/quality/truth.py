"""What a view truly shows: exact depth, what the scanner observed, where depth has its edges."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from benchmarks.quality.jumps import jumps
from benchmarks.quality.scanning import ELEVATION_DEG, LEAST_INCIDENCE_DEG, Scan
from benchmarks.quality.scenes import Look, Scene
from benchmarks.quality.world import World
from depthwarp import Camera, PinholeCamera

__all__ = ["HIDDEN_M", "Label", "View", "labels", "look", "near"]

Float64Array = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

HIDDEN_M = 0.05
"""A point is hidden if a surface stands farther in front of it, along the optical axis."""

BAND_PX = 5
SIGHT_M = 1e-4
"""What lies nearer in front of a pixel's point is the point's own surface, and rounding."""


class Label:
    """What a point is, seen from a camera."""

    VISIBLE = 0
    HIDDEN = 1
    BOGUS = 2
    UNKNOWN = 3


@dataclass(frozen=True, eq=False)
class View:
    """A view with its truth.

    Attributes:
        camera: Where it is seen from.
        depth: True depth [m], 0 = nothing there or not known, shape (H, W), float64.
        observed: Whether some scan position could measure what the pixel shows, shape (H, W).
        band: Within 5 px of a depth edge, shape (H, W).
    """

    camera: Camera
    depth: Float64Array
    observed: BoolArray
    band: BoolArray


def look(scene: Scene, world: World, where: Look) -> View:
    """The truth of one view: a ray through every pixel's centre."""
    camera = where.camera()
    rays = _rays(camera)
    center = camera.pose.center_world
    hits = world.cast(center, rays.reshape(-1, 3))
    shape = rays.shape[:2]
    depth = np.where(np.isfinite(hits.distance), hits.distance, 0.0).reshape(shape)
    normal = hits.normal.reshape(rays.shape)
    points = center + rays * depth[..., None]
    met = depth > 0
    observed = np.zeros(shape, dtype=bool)
    for scanner in scene.scanners:
        seen = _observed(world, np.array(scanner), points[met], normal[met], scene.scanner_reach)
        observed[met] |= seen
    return View(camera, depth, observed, near(_edges(depth, normal, rays), BAND_PX))


def labels(
    scan: Scan, world: World, camera: Camera, index: npt.NDArray[np.int32]
) -> npt.NDArray[np.uint8]:
    """What the winners of a splat are.

    Args:
        scan: The cloud.
        world: The solids.
        camera: Where it is seen from.
        index: Winners, -1 = empty, shape (H, W).

    Returns:
        Values of `Label`, shape (H, W); empty pixels hold `Label.VISIBLE`, look at `index`.
    """
    label = np.full(index.shape, Label.VISIBLE, dtype=np.uint8)
    drawn = index >= 0
    winners = index[drawn]
    center, forward = camera.pose.center_world, camera.pose.rotation[0]
    ways = scan.exact[winners] - center
    along = ways @ forward
    # Rays of z 1, so that distances are z depths; a point beside the camera needs no care, its
    # measured place is in the image and its exact one a few millimetres away, or it is bogus.
    hits = world.cast(center, ways / np.where(along > 0, along, 1.0)[:, None])
    hidden = hits.distance < along - HIDDEN_M
    bogus = scan.bogus[winners]
    label[drawn] = np.where(bogus, Label.BOGUS, np.where(hidden, Label.HIDDEN, Label.VISIBLE))
    return label


def _rays(camera: PinholeCamera) -> Float64Array:
    """Directions of z 1 through the pixels' centres, world frame, shape (H, W, 3)."""
    v, u = np.indices((camera.height, camera.width), dtype=np.float64)
    rays = camera.directions(u, v)
    return np.asarray((rays / rays[..., :1]) @ camera.pose.rotation)


def _observed(
    world: World, scanner: Float64Array, points: Float64Array, normal: Float64Array, reach: float
) -> BoolArray:
    """Whether a scanner's ray would have come back from points, shape (N, 3)."""
    ways = points - scanner
    distance = np.linalg.norm(ways, axis=1)
    elevation = np.degrees(np.arcsin(np.clip(ways[:, 2] / distance, -1, 1)))
    facing = -np.einsum("ij,ij->i", ways, normal) / distance
    in_sight = world.sees(scanner, points, SIGHT_M).distance >= 1
    low, high = ELEVATION_DEG
    return np.asarray(
        in_sight
        & (facing >= math.sin(math.radians(LEAST_INCIDENCE_DEG)))
        & (elevation >= low)
        & (elevation <= high)
        & (distance <= reach)
    )


def _edges(depth: Float64Array, normal: Float64Array, rays: Float64Array) -> BoolArray:
    """Pixels on either side of a jump."""
    edges = np.zeros(depth.shape, dtype=bool)
    for axis in (0, 1):
        found = jumps(depth, normal, rays, axis)
        edges |= found | np.roll(found, 1, axis)
    return edges


def near(mask: BoolArray, radius: int) -> BoolArray:
    """Pixels within `radius` of a pixel of the mask."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    return cv2.dilate(mask.astype(np.uint8), disc) > 0
