"""Scenes as data: which points, in which order, seen by which cameras.

The same fields give the same points. `scene_catalogue.py` lists all of them by name.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

import numpy as np
import numpy.typing as npt

from depthwarp import PinholeCamera
from depthwarp.scanner import room as furnished

__all__ = [
    "ORDERS",
    "AerialScene",
    "FurnishedScene",
    "Order",
    "RoomScene",
    "ScanScene",
    "Scene",
    "UniformScene",
]

Float32Array = npt.NDArray[np.float32]
Float64Array = npt.NDArray[np.float64]
Vector = tuple[float, float, float]

Order = Literal["made", "shuffled", "sorted"]
ORDERS: tuple[Order, ...] = get_args(Order)

SORT_BITS = 10
"""Of a coordinate in a caller's own spatial sort: 1024 cells along the longest side."""

COLUMNS_A_BLOCK = 16  # of a scan: its arrays stay in a core's own cache


@dataclass(frozen=True)
class Scene:
    """Points and a camera.

    Attributes:
        made_order: In which order a scene makes its points.
        usual_counts: Numbers of points that are measured unless others are asked for.
        point_count: Number of points.
        order: As the scene makes them; shuffled, the hardest for a Z-buffer, since neighbours in
            memory are not neighbours in the image; or sorted along a Morton curve, as a caller who
            sorts a cloud would have them.
        seed: Of everything random.
        image_size: (width, height) [px].
        fov_deg: (horizontal, vertical) [degrees].
        position_m: Where the camera stands.
        orientation_deg: Roll, pitch and yaw.
        max_range_m: Farthest depth that is drawn.
    """

    point_count: int
    name: str = ""
    order: Order = "made"
    seed: int = 0
    image_size: tuple[int, int] = (724, 662)
    fov_deg: tuple[float, float] = (60.0, 56.0)
    position_m: Vector = (0.0, 0.0, 0.0)
    orientation_deg: Vector = (0.0, 0.0, 0.0)
    max_range_m: float = 100.0

    made_order: ClassVar[str] = "random"
    usual_counts: ClassVar[tuple[int, ...]] = (10_000_000,)

    @property
    def missing(self) -> str | None:
        """Why the scene cannot be had on this machine; None where it can."""
        return None

    def points_world(self) -> Float32Array:
        """Points [m], shape (point_count, 3), float32."""
        generator = np.random.default_rng(self.seed)
        points = self.make_points(generator)
        if self.order == "shuffled":
            return points[generator.permutation(len(points))]
        return points[_morton_order(points)] if self.order == "sorted" else points

    def make_points(self, generator: np.random.Generator) -> Float32Array:
        """Points [m] in the scene's own order, shape (point_count, 3), float32."""
        raise NotImplementedError

    def camera(self) -> PinholeCamera:
        """The one camera."""
        return self._camera(self.position_m, self.orientation_deg)

    def cameras(self, count: int) -> list[PinholeCamera]:
        """Cameras all round from the one camera's place; the first is `camera()`."""
        roll, pitch, yaw = self.orientation_deg
        turns = [(roll, pitch, yaw + 360 * view / count) for view in range(count)]
        return [self._camera(self.position_m, turn) for turn in turns]

    def _camera(self, position: Vector, orientation: Vector) -> PinholeCamera:
        return PinholeCamera.from_fov(self.fov_deg, self.image_size, position, orientation)


@dataclass(frozen=True)
class RoomScene(Scene):
    """An empty room seen from inside: points uniform on the floor, the ceiling, the four walls."""

    name: str = "room"
    room_m: Vector = (6.0, 5.0, 2.7)
    position_m: Vector = (1.79, 3.3, 1.2)
    orientation_deg: Vector = (0.0, 0.0, -30.0)

    usual_counts: ClassVar[tuple[int, ...]] = (1_000_000, 10_000_000)

    def make_points(self, generator: np.random.Generator) -> Float32Array:
        """Points on the six faces of the room."""
        size = np.array(self.room_m, dtype=np.float32)
        areas = np.prod(size) / size  # of a face across each axis
        axis = generator.choice(3, self.point_count, p=areas / areas.sum())
        points = generator.random((self.point_count, 3), dtype=np.float32)
        points[np.arange(self.point_count), axis] = generator.integers(0, 2, self.point_count)
        return points * size


@dataclass(frozen=True)
class UniformScene(Scene):
    """Points uniform in a box, with the camera in its middle: no surface, nothing hides."""

    name: str = "uniform"
    box_m: Vector = (10.0, 10.0, 10.0)

    def make_points(self, generator: np.random.Generator) -> Float32Array:
        """Points in the box, its middle in the origin."""
        points = generator.random((self.point_count, 3), dtype=np.float32) - np.float32(0.5)
        return points * np.array(self.box_m, dtype=np.float32)


