"""The ray casting of the quality benchmark: exact distances, against arithmetic by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.quality.solids import Solid, box, box_between, rod, sphere, upright
from benchmarks.quality.world import World
from depthwarp.errors import InputError
from depthwarp.scanner.room import furnished_room


@pytest.mark.parametrize(
    ("solid", "origin", "direction", "distance", "normal"),
    [
        (box((5, 0, 0), (2, 2, 2)), (0, 0, 0), (1, 0, 0), 4, (-1, 0, 0)),
        (
            box((5, 0, 0), (2, 2, 2), yaw=45),
            (0, 0.1, 0),
            (1, 0, 0),
            5.1 - math.sqrt(2),
            (-math.sqrt(0.5), math.sqrt(0.5), 0),
        ),
        (
            box((0, 0, 0), (10, 10, 2), pitch=30),
            (0, 0, 5),
            (0, 0, -1),
            5 - 1 / math.cos(math.radians(30)),
            (0.5, 0, math.sqrt(0.75)),
        ),
        (upright(5, 0, (-1, 1), 0.5), (0, 0.3, 0), (1, 0, 0), 4.6, (-0.8, 0.6, 0)),
        (upright(5, 0, (-1, 1), 0.5), (5.2, 0, 4), (0, 0, -2), 1.5, (0, 0, 1)),
        (rod((3, -2, 1), (3, 2, 1), 0.5), (0, 0, 1.4), (1, 0, 0), 2.7, (-0.6, 0, 0.8)),
        (sphere((0, 0, 7), 2), (0, 0, 0), (0, 0, 1), 5, (0, 0, -1)),
    ],
)
def test_a_ray_meets_a_solid_where_it_should(solid: Solid, origin, direction, distance, normal):
    """Distance in units of the direction, outward normal; a ray beside it meets nothing."""
    hits = World([solid]).cast(origin, [direction, np.negative(direction)])
    assert hits.distance[0] == pytest.approx(distance, rel=1e-12)
    np.testing.assert_allclose(hits.normal[0], normal, atol=1e-12)
    assert hits.distance[1] == np.inf and hits.solid[1] == -1


def test_the_room_is_the_scanners_room():
    """Boxes by the tree of bounding boxes and box by box: the same distances and faces."""
    room = furnished_room()
    world = World([box(part.center, part.size, part.yaw) for part in room.boxes])
    ways = np.random.default_rng(1).normal(size=(4000, 3))
    ways /= np.linalg.norm(ways, axis=1)[:, None]
    distance, surface = room.cast((1.79, 3.3, 1.2), ways)
    hits = world.cast((1.79, 3.3, 1.2), ways)
    np.testing.assert_allclose(hits.distance, distance, rtol=1e-12)
    met = surface >= 0
    np.testing.assert_allclose(hits.normal[met], room.normals(surface[met]), atol=1e-12)


def test_a_solid_turned_and_moved_takes_its_hits_along():
    """The same ray, turned and moved with a slanted rod, is as long."""
    slanted = rod((1, 0.2, 0.1), (2, 0.9, 1.3), 0.2)
    before = World([slanted]).cast((0, 0, 0), [(1.5, 0.55, 0.7)])
    after = World([slanted.moved(3, -2, 0.5, yaw=90)]).cast((3, -2, 0.5), [(-0.55, 1.5, 0.7)])
    assert 0 < before.distance[0] < 1
    assert after.distance[0] == pytest.approx(before.distance[0], rel=1e-12)


def test_a_solid_without_extent_or_a_world_of_none_is_refused():
    """The messages say which number is wrong."""
    with pytest.raises(InputError, match="extents above 0"):
        box_between((0, 1), (0, 1), (2, 2))
    with pytest.raises(InputError, match="both ends at"):
        rod((1, 1, 1), (1, 1, 1), 0.1)
    with pytest.raises(InputError, match="at least one solid"):
        World([])
