"""Ray casting against distances worked out by hand, and what stands where in the demo's room."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.room import RAYS_A_BLOCK, Box, Room, furnished_room

GREY = (128, 128, 128)
CUBE = Box("cube", (5.0, 0.0, 0.0), (2.0, 2.0, 2.0), GREY)


def random_directions(count: int, seed: int = 0) -> np.ndarray:
    vectors = np.random.default_rng(seed).standard_normal((count, 3))
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def distance_to_box_by_corners(box: Box, origin: np.ndarray, direction: np.ndarray) -> float:
    """Slow twin: meets the plane of each face and keeps the hits inside the face's rectangle."""
    cos, sin = math.cos(math.radians(box.yaw)), math.sin(math.radians(box.yaw))
    axes = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    nearest = math.inf
    for axis in range(3):
        for sign in (-1.0, 1.0):
            facing = float(axes[axis] @ direction) * sign
            if facing >= 0:  # an edge-on face or one seen from behind
                continue
            face = np.asarray(box.center) + sign * axes[axis] * box.size[axis] / 2
            distance = float(sign * axes[axis] @ (face - origin)) / facing
            offset = axes @ (origin + distance * direction - face)
            inside = all(abs(offset[k]) <= box.size[k] / 2 for k in range(3) if k != axis)
            if distance > 0 and inside:
                nearest = min(nearest, distance)
    return nearest


@pytest.mark.parametrize(
    ("direction", "face", "normal"),
    [
        ((1, 0, 0), 0, (-1, 0, 0)),
        ((-1, 0, 0), 1, (1, 0, 0)),
        ((0, 1, 0), 2, (0, -1, 0)),
        ((0, -1, 0), 3, (0, 1, 0)),
        ((0, 0, 1), 4, (0, 0, -1)),
        ((0, 0, -1), 5, (0, 0, 1)),
    ],
)
def test_a_ray_straight_at_each_face(direction, face, normal):
    room = Room((CUBE,))
    start = np.asarray(CUBE.center) - 4.0 * np.asarray(direction)
    distance, surface = room.cast(start, [direction])
    assert distance.tolist() == [3.0]
    assert surface.tolist() == [face]
    assert room.normals(surface).tolist() == [list(normal)]
    assert room.colors(surface).tolist() == [list(GREY)]


def test_an_oblique_ray_meets_the_top():
    room = Room((replace(CUBE, center=(0.0, 0.0, 0.0)),))
    distance, surface = room.cast((-2.0, 0.0, 3.0), [(0.6, 0.0, -0.8)])
    assert distance[0] == pytest.approx(2.5)  # 2 m down at a slope of 0.8, to x = -0.5
    assert surface[0] == 5
    assert room.normals(surface) @ [0.6, 0.0, -0.8] == pytest.approx([-0.8])


def test_a_turned_box_is_met_at_its_edge_and_beside_it():
    room = Room((replace(CUBE, yaw=45.0),))
    beside = 0.25
    distance, surface = room.cast([(0, beside, 0), (0, -beside, 0), (0, 1.5, 0)], [(1, 0, 0)] * 3)
    assert distance[:2] == pytest.approx(5 - math.sqrt(2) + beside)
    assert distance[2] == math.inf
    half = math.sqrt(0.5)
    np.testing.assert_allclose(
        room.normals(surface[:2]), [[-half, half, 0], [-half, -half, 0]], atol=1e-15
    )


def test_rays_that_miss_start_inside_or_look_away_meet_nothing():
    starts = [(0, 1.001, 0), CUBE.center, (7, 0, 0), (0, 3, 0)]
    distance, surface = Room((CUBE,)).cast(starts, [(1, 0, 0)] * 4)
    assert np.isinf(distance).all()
    assert (surface == -1).all()


