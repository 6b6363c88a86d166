"""The sensor model in plain loops, in float32."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from .layers import present

EMPTY = 0
WORD = 0xFFFFFFFF
f32 = np.float32
Maps = tuple[np.ndarray, np.ndarray, np.ndarray]


def philox(counter: Sequence[int], key: Sequence[int]) -> tuple[int, int, int, int]:
    """Philox4x32-10 of Salmon, Moraes, Dror and Shaw (2011), in whole numbers of any size."""
    a, b, c, d = counter
    k0, k1 = key
    for _ in range(10):
        left, right = 0xD2511F53 * a, 0xCD9E8D57 * c
        a, b, c, d = (right >> 32) ^ b ^ k0, right & WORD, (left >> 32) ^ d ^ k1, left & WORD
        k0, k1 = (k0 + 0x9E3779B9) & WORD, (k1 + 0xBB67AE85) & WORD
    return a, b, c, d


def uniform(word: int) -> np.float32:
    """A float from 0 to below 1, of 24 bits."""
    return f32(word >> 8) / f32(2**24)


def log(x: np.float32) -> np.float32:
    """Natural logarithm: series of artanh, in the order of the kernel's operations."""
    mantissa, exponent = math.frexp(float(x))  # from 0.5 to below 1
    m, e = f32(2 * mantissa), exponent - 1
    if m > f32(math.sqrt(2)):
        m, e = f32(mantissa), exponent
    s = (m - f32(1)) / (m + f32(1))
    q = s * s
    series = f32(1 / 9)
    for odd in (7, 5, 3, 1):
        series = f32(1 / odd) + q * series
    return f32(e) * f32(math.log(2)) + f32(2) * s * series


def normal(radius_word: int, turn_word: int) -> np.float32:
    """A normal number by Box and Muller."""
    radius = np.sqrt(f32(-2) * log(f32(radius_word | 1) / f32(2**32)))
    x = f32(math.pi / 2) * (uniform((turn_word << 2) & WORD) - f32(0.5))
    q = x * x
    quarter = turn_word >> 30
    if quarter % 2:
        part = x * (f32(1) + q * (f32(-1 / 6) + q * (f32(1 / 120) + q * f32(-1 / 5040))))
    else:
        inner = f32(1 / 24) + q * (f32(-1 / 720) + q * f32(1 / 40320))
        part = f32(1) + q * (f32(-1 / 2) + q * inner)
    return radius * (part if quarter < 2 else -part)


def dot(a: np.ndarray, b: np.ndarray) -> np.float32:
    """Dot product, from the left."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Cross product."""
    turned = [a[i] * b[j] - a[j] * b[i] for i, j in ((1, 2), (2, 0), (0, 1))]
    return np.array(turned, f32)


class Surface:
    """A map as points: what a pixel's neighbours tell about the surface."""

    def __init__(self, depth: np.ndarray, rays: np.ndarray, wraps: bool) -> None:
        self.depth, self.wraps = depth, wraps
        with np.errstate(all="ignore"):
            self.points = rays[0] + rays[1] * depth[..., None]
        self.directions = rays[1]

    def beside(self, row: int, column: int) -> tuple[int, int] | None:
        """The place of a pixel that has a depth, round the turn; or None."""
        rows, columns = self.depth.shape
        if self.wraps:
            column %= columns
        inside = 0 <= row < rows and 0 <= column < columns
        return (row, column) if inside and self.depth[row, column] > 0 else None

    def tangent(self, own: tuple[int, int], a, b) -> np.ndarray:
        """To the neighbour on an axis that is nearer in depth; the first of equal ones."""
        there = [place for place in (a, b) if place]
        if not there:
            return np.zeros(3, f32)
        nearest = min(there, key=lambda place: abs(self.depth[place] - self.depth[own]))
        return self.points[nearest] - self.points[own]

    def goes_on(self, a, b, c, within: np.float32) -> bool:
        """Whether the surface from a to b goes on to c: in depth, and in a line."""
        if not a or not (self.depth[b] - self.depth[a]) * (self.depth[c] - self.depth[b]) > 0:
            return False
        line = self.points[b] - self.points[a]
        off = cross(line, self.points[c] - self.points[b])
        return bool(dot(off, off) <= within * within * dot(line, line))

    def jump(self, own: tuple[int, int], x: int, y: int, least: np.float32) -> np.float32:
        """The difference of depth to a neighbour across an edge; 0 if there is none."""
        row, column = own
        other = self.beside(row + y, column + x)
        if not other or not abs(self.depth[other] - self.depth[own]) > least:
            return f32(0)
        opposite = self.beside(row - y, column - x)
        beyond = self.beside(row + 2 * y, column + 2 * x)
        slope = self.goes_on(opposite, own, other, least) or self.goes_on(beyond, other, own, least)
        return f32(0) if slope else self.depth[other] - self.depth[own]


