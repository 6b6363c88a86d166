"""The rendered laser line against its truth, and the truth against closed forms."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from depthwarp.scanner.geometry import ScannerGeometry, reference_geometry
from depthwarp.scanner.room import Box, Room, furnished_room
from depthwarp.scanner.twin import Laser, Scene, Shot, TwinRenderer, wall_scene
from tests.scanner.twin.lines import CLEAN, line_light, line_middle

HALF = reference_geometry(0.5)
TOE_IN = math.atan(0.85)
PAPER = (1.79, 3.3, 1.2)


def columns_on_wall(geometry: ScannerGeometry, distance: float) -> np.ndarray:
    """Column of the line in every row on a wall at a depth, by projecting its points densely."""
    lens = geometry.lens
    y = np.linspace(-1.4 * distance, 1.4 * distance, 60001)
    points = np.stack([np.full_like(y, 0.5 - 0.85 * distance), y, np.full_like(y, distance)], 1)
    pixels, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), lens.K, np.array(lens.distortion)
    )
    columns, rows = pixels.reshape(-1, 2).T
    return np.interp(np.arange(lens.size[1]), rows, columns, left=np.nan, right=np.nan)


@pytest.mark.parametrize("distance", [0.5, 1.0, 2.0, 5.0, 10.0])
def test_line_on_a_wall(device: str, distance: float) -> None:
    """On a wall the truth is the projection formula, and the rendered line lies on the truth."""
    renderer = TwinRenderer(wall_scene(distance), HALF, sensor=CLEAN, device=device)
    truth = renderer.truth(0.0)
    expected = columns_on_wall(HALF, distance)
    known = np.isfinite(truth.column)
    assert known.sum() > 1100
    np.testing.assert_allclose(truth.column[known], expected[known], atol=1e-4)
    np.testing.assert_allclose(truth.points_world[known, 0], distance, rtol=1e-9)
    middle = line_middle(line_light(renderer, 0.0, 30.0 * max(1.0, distance**2)))
    # The fan's ends cut the line inside a row.
    seen = np.flatnonzero(truth.visible)
    inner = seen[(seen > seen[0] + 3) & (seen < seen[-1] - 3)]
    assert np.abs(middle[inner] - truth.column[inner]).max() < 0.02


def test_far_points_are_not_visible() -> None:
    """Beyond the scanner's greatest range the line is known but does not count as visible."""
    truth = TwinRenderer(wall_scene(10.0), HALF).truth(0.0)
    known = np.isfinite(truth.column)
    np.testing.assert_array_equal(truth.visible, known & (truth.range <= HALF.max_range))
    assert (known & ~truth.visible).any()


def test_line_in_the_room(device: str) -> None:
    """Over furniture, light and truth agree: where, and in which rows there is a line at all."""
    scene = Scene(furnished_room())
    renderer = TwinRenderer(scene, HALF, PAPER, sensor=CLEAN, device=device)
    for angle in (0.0, 50.0, 100.0):
        truth = renderer.truth(angle)
        light = line_light(renderer, angle, 60.0)
        lit = light.sum(axis=1) > 0
        single = truth.visible & (truth.crossings == 1)
        assert single.sum() > 900
        assert (single & ~lit).sum() <= 2
        assert (lit & (truth.crossings == 0)).sum() <= 12  # ends cut inside a row
        error = np.abs(line_middle(light) - truth.column)[single & lit]
        assert np.median(error) < 0.005
        assert np.quantile(error, 0.95) < 0.02


def test_truth_lies_on_surface_plane_and_row() -> None:
    """Each true point lies on its surface and in the laser plane, and projects to its pixel."""
    scene = Scene(furnished_room())
    renderer = TwinRenderer(scene, HALF, PAPER)
    angle = 50.0
    truth = renderer.truth(angle)
    rows = np.flatnonzero(truth.visible)
    points = truth.points_world[rows]
    np.testing.assert_allclose(
        renderer.project(points, angle), np.stack([truth.column[rows], rows], 1), atol=1e-5
    )
    rays = points - np.array(PAPER)
    distance = np.linalg.norm(rays, axis=1)
    met, surface = scene.cast(np.array(PAPER), rays / distance[:, None])  # laser: head's origin
    np.testing.assert_allclose(met, distance, rtol=1e-6)
    assert (surface == truth.surface[rows]).mean() > 0.99  # but where surfaces touch
    # The fan's azimuth is the head's angle plus the toe-in, which leans to the camera's side.
    azimuth = np.degrees(np.arctan2(rays[:, 1], rays[:, 0]))
    np.testing.assert_allclose(azimuth, angle + math.degrees(TOE_IN), atol=1e-7)


def test_head_turns_counter_clockwise() -> None:
    """A wall to the left, seen after a turn by +90 degrees, is the wall ahead at 0 degrees."""
    ahead = TwinRenderer(wall_scene(2.0), HALF)
    wall = Box("wall", (0.0, 2.5, 0.0), (400.0, 1.0, 400.0), (255, 255, 255))
    left = TwinRenderer(Scene(Room((wall,))), HALF)
    np.testing.assert_allclose(ahead.truth(0.0).column, left.truth(90.0).column, atol=1e-7)


