"""The lens references against OpenCV and NumPy in float64, by hand, and against themselves."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from . import lenses, projection, zbuffer
from .rotation import rotation_z

RNG = np.random.default_rng(0)
OPTICAL = RNG.uniform((-1, -1, 1.5), (1, 1, 3), (500, 3)).astype(np.float32)  # right, down, ahead
XYZ = OPTICAL[:, 2], -OPTICAL[:, 0], -OPTICAL[:, 1]
INTRINSICS = 500.0, 510.0, 320.0, 240.0
K = np.array([[500.0, 0, 320], [0, 510, 240], [0, 0, 1]])
COEFFICIENTS = -0.2, 0.05, 0.002, -0.001, 0.01, 0.1, 0.02, 0.003, 0.001, -0.002, 0.003, 0.001


def test_angles_are_those_of_numpy():
    """All round, to 2 units in the last place of pi; 0 where there is no direction."""
    turn = np.linspace(-np.pi, np.pi, 100_001)
    y, x = np.sin(turn).astype(np.float32), np.cos(turn).astype(np.float32)
    exact = np.arctan2(y.astype(np.float64), x.astype(np.float64))
    assert abs(lenses.angle_of(y, x) - exact).max() < 4.8e-7
    axes = lenses.angle_of(np.float32([0, 1, 0, -1, 0]), np.float32([1, 0, -1, 0, 0]))
    np.testing.assert_array_equal(axes, np.float32([0, np.pi / 2, np.pi, -np.pi / 2, 0]))


@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.03, -0.02)])
def test_planar_lenses_are_opencvs(tilt):
    """Brown with 5, rational with 12 coefficients, and with a tilted sensor."""
    onto = cv2_tilt(*tilt)
    u, v = lenses.project_rational(*XYZ, INTRINSICS, (*COEFFICIENTS, *tilt), onto, np.inf)
    exact, _ = cv2.projectPoints(
        OPTICAL.astype(np.float64), np.zeros(3), np.zeros(3), K, np.array([*COEFFICIENTS, *tilt])
    )
    np.testing.assert_allclose(np.stack([u, v], 1), exact[:, 0], atol=5e-4)
    u, v = lenses.project_brown(*XYZ, INTRINSICS, COEFFICIENTS[:5], np.inf)
    exact, _ = cv2.projectPoints(
        OPTICAL.astype(np.float64), np.zeros(3), np.zeros(3), K, np.array(COEFFICIENTS[:5])
    )
    np.testing.assert_allclose(np.stack([u, v], 1), exact[:, 0], atol=5e-4)


def cv2_tilt(tau_x: float, tau_y: float) -> np.ndarray:
    """OpenCV's tilt, as a homography fitted to where it draws points."""
    plane = np.array([[x, y, 1.0] for x in (-0.3, 0.1, 0.4) for y in (-0.2, 0.3, 0.5)])
    bent, _ = cv2.projectPoints(
        plane, np.zeros(3), np.zeros(3), np.eye(3), np.array([0.0] * 12 + [tau_x, tau_y])
    )
    onto, _ = cv2.findHomography(plane[:, :2], bent[:, 0])
    return onto


def test_fisheye_is_opencvs():
    """Kannala-Brandt ahead; beside and behind by hand: 3 pi / 4 radians from the centre."""
    coefficients = -0.02, 0.005, -0.001, 0.0002
    u, v = lenses.project_fisheye(*XYZ, INTRINSICS, coefficients, np.pi)
    exact, _ = cv2.fisheye.projectPoints(
        OPTICAL[:, None].astype(np.float64), np.zeros(3), np.zeros(3), K, np.array(coefficients)
    )
    np.testing.assert_allclose(np.stack([u, v], 1), exact[:, 0], atol=5e-4)
    behind = np.float32([[-1, 1, 0], [-1, 0, -1], [2, 0, 0], [-2, 0, 0]]).T
    u, v = lenses.project_fisheye(*behind, INTRINSICS, (0, 0, 0, 0), np.pi)
    far = 0.75 * np.pi
    np.testing.assert_allclose(u, [320 - 500 * far, 320, 320, np.nan], atol=2e-3)
    np.testing.assert_allclose(v, [240, 240 + 510 * far, 240, np.nan], atol=2e-3)


