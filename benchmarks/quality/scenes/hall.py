"""A store hall: columns, racks with goods, rails, pipes, and poles of a few centimetres."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.quality.scenes.scene import Look, Scene
from benchmarks.quality.solids import Solid, Vector, box_between, rod, upright

__all__ = ["hall"]

LENGTH, WIDTH, HEIGHT = 34.0, 22.0, 7.0
RACK_ROWS = ((3.0, 12.0, 4.5), (15.0, 30.0, 4.5), (3.0, 15.0, 15.5), (19.0, 30.0, 15.5))
"""Start and end along x, and the front along y, of each double row of racks [m]."""

BAY, DEPTH, POST = 2.7, 1.1, 0.08
LEVELS = (1.2, 2.4, 3.6)


def hall() -> Scene:
    """34 x 22 x 7 m; scanned from two places between the racks."""
    solids = [*_shell(), *_columns(), *_poles(), *_rail(), *_pipes()]
    generator = np.random.default_rng(5)
    for start, end, front in RACK_ROWS:
        solids += [*_rack(start, end, front, generator), *_rack(start, end, front + 1.2, generator)]
    looks = (
        Look((9.0, 11.0, 1.7), (20.0, 16.0, 1.5)),
        Look((30.0, 11.2, 1.8), (14.0, 6.0, 1.6)),
        Look((13.7, 2.6, 1.6), (17.5, 16.0, 1.8)),
        Look((19.5, 17.5, 2.4), (14.0, 5.0, 1.0)),
        Look((5.4, 12.0, 1.6), (20.0, 5.0, 2.0)),
        Look((27.5, 10.0, 3.2), (14.0, 16.0, 0.8)),
        Look((22.0, 14.2, 1.4), (2.0, 9.5, 2.0)),
        Look((6.0, 10.2, 2.0), (29.0, 12.5, 1.2)),
    )
    scanners = ((13.4, 11.0, 1.8), (24.0, 9.5, 1.8))
    return Scene("hall", tuple(solids), scanners, looks, scanner_reach=60.0)


def _shell() -> Iterator[Solid]:
    """Floor, ceiling, walls, and beams below the ceiling."""
    x, y, z = (0.0, LENGTH), (0.0, WIDTH), (0.0, HEIGHT)
    yield box_between(x, y, (-0.2, 0.0))
    yield box_between(x, y, (HEIGHT, HEIGHT + 0.2))
    for end in (-0.2, LENGTH):
        yield box_between((end, end + 0.2), y, z)
    for side in (-0.2, WIDTH):
        yield box_between(x, (side, side + 0.2), z)
    for place in np.arange(3.0, LENGTH, 4.0):
        yield box_between((place - 0.1, place + 0.1), y, (HEIGHT - 0.5, HEIGHT))


def _columns() -> Iterator[Solid]:
    """Round columns on square feet."""
    for x in np.arange(4.0, LENGTH, 6.5):
        for y in (3.2, 8.6, 13.6, 19.0):
            yield upright(x, y, (0.3, HEIGHT), 0.25)
            yield box_between((x - 0.35, x + 0.35), (y - 0.35, y + 0.35), (0.0, 0.3))


def _rack(start: float, end: float, y: float, generator: np.random.Generator) -> Iterator[Solid]:
    """Posts, boards on beams, and goods of random size with gaps between them."""
    posts = np.arange(start, end + 0.01, BAY)
    for x in posts:
        for side in (y, y + DEPTH - POST):
            yield box_between((x, x + POST), (side, side + POST), (0.0, LEVELS[-1] + 0.3))
        yield rod((x + 0.04, y + 0.04, 0.2), (x + 0.04, y + DEPTH - 0.04, 1.4), 0.02)
        yield rod((x + 0.04, y + DEPTH - 0.04, 1.4), (x + 0.04, y + 0.04, 2.6), 0.02)
    for level in (0.12, *LEVELS):
        for side in (y, y + DEPTH - 0.05):
            beam = (side, side + 0.05)
            yield box_between((posts[0], posts[-1]), beam, (level - 0.12, level))
        x = posts[0] + 0.1
        while x < posts[-1] - 1.0:
            wide, deep, high = generator.uniform((0.4, 0.4, 0.3), (1.0, 0.95, 0.95))
            if generator.random() < 0.62:
                yield box_between((x, x + wide), (y + 0.05, y + 0.05 + deep), (level, level + high))
            x += wide + generator.uniform(0.05, 0.35)


def _poles() -> Iterator[Solid]:
    """Thin poles from floor to ceiling, and posts of a barrier."""
    generator = np.random.default_rng(6)
    for x, y in generator.uniform((2.0, 7.6), (LENGTH - 2, 14.6), (14, 2)):
        yield upright(float(x), float(y), (0.0, HEIGHT), float(generator.uniform(0.015, 0.04)))
    for x in np.arange(3.0, 31.0, 1.4):
        yield upright(x, 12.4, (0.0, 1.1), 0.024)


def _rail() -> Iterator[Solid]:
    """The barrier's two rails."""
    ends: tuple[Vector, Vector]
    for z in (0.55, 1.08):
        ends = ((3.0, 12.4, z), (30.0, 12.4, z))
        yield rod(*ends, 0.02)


def _pipes() -> Iterator[Solid]:
    """Pipes along the hall, hung on thin rods."""
    for y, z, radius in ((7.4, 5.4, 0.12), (7.9, 5.5, 0.05), (14.2, 5.2, 0.16)):
        yield rod((0.5, y, z), (LENGTH - 0.5, y, z), radius)
        for x in np.arange(2.0, LENGTH - 1, 3.0):
            yield upright(x, y, (z, HEIGHT), 0.008)