def test_light_falls_with_the_square_of_the_distance() -> None:
    """The light of a row falls with the square of a wall's distance."""
    geometry = replace(HALF, lens=replace(HALF.lens, distortion=(0.0,) * 5))
    total = {}
    for distance in (1.0, 2.0, 4.0):
        renderer = TwinRenderer(wall_scene(distance), geometry, sensor=CLEAN)
        total[distance] = line_light(renderer, 0.0, 50.0 * distance**2)[640].sum() / distance**2
    assert total[1.0] / total[2.0] == pytest.approx(2.0**2, rel=0.01)
    assert total[1.0] / total[4.0] == pytest.approx(4.0**2, rel=0.01)


def test_level_of_the_line() -> None:
    """At 1 m the peak is the laser's level times exposure, gain and the cosine of incidence."""
    wide = Laser(level=0.5, waist=0.02, divergence=0.0)
    scene = wall_scene(math.cos(TOE_IN))  # 1 m along the middle of the fan
    renderer = TwinRenderer(scene, HALF, laser=wide, sensor=CLEAN)
    peak = line_light(renderer, 0.0, 200.0)[647].max()
    assert peak == pytest.approx(0.5 * 200.0 * math.cos(TOE_IN), rel=0.005)
    with_gain, without = (
        renderer.render(Shot(0.0, True, 200.0, gain))[647].max() for gain in (6.0206, 0.0)
    )
    assert with_gain / without == pytest.approx(2.0, rel=0.001)


def test_width_of_the_line() -> None:
    """Along a row the line is as wide as blur and pixel together, also where it is slanted."""
    blurred = replace(CLEAN, blur=1.0)
    scene = Scene(furnished_room())
    renderer = TwinRenderer(scene, HALF, PAPER, laser=Laser(100.0, 1e-5, 0.0), sensor=blurred)
    truth, light = renderer.truth(130.0), line_light(renderer, 130.0, 30.0)
    for name, slanted in (("left wall", False), ("ceiling", True)):
        boxes = [i for i, box in enumerate(scene.room.boxes) if box.name == name]
        rows = np.flatnonzero(truth.visible & np.isin(truth.surface // 6, boxes))
        row = rows[len(rows) // 2]
        tilt = (truth.column[row + 1] - truth.column[row - 1]) / 2
        assert (abs(tilt) > 0.3) == slanted
        weights = light[row] / light[row].sum()
        variance = weights @ (np.arange(len(weights)) - truth.column[row]) ** 2
        assert variance == pytest.approx((1.0 + 1 / 12) * (1 + tilt**2), rel=0.02)


def test_saturated_line_has_a_white_core() -> None:
    """Far above full scale, crosstalk saturates red and blue too; the flanks stay green."""
    renderer = TwinRenderer(wall_scene(0.5), HALF, sensor=CLEAN)
    row = renderer.render(Shot(0.0, True, 3000.0))[640]
    column = round(float(renderer.truth(0.0).column[640]))
    assert (row[column] == 65535).all()
    green_only = (row[:, 1] == 65535) & (row[:, 0] < 40_000) & (row[:, 2] < 40_000)
    assert green_only[column - 15 : column].any() and green_only[column : column + 15].any()


def hidden_rows(obstacle: Box) -> tuple[np.ndarray, np.ndarray]:
    """Light and truth on a wall at 3 m with an obstacle before it, in the frame's middle rows."""
    room = Room((*wall_scene(3.0).room.boxes, obstacle))
    renderer = TwinRenderer(Scene(room), HALF, sensor=CLEAN)
    return line_light(renderer, 0.0, 100.0)[600:700], renderer.truth(0.0).surface[600:700]


def test_obstacle_before_the_laser() -> None:
    """Where the laser meets an obstacle, the wall behind gets no light."""
    obstacle = Box("post", (1.0, 0.85, 0.0), (0.1, 0.1, 1.0), (255, 255, 255))
    light, surface = hidden_rows(obstacle)
    assert (surface // 6 == 1).all()
    on_wall = columns_on_wall(HALF, 3.0)[600:700].round().astype(int)
    assert all(light[i, c - 3 : c + 4].sum() == 0 for i, c in enumerate(on_wall))
    assert (light.sum(axis=1) > 0).all()


def test_obstacle_before_the_camera() -> None:
    """Where an obstacle hides the line from the camera there is no light, and the truth says so."""
    obstacle = Box("post", (1.5, 1.6, 0.0), (0.1, 0.2, 1.0), (255, 255, 255))
    room = Room((*wall_scene(3.0).room.boxes, obstacle))
    renderer = TwinRenderer(Scene(room), HALF, sensor=CLEAN)
    light, truth = line_light(renderer, 0.0, 100.0), renderer.truth(0.0)
    hidden = slice(600, 700)
    assert (light[hidden] == 0).all()
    assert not truth.visible[hidden].any() and np.isfinite(truth.column[hidden]).all()
    assert truth.visible[100]


def test_fan_ends() -> None:
    """Beyond the fan's opening there is neither light nor truth."""
    renderer = TwinRenderer(wall_scene(2.0), HALF, laser=Laser(fan=40.0), sensor=CLEAN)
    truth, light = renderer.truth(0.0), line_light(renderer, 0.0, 100.0)
    rows = np.flatnonzero(np.isfinite(truth.column))
    assert (light[: rows[0] - 1] == 0).all() and (light[rows[-1] + 2 :] == 0).all()
    rise = truth.points_world[rows[0], 2] / np.linalg.norm(truth.points_world[rows[0], :2])
    assert math.degrees(math.atan(rise)) == pytest.approx(20.0, abs=0.1)