def test_a_double_sphere_without_displacements_is_a_pinhole():
    """xi = alpha = 0; with alpha = 1 / 2 and xi = 0 it is 2 tan(theta / 2), stereographic."""
    u, v = lenses.project_double_sphere(*XYZ, INTRINSICS, 0, 0, 0)
    expected = projection.project_pinhole(*XYZ, *INTRINSICS, np.float32)
    np.testing.assert_allclose((u, v), expected, atol=2e-4)
    u, v = lenses.project_double_sphere(*XYZ, INTRINSICS, 0, 0.5, -1)
    aside = np.hypot(XYZ[1], XYZ[2]).astype(np.float64)
    scale = 2 * np.tan(np.arctan2(aside, XYZ[0]) / 2) / aside
    np.testing.assert_allclose(u, 320 - 500 * XYZ[1] * scale, atol=5e-4)
    np.testing.assert_allclose(v, 240 - 510 * XYZ[2] * scale, atol=5e-4)


def test_panoramas_by_hand():
    """A full turn of 8 columns: ahead in the middle, left before it, behind at the seam."""
    X, Y, Z = np.float32([[1, 0, 0], [0, 2, 2], [0, -1, 0], [-1, 0, 0], [-1, -1e-3, 0]]).T
    numbers = 4 / np.pi, 4 / np.pi, 3.5, 1.5
    u, v = lenses.project_equirectangular(X, Y, Z, numbers, 8, (-np.inf, np.inf))
    np.testing.assert_allclose(u, [3.5, 1.5, 5.5, -0.5, 7.5 - 4e-3 / np.pi], atol=1e-5)
    np.testing.assert_allclose(v, [1.5, 0.5, 1.5, 1.5, 1.5], atol=1e-6)
    u, v = lenses.project_cylindrical(X, Y, Z, numbers, 8)
    np.testing.assert_allclose(v, 1.5 - np.array([0, 4 / np.pi, 0, 0, 0]), atol=1e-6)


def test_a_spinning_lidar_by_hand():
    """Beams at 10, 0, -10 degrees from rows 2, 0, 1, the middle one a column farther left."""
    limits = np.tan(np.radians([15, 5, -5, -15]))
    beams = limits, np.array([2, 0, 1]), np.array([0.0, -1.0, 0.0])
    slopes = np.tan(np.radians([20, 14, 1, -4, -6, -16]))
    X, Y, Z = np.float32([[1, 0, slope] for slope in slopes]).T
    u, v = lenses.project_spinning(X, Y, Z, (4 / np.pi, 3.0, 8), 0.0, beams)
    np.testing.assert_array_equal(v, [np.nan, 2, 0, 0, 1, np.nan])
    np.testing.assert_array_equal(u, [np.nan, 3, 2, 2, 3, np.nan])
    ranges = lenses.range_spinning(X, Y, Z, 0.5)
    np.testing.assert_allclose(ranges, np.hypot(0.5, slopes) + 0.5, rtol=1e-6)


def test_a_moving_sensor_that_stands_still():
    """Equal poses of all columns: the plain rotation; a way along X shortens the distance."""
    rotations = np.broadcast_to(rotation_z(30), (4, 3, 3))
    points = RNG.uniform(-5, 5, (50, 3)).astype(np.float32)

    def column_of(X, Y, Z):
        return lenses.azimuth_column(X, Y, 2 / np.pi, 1.5, 4)

    placed = lenses.to_camera_moving(points, rotations, np.zeros((4, 3)), column_of)
    np.testing.assert_allclose(np.stack(placed, 1), points @ rotation_z(30).T, atol=2e-6)
    centers = np.zeros((4, 3))
    centers[:, 0] = np.arange(4) * 0.1
    eye = np.broadcast_to(np.eye(3), (4, 3, 3))
    X, _, _ = lenses.to_camera_moving(np.float32([[5, 0, 0]]), eye, centers, column_of)
    np.testing.assert_allclose(X, 5 - 0.15, atol=1e-6)  # ahead is column 1.5


def test_the_sort_is_the_loop():
    """The same maps and counts as the loop over points, of a camera that sees only ahead."""
    points = RNG.uniform(-4, 4, (3000, 3)).astype(np.float32)
    points[::7] = points[5]
    points[::50, 1] = np.nan
    xyz = tuple(points.T)
    u, v = projection.project_pinhole(*xyz, 5, 5, 4, 3, np.float32)
    depths = zbuffer.depth_range(*xyz, np.float32)
    ours = lenses.render_sorted(
        xyz, u, v, depths, size=(9, 7), ahead_only=True, min_range=1, max_range=5
    )
    column, row = projection.pixel(u, v)
    options = {"width": 9, "height": 7, "depth_kind": "range", "min_range": 1, "max_range": 5}
    theirs = zbuffer.render_loop(*xyz, column, row, **options)
    np.testing.assert_array_equal(ours[0], theirs[0])
    np.testing.assert_array_equal(ours[1], theirs[1])
    assert ours[2] == theirs[2]