@dataclass(frozen=True)
class ScanScene(RoomScene):
    """The empty room as a rotating scanner sees it: column after column, dense where it is near.

    Equal steps of azimuth and of elevation, the scanner beside the camera.
    """

    name: str = "scan"
    scanner_m: Vector = (2.6, 2.1, 1.5)
    elevation_deg: tuple[float, float] = (-60.0, 90.0)

    made_order: ClassVar[str] = "scan"
    usual_counts: ClassVar[tuple[int, ...]] = (10_000_000,)

    def make_points(self, generator: np.random.Generator) -> Float32Array:
        """Where the scanner's rays meet the faces of the room."""
        low, high = np.radians(self.elevation_deg)
        rows = max(1, round((self.point_count * (high - low) / (2 * np.pi)) ** 0.5))
        columns = -(-self.point_count // rows)
        elevation = np.linspace(low, high, rows)
        azimuth = np.arange(columns) * (2 * np.pi / columns)
        points = np.empty((columns, rows, 3), dtype=np.float32)
        for first in range(0, columns, COLUMNS_A_BLOCK):
            block = slice(first, first + COLUMNS_A_BLOCK)
            points[block] = self._first_hits(azimuth[block, None], elevation)
        return points.reshape(-1, 3)[: self.point_count]

    def _first_hits(self, azimuth: Float64Array, elevation: Float64Array) -> Float64Array:
        flat = np.cos(elevation)
        directions = np.stack(
            [np.cos(azimuth) * flat, np.sin(azimuth) * flat, 0 * azimuth + np.sin(elevation)], -1
        )
        ahead = np.where(directions > 0, self.room_m, 0.0) - self.scanner_m
        distances = ahead / np.where(directions == 0, 1e-300, directions)
        hits: Float64Array = directions * np.abs(distances).min(axis=-1, keepdims=True)
        return hits + self.scanner_m


@dataclass(frozen=True)
class FurnishedScene(Scene):
    """The simulated scanner's furnished room: points uniform on all faces that look inwards.

    Many surfaces hide others, so many points compete for a pixel.
    """

    name: str = "furnished"
    position_m: Vector = (1.79, 3.3, 1.25)  # at 1.2 m a shelf is seen on edge, on a pixel border
    orientation_deg: Vector = (0.0, 0.0, 90.0)

    usual_counts: ClassVar[tuple[int, ...]] = (200_000, 2_000_000, 10_000_000)

    def make_points(self, generator: np.random.Generator) -> Float32Array:
        """Points on the faces of walls and furniture."""
        corner, edges = _faces_inside()
        areas = np.linalg.norm(edges, axis=2).prod(axis=1)
        face = generator.choice(len(corner), self.point_count, p=areas / areas.sum())
        points = corner.astype(np.float32)[face]
        for edge in edges.transpose(1, 0, 2).astype(np.float32):
            points += generator.random((self.point_count, 1), dtype=np.float32) * edge[face]
        return points


@dataclass(frozen=True)
class AerialScene(Scene):
    """Hills with rows of flat-roofed buildings, from an aeroplane that looks straight down.

    Points are uniform over the map, on the ground and on roofs; the frame's origin is its middle.
    """

    name: str = "aerial"
    map_m: float = 1200.0
    block_m: float = 60.0
    building_m: float = 32.0
    position_m: Vector = (0.0, 0.0, 500.0)
    orientation_deg: Vector = (0.0, 90.0, 0.0)
    max_range_m: float = 1000.0

    def make_points(self, generator: np.random.Generator) -> Float32Array:
        """Points on hills and roofs."""
        points = np.empty((self.point_count, 3), dtype=np.float32)
        ground = generator.random((self.point_count, 2), dtype=np.float32) - np.float32(0.5)
        points[:, :2] = ground * np.float32(self.map_m)
        x, y = points[:, 0], points[:, 1]
        points[:, 2] = 20 * np.sin(x / 170) * np.cos(y / 230) + 4 * np.sin(x / 31 + y / 43)
        side = int(self.map_m / self.block_m)
        roofs = generator.uniform(6, 40, (side, side)).astype(np.float32)
        cells = (points[:, :2] + np.float32(self.map_m / 2)) / np.float32(self.block_m)
        block = np.minimum(cells.astype(np.int32), side - 1)
        apart = np.abs(cells - block - np.float32(0.5)).max(axis=1)  # from the block's middle
        built = apart < self.building_m / self.block_m / 2
        points[built, 2] += roofs[block[built, 0], block[built, 1]]
        return points

    def cameras(self, count: int) -> list[PinholeCamera]:
        """Cameras on a circle over the map, the first over its middle: `camera()`."""
        radius, height = self.map_m / 4, self.position_m[2]
        places = [self.position_m]
        for view in range(1, count):
            angle = 2 * np.pi * view / count
            places.append((radius * np.cos(angle), radius * np.sin(angle), height))
        return [self._camera(place, self.orientation_deg) for place in places]


def _faces_inside() -> tuple[Float64Array, Float64Array]:
    """Faces of the furnished room that are not outside its walls.

    Returns:
        A corner of each, shape (F, 3), and the two edges from there, shape (F, 2, 3) [m].
    """
    low = np.array([furnished.LEFT_X, 0.0, 0.0])
    high = np.array([furnished.RIGHT_X, furnished.FAR_WALL_Y, furnished.HEIGHT])
    corners, edges = [], []
    for box in furnished.furnished_room().boxes:
        yaw = np.radians(box.yaw)
        turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        axes = turn.T * np.array(box.size)[:, None]  # a row for each edge of the box
        for across in range(3):
            along = np.delete(axes, across, axis=0)
            for side in (-0.5, 0.5):
                middle = box.center + side * axes[across]
                if ((middle > low - 1e-6) & (middle < high + 1e-6)).all():
                    corners.append(middle - along.sum(axis=0) / 2)
                    edges.append(along)
    return np.array(corners), np.array(edges)


def _morton_order(points: Float32Array) -> npt.NDArray[np.intp]:
    """Rows along a Morton curve (Morton 1966)."""
    low = points.min(axis=0)
    scale = (2**SORT_BITS - 1) / max(float((points.max(axis=0) - low).max()), 1e-9)
    codes = np.zeros(len(points), dtype=np.int32)
    for axis in range(3):
        cell = ((points[:, axis] - low[axis]) * np.float32(scale)).astype(np.int32)
        for bit in range(SORT_BITS):
            codes |= ((cell >> bit) & 1) << (3 * bit + axis)
    return np.argsort(codes, kind="stable")