def test_the_nearest_box_wins_whatever_the_order():
    behind = replace(CUBE, center=(9.0, 0.0, 0.0))
    for boxes in ((CUBE, behind), (behind, CUBE)):
        distance, surface = Room(boxes).cast((0, 0, 0), [(1, 0, 0)])
        assert distance[0] == 4.0
        assert boxes[surface[0] // 6] is CUBE


def test_a_ray_along_a_face_gives_a_number_not_nan():
    distance, _ = Room((CUBE,)).cast([(0, 1, 0), (0, -1, 0), (0, 1, 1)], [(1, 0, 0)] * 3)
    assert not np.isnan(distance).any()


def test_an_empty_room_and_no_rays():
    distance, surface = Room(()).cast((0, 0, 0), [(1, 0, 0)])
    assert (distance[0], surface[0]) == (math.inf, -1)
    assert Room((CUBE,)).cast((0, 0, 0), np.zeros((0, 3)))[0].shape == (0,)


def test_the_furnished_room_against_the_slow_twin():
    room, origin = furnished_room(), np.array([1.8, 5.15, 1.25])
    directions = random_directions(60)
    distance, surface = room.cast(origin, directions)
    for ray, direction in enumerate(directions):
        by_box = [distance_to_box_by_corners(box, origin, direction) for box in room.boxes]
        assert distance[ray] == pytest.approx(min(by_box), rel=1e-12)
        if surface[ray] >= 0:
            assert by_box[surface[ray] // 6] == pytest.approx(distance[ray], rel=1e-12)


def test_normals_face_the_ray():
    room, directions = furnished_room(), random_directions(2000)
    _, surface = room.cast((1.8, 5.15, 1.25), directions)
    hit = surface >= 0
    normals = room.normals(surface[hit])
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0)
    assert (np.einsum("ij,ij->i", normals, directions[hit]) < 0).all()


def test_blocks_do_not_show():
    room, directions = furnished_room(), random_directions(RAYS_A_BLOCK + 100)
    whole, _ = room.cast((1.8, 5.15, 1.25), directions)
    own_starts, _ = room.cast(np.tile([1.8, 5.15, 1.25], (len(directions), 1)), directions)
    tail, _ = room.cast((1.8, 5.15, 1.25), directions[-150:])
    np.testing.assert_array_equal(own_starts, whole)
    np.testing.assert_array_equal(tail, whole[-150:])


def test_placing_a_box_turns_it_with_its_position():
    placed = Box("leg", (1.0, 0.0, 0.5), (0.1, 0.2, 1.0), GREY, yaw=10.0).placed(2.0, 3.0, yaw=90.0)
    assert placed.center == pytest.approx((2.0, 4.0, 0.5))
    assert placed.yaw == 100.0
    assert placed.holds((2.0, 4.04, 0.9))
    assert not placed.holds((2.0, 4.06, 0.9))


@pytest.mark.parametrize(
    ("origins", "directions", "message"),
    [
        ((0, 0, 0), (1, 0, 0), "directions must have shape"),
        ((0, 0), [(1, 0, 0)], "origins must have shape"),
        ([(0, 0, 0)] * 2, [(1, 0, 0)] * 3, "origins must have shape"),
        ((0, 0, math.nan), [(1, 0, 0)], "finite"),
        ((0, 0, 0), [(1, 1, 0)], "unit"),
        ((0, 0, 0), [(math.nan, 0, 0)], "unit"),
    ],
)
def test_bad_rays_are_refused(origins, directions, message):
    with pytest.raises(InputError, match=message):
        Room((CUBE,)).cast(origins, directions)


@pytest.mark.parametrize(
    "change",
    [{"size": (1.0, 0.0, 1.0)}, {"size": (1.0, -1.0, 1.0)}, {"center": (math.nan, 0.0, 0.0)}],
)
def test_bad_boxes_are_refused(change):
    with pytest.raises(InputError, match="box 'cube'"):
        replace(CUBE, **change)


def test_the_furnished_room_has_the_papers_furniture_and_room_for_head_and_camera():
    room = furnished_room()
    names = [box.name for box in room.boxes]
    assert {"table", "door", "cupboard", "chair"} <= set(names)
    assert room.solid_at((1.79, 3.3, 1.2)) is None
    assert room.solid_at((1.8, 5.15, 1.25)) is None
    assert room.solid_at((1.85, 7.05, 0.73)) == "table"


def test_floor_ceiling_and_far_wall_seen_from_the_papers_camera_position():
    room, camera = furnished_room(), (1.79, 3.3, 1.2)
    directions = [(0, 0, -1), (0, 0, 1), (0, 1, 0)]
    distance, surface = room.cast(camera, directions)
    assert distance == pytest.approx([1.2, 1.6, 6.2555])
    assert [room.boxes[index // 6].name for index in surface] == ["floor", "ceiling", "far wall"]
