"""A street: houses with balconies, parked cars, lamp posts, a picket fence, bare trees."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import numpy.typing as npt

from benchmarks.quality.scenes.scene import Look, Scene
from benchmarks.quality.solids import Solid, Vector, box, box_between, rod, sphere, upright

__all__ = ["street"]

HALF_LENGTH, KERB_Y, FACADE_Y = 32.0, 4.0, 9.5
PAVEMENT = 0.12
TREES = ((-9.0, 5.4), (4.5, 5.6), (15.0, -5.5), (-2.5, -5.4))
CARS = ((-14.0, -3.0), (-6.5, -3.0), (1.5, -3.05), (9.5, -2.95), (-4.0, 3.0), (10.5, 3.05))


def street() -> Scene:
    """64 m of a street of 19 m between the facades; scanned from two places on the road."""
    solids = [*_ground(), *_houses(), *_fence(-22.0, 22.0, 7.2), *_street_lamps(), *_signs()]
    for x, y in CARS:
        solids += [part.moved(x, y) for part in _car()]
    for seed, (x, y) in enumerate(TREES):
        solids += _tree(x, y, np.random.default_rng(seed))
    looks = (
        Look((-12.0, 0.3, 1.6), (6.0, 6.5, 1.8)),
        Look((13.0, -0.5, 1.7), (-6.0, 6.5, 2.0)),
        Look((0.5, -7.6, 1.7), (3.5, 9.0, 2.0)),
        Look((-12.5, -1.6, 1.6), (4.0, 5.5, 1.4)),
        Look((19.0, 6.2, 1.7), (-4.0, 5.4, 1.8)),
        Look((-6.0, 8.4, 1.5), (4.0, -4.0, 1.2)),
        Look((7.5, 1.0, 2.6), (-9.5, -6.0, 1.5)),
        Look((-1.0, 0.6, 1.2), (-9.5, 6.4, 2.2)),
    )
    scanners = ((-5.0, 0.4, 1.9), (8.0, -0.6, 1.9))
    return Scene("street", tuple(solids), scanners, looks, scanner_reach=80.0)


def _ground() -> Iterator[Solid]:
    """The road, and a pavement with a kerb on each side."""
    along = (-HALF_LENGTH, HALF_LENGTH)
    yield box_between(along, (-FACADE_Y, FACADE_Y), (-0.3, 0.0))
    for low, high in ((KERB_Y, FACADE_Y), (-FACADE_Y, -KERB_Y)):
        yield box_between(along, (low, high), (0.0, PAVEMENT))


def _houses() -> Iterator[Solid]:
    """Two rows of houses of different heights, with gaps, window frames, sills and balconies."""
    generator = np.random.default_rng(11)
    for side in (-1.0, 1.0):
        x = -HALF_LENGTH
        while x < HALF_LENGTH - 6:
            wide, high = float(generator.uniform(7, 11)), float(generator.uniform(5.5, 10))
            front = FACADE_Y + float(generator.uniform(0, 0.8))
            y = (side * front, side * (front + 8))
            yield box_between((x, x + wide), (min(y), max(y)), (0.0, high))
            yield from _windows(x, wide, high, side * front, side)
            x += wide + (1.6 if generator.random() < 0.4 else 0.0)


def _windows(x: float, wide: float, high: float, y: float, side: float) -> Iterator[Solid]:
    """Frames and sills that stand out of a facade; balconies on the first floor."""
    for place in np.arange(x + 1.2, x + wide - 1.0, 2.1):
        for floor in np.arange(1.1, high - 1.6, 2.8):
            yield box((place, y - side * 0.09, floor - 0.05), (1.3, 0.18, 0.06))
            for edge in (-0.55, 0.0, 0.55):
                yield box((place + edge, y - side * 0.03, floor + 0.7), (0.07, 0.06, 1.4))
    middle, out = x + wide / 2, y - side * 0.9
    yield box((middle, y - side * 0.45, 2.75), (2.6, 0.9, 0.12))
    yield rod((middle - 1.3, out, 3.75), (middle + 1.3, out, 3.75), 0.02)
    for place in np.arange(middle - 1.3, middle + 1.31, 0.13):
        yield upright(place, out, (2.8, 3.75), 0.008)


def _fence(start: float, end: float, y: float) -> Iterator[Solid]:
    """Pickets of 7 cm every 14 cm on two rails, in front of the gardens; a gate left open."""
    for x in np.arange(start, end, 0.14):
        if not 0.0 < x < 1.2:
            yield box((x, y, PAVEMENT + 0.55), (0.07, 0.02, 1.1))
    for low, high in ((start, 0.0), (1.2, end)):
        for z in (0.45, 0.95):
            yield box_between((low, high), (y + 0.01, y + 0.05), (z, z + 0.06))


def _car() -> Iterator[Solid]:
    """A car around the origin, along x: body, cabin on thin pillars, wheels, mirrors."""
    yield box((0.0, 0.0, 0.62), (4.2, 1.7, 0.62))
    yield box((-0.2, 0.0, 1.44), (2.0, 1.4, 0.06))
    for x, top in ((1.3, 0.75), (-0.2, -0.2), (-1.55, -1.15)):
        for y in (-0.68, 0.68):
            yield rod((x, y, 0.93), (top, y, 1.43), 0.03)
    for x in (-1.3, 1.3):
        for y in (-0.78, 0.78):
            yield rod((x, y - 0.1, 0.31), (x, y + 0.1, 0.31), 0.31)
    for y in (-0.95, 0.95):
        yield box((0.85, y, 1.0), (0.12, 0.22, 0.14))


def _street_lamps() -> Iterator[Solid]:
    """Posts with an arm over the road, and a row of bollards."""
    for x, y in ((-18.0, 4.5), (0.0, 4.5), (18.0, 4.5), (-9.0, -4.5), (9.0, -4.5)):
        inward = -1.0 if y > 0 else 1.0
        yield upright(x, y, (0.0, 5.5), 0.06)
        yield rod((x, y, 5.4), (x, y + inward * 1.4, 5.8), 0.03)
        yield sphere((x, y + inward * 1.5, 5.75), 0.18)
    for x in np.arange(-20.0, 20.0, 2.0):
        yield upright(x, -4.25, (0.0, 0.9), 0.05)


def _signs() -> Iterator[Solid]:
    """Round signs on poles of 5 cm."""
    for x, y in ((-3.5, 4.3), (6.8, -4.6), (12.4, 4.3)):
        yield upright(x, y, (0.0, 2.9), 0.025)
        yield rod((x - 0.01, y, 2.6), (x + 0.01, y, 2.6), 0.3)


def _tree(x: float, y: float, generator: np.random.Generator) -> list[Solid]:
    """A bare tree: a trunk of 15 cm whose branches fork down to twigs of 1 cm."""
    solids: list[Solid] = []
    start, up = np.array([x, y, PAVEMENT]), np.array([0.0, 0.0, 1.0])
    _grow(solids, generator, start, up, length=2.1, radius=0.15, forks=5)
    return solids


def _grow(
    solids: list[Solid],
    generator: np.random.Generator,
    start: npt.NDArray[np.float64],
    along: npt.NDArray[np.float64],
    length: float,
    radius: float,
    forks: int,
) -> None:
    """One branch and what grows on its end."""
    end = start + length * along
    solids.append(rod(_point(start), _point(end), radius))
    if forks == 0:
        return
    for _ in range(3):
        way = along + generator.normal(0.0, 0.42, 3) + (0.0, 0.0, 0.12)
        way /= np.linalg.norm(way)
        longer = length * float(generator.uniform(0.62, 0.85))
        _grow(solids, generator, end, way, longer, max(0.6 * radius, 0.008), forks - 1)


def _point(values: npt.NDArray[np.float64]) -> Vector:
    x, y, z = values.tolist()
    return x, y, z
