"""Slanted floors at grazing angles: a yard with ramps, a stair, low walls and a few posts."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchmarks.quality.scenes.scene import Look, Scene
from benchmarks.quality.solids import Solid, box, box_between, upright

__all__ = ["slopes"]


def slopes() -> Scene:
    """40 x 24 m, looked at from 0.25 to 1 m above the floor; scanned from two places."""
    solids = [*_yard(), *_ramps(), *_stair(), *_posts()]
    looks = (
        Look((-16.0, -1.0, 0.5), (-8.0, -0.2, 0.0)),
        Look((-12.5, 6.0, 0.6), (-2.0, 3.5, 0.0)),
        Look((6.0, -8.5, 0.4), (-2.0, -5.5, 0.0)),
        Look((3.0, -10.0, 0.5), (5.5, -2.0, 0.0)),
        Look((-5.0, 8.5, 0.4), (3.0, 3.0, 0.0)),
        Look((13.0, 3.5, 1.0), (6.0, -1.0, 0.0)),
        Look((-4.0, -1.5, 0.35), (4.0, -2.0, 0.1)),
        Look((17.0, 2.0, 0.8), (8.0, 4.5, 0.2)),
    )
    scanners = ((-6.0, 1.0, 1.6), (6.5, -2.0, 1.6))
    return Scene("slopes", tuple(solids), scanners, looks, scanner_reach=60.0)


def _yard() -> Iterator[Solid]:
    """A level floor between walls of 3 m, open above."""
    yield box_between((-20.0, 20.0), (-12.0, 12.0), (-0.2, 0.0))
    for end in (-20.2, 20.0):
        yield box_between((end, end + 0.2), (-12.0, 12.0), (0.0, 3.0))
    for side in (-12.2, 12.0):
        yield box_between((-20.0, 20.0), (side, side + 0.2), (0.0, 3.0))


def _ramps() -> Iterator[Solid]:
    """Ramps of 4, 8, 15 and 30 degrees, one of them turned, and a bank across the yard."""
    yield box((4.0, 3.5, -0.06), (9.0, 3.0, 0.6), pitch=-4.0)
    yield box((11.0, -3.0, 0.1), (7.0, 3.0, 0.8), yaw=25.0, pitch=-8.0)
    yield box((-3.0, -7.0, 0.15), (5.0, 4.0, 1.0), yaw=-60.0, pitch=-15.0)
    yield box((15.0, 7.0, 0.0), (5.0, 5.0, 2.0), yaw=200.0, pitch=-30.0)
    yield box((-13.0, -6.0, 0.0), (5.0, 8.0, 0.7), yaw=90.0, pitch=5.0)


def _stair() -> Iterator[Solid]:
    """Eight steps of 16 cm."""
    for step in range(8):
        low = 8.0 + 0.3 * step
        yield box_between((-12.0, -9.0), (low, 12.0), (0.16 * step, 0.16 * (step + 1)))


def _posts() -> Iterator[Solid]:
    """Posts in rows, low walls and kerbs that stand across the floor."""
    for x in np.arange(-12.0, 13.0, 4.0):
        yield upright(x, -4.8, (0.0, 1.0), 0.05)
        yield upright(x + 1.5, 7.0, (0.0, 2.2), 0.03)
    yield box_between((-2.0, 2.0), (6.2, 6.4), (0.0, 0.5))
    yield box_between((-9.0, -8.85), (-3.0, 3.0), (0.0, 0.12))
    yield box_between((1.0, 1.15), (-4.0, 1.0), (0.0, 0.12))