def sensed(noise, surface: Surface, own: tuple[int, int], words: Sequence[int]) -> np.float32:
    """What the sensor says of a pixel that has a depth; 0 for nothing."""
    row, column = own
    places = [(row, column - 1), (row, column + 1), (row - 1, column), (row + 1, column)]
    left, right, up, down = (surface.beside(*place) for place in places)
    true = depth = surface.depth[own]
    if noise.grazing_angle < 90:
        normal_of = cross(surface.tangent(own, left, right), surface.tangent(own, up, down))
        ray = surface.directions[own]
        square = dot(normal_of, normal_of) * dot(ray, ray)
        limit = f32(math.cos(math.radians(noise.grazing_angle)))
        if square > 0:
            share = f32(1) - abs(dot(normal_of, ray)) / (np.sqrt(square) * limit)
            if uniform(words[2]) < share:
                return f32(0)
    share, least = f32(noise.flying_share), f32(noise.flying_jump)
    if uniform(words[3]) < share:
        jumps = [surface.jump(own, x, y, least) for x, y in ((-1, 0), (1, 0), (0, -1), (0, 1))]
        depth = depth + max(jumps, key=abs) * (uniform(words[3]) / share)
    if noise.disparity_noise > 0:
        sigma = f32(noise.disparity_noise) * depth * depth
        depth = depth + sigma * normal(words[0], words[1])
    if noise.disparity_step > 0 and depth > 0:
        step = f32(noise.disparity_step)
        level = np.floor(f32(1) / (depth * step) + f32(0.5))
        depth = f32(1) / (level * step) if level > 0 else f32(0)
    if noise.depth_step > 0:
        step = f32(noise.depth_step)
        depth = np.floor(depth / step + f32(0.5)) * step
    bound = f32(noise.min_range)
    seen = true >= bound and depth >= bound and 0 < depth < f32(3e38)
    return depth if seen else f32(0)


def add_noise(
    maps: Maps, noise, rays: np.ndarray, wraps: bool, world: int, camera: int, step: int
) -> Maps:
    """One map (depth, index, state) as the sensor would report it.

    Args:
        maps: The map, shape (H, W) each.
        noise: Anything with the attributes of `SensorNoise`.
        rays: Origins and directions of the pixels' rays, shape (2, H, W, 3), float32.
        wraps: Whether the first and the last column are neighbours.
        world: Number of the world.
        camera: Number of the camera in its world.
        step: Number of the step, from 1.
    """
    depth, index, state = (array.copy() for array in maps)
    there = present(depth, state)
    surface = Surface(np.where(there, depth, 0).astype(f32), rays, wraps)
    key = noise.seed & WORD, noise.seed >> 32
    for row, column in np.argwhere(there).tolist():
        words = philox((row * depth.shape[1] + column, camera, world, step), key)
        with np.errstate(all="ignore"):
            depth[row, column] = sensed(noise, surface, (row, column), words)
        if depth[row, column] == 0:
            index[row, column], state[row, column] = -1, EMPTY
    return depth, index, state
