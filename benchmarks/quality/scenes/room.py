"""A furnished room: the demo's boxes, and round and thin things among them."""

from __future__ import annotations

import math
from collections.abc import Iterator

from benchmarks.quality.scenes.scene import Look, Scene
from benchmarks.quality.solids import Solid, box, rod, sphere, upright
from depthwarp.scanner.room import furnished_room

__all__ = ["room"]

TABLE_TOP = 0.75  # m, of the demo's table, whose middle is at (1.85, 7.05)


def room() -> Scene:
    """6.6 x 9.6 x 2.8 m; scanned from the middle of its free part."""
    boxes = [box(part.center, part.size, part.yaw) for part in furnished_room().boxes]
    solids = (*boxes, *_lamps(), *_table_ware(), *_plant(4.5, 8.6), *_coat_stand(-0.9, 3.6))
    looks = (
        Look((0.5, 4.3, 1.2), (2.4, 9.0, 0.9)),
        Look((4.2, 4.2, 1.3), (1.0, 9.2, 0.8)),
        Look((4.7, 8.9, 1.7), (0.8, 5.8, 0.4)),
        Look((-1.1, 8.9, 1.6), (3.2, 6.0, 0.6)),
        Look((4.6, 5.0, 1.0), (0.8, 7.8, 0.7)),
        Look((3.2, 5.2, 0.8), (1.2, 8.4, 0.5)),
        Look((4.2, 6.4, 1.2), (0.2, 8.4, 0.5)),
        Look((-0.8, 5.6, 1.1), (3.6, 8.2, 0.7)),
    )
    return Scene("room", solids, ((2.0, 4.7, 1.5),), looks, scanner_reach=30.0)


def _lamps() -> Iterator[Solid]:
    """A lamp on a pole and one that hangs over the table."""
    yield upright(4.3, 3.0, (0.0, 0.03), 0.16)
    yield upright(4.3, 3.0, (0.03, 1.6), 0.0125)
    yield sphere((4.3, 3.0, 1.72), 0.16)
    yield upright(1.85, 7.05, (1.75, 2.8), 0.006)
    yield upright(1.85, 7.05, (1.5, 1.75), 0.19)


def _table_ware() -> Iterator[Solid]:
    """Bottles, a bowl and a candle holder on the table."""
    for x, y, height in ((1.5, 7.2, 0.3), (1.62, 7.24, 0.26), (2.3, 6.85, 0.32)):
        yield upright(x, y, (TABLE_TOP, TABLE_TOP + 0.65 * height), 0.038)
        yield upright(x, y, (TABLE_TOP + 0.65 * height, TABLE_TOP + height), 0.014)
    yield sphere((1.95, 7.1, TABLE_TOP + 0.09), 0.11)
    yield upright(2.1, 7.25, (TABLE_TOP, TABLE_TOP + 0.28), 0.011)


def _plant(x: float, y: float) -> Iterator[Solid]:
    """A pot of thin stems with round leaves."""
    yield upright(x, y, (0.0, 0.35), 0.17)
    for turn in range(9):
        angle, reach = 0.7 * turn, 0.14 + 0.035 * turn
        top = (x + reach * math.cos(angle), y + reach * math.sin(angle), 1.5 - 0.09 * turn)
        yield rod((x, y, 0.33), top, 0.007)
        yield sphere(top, 0.05)


def _coat_stand(x: float, y: float) -> Iterator[Solid]:
    """A pole with six pegs and three feet."""
    yield upright(x, y, (0.0, 1.8), 0.02)
    for turn in range(6):
        angle = math.pi / 3 * turn
        cos, sin = math.cos(angle), math.sin(angle)
        yield rod((x, y, 1.6), (x + 0.16 * cos, y + 0.16 * sin, 1.75), 0.009)
        if turn % 2 == 0:
            yield rod((x, y, 0.2), (x + 0.28 * cos, y + 0.28 * sin, 0.01), 0.013)
