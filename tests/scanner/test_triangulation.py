"""Triangulation: exact points without noise, honest counts, and a sigma that Monte Carlo meets."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.geometry import Lens, ScannerGeometry, TurningAxis, reference_geometry
from depthwarp.scanner.lens import project, undistort
from depthwarp.scanner.triangulation import triangulate
from depthwarp.scanner.uncertainty import (
    PARAMETERS,
    GeometryCovariance,
    range_gradient,
    tangents,
)

REFERENCE = reference_geometry()


def on_the_laser_plane(depth: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Points of the reference's laser plane at given Z and Y, optical frame."""
    normal, distance = REFERENCE.plane_normal, REFERENCE.plane_distance
    x = (distance - normal[2] * depth - normal[1] * height) / normal[0]
    return np.column_stack([x, height, depth])


def visible_points(count: int = 500, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    depth = rng.uniform(0.5, 9.0, count)
    return on_the_laser_plane(depth, depth * rng.uniform(-0.8, 0.8, count))


def perturbed(geometry: ScannerGeometry, error: np.ndarray) -> ScannerGeometry:
    """The geometry with an error in lens and plane, in the order of `PARAMETERS`."""
    lens = geometry.lens
    normal = np.array(geometry.plane_normal) + error[9:11] @ tangents(geometry.plane_normal)
    values = np.array([lens.fx, lens.fy, lens.cx, lens.cy, *lens.distortion]) + error[:9]
    return replace(
        geometry,
        lens=Lens(values[0], values[1], values[2], values[3], lens.size, tuple(values[4:])),
        plane_normal=tuple(normal / np.linalg.norm(normal)),
        plane_distance=geometry.plane_distance + error[11],
    )


def test_peaks_of_known_points_become_those_points_in_the_world():
    """Through lens, plane, head frame and motor angle back to where the point was."""
    points = visible_points()
    pixels = project(REFERENCE.lens, points)
    angles = np.random.default_rng(1).uniform(-400, 400, len(points))
    found = triangulate(REFERENCE, pixels[:, 1], pixels[:, 0], 0.1, angles)
    assert found.counts.kept == len(points)
    # By hand: the head's X is the viewing direction, Y points left, Z up, origin in the laser.
    forward, left, up = points[:, 2], 0.5 - points[:, 0], -points[:, 1]
    cos, sin = np.cos(np.radians(angles)), np.sin(np.radians(angles))
    expected = np.column_stack([cos * forward - sin * left, sin * forward + cos * left, up])
    np.testing.assert_allclose(found.points_world, expected, atol=1e-9)
    np.testing.assert_allclose(found.range_m, np.linalg.norm(points, axis=1), atol=1e-9)


def test_the_head_frame_of_a_tilted_axis_is_what_the_definition_says():
    """Z along the axis, origin nearest to the camera, X forward, and a right-handed rotation."""
    up = np.array([0.02, -0.99, 0.05])
    up /= np.linalg.norm(up)
    axis = TurningAxis(tuple(up), (0.4, 0.3, -0.1))
    matrix = replace(REFERENCE, axis=axis).head_from_optical
    rotation = matrix[:3, :3]
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(rotation) == pytest.approx(1.0)
    np.testing.assert_allclose(rotation @ up, [0, 0, 1], atol=1e-12)
    x, y, z = rotation @ [0, 0, 1]
    assert x > 0.99 and y == pytest.approx(0.0, abs=1e-12)
    # The camera's centre lies at height 0 of the head frame, and axis points on its Z.
    assert matrix[2, 3] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose((matrix @ [0.4, 0.3, -0.1, 1.0])[:2], 0.0, atol=1e-12)
    looking_along = replace(REFERENCE, axis=TurningAxis((0.0, 0.0, 1.0), (0.5, 0.0, 0.0)))
    with pytest.raises(InputError, match="viewing direction"):
        _ = looking_along.head_from_optical


def test_peaks_that_give_no_point_are_counted():
    """Each peak is kept or counted under the reason why it is not."""
    points = on_the_laser_plane(np.array([2.0, 14.0]), np.array([0.0, 0.0]))
    good, far = project(REFERENCE.lens, points)
    beyond_infinity = (20.0, 1294.5)
    peaks = np.array([good, far, beyond_infinity, (np.nan, 10.0)])
    near = replace(REFERENCE, max_range=10.0)
    found = triangulate(near, peaks[:, 1], peaks[:, 0], 0.1, 0.0)
    counts = found.counts
    assert (counts.kept, counts.too_far, counts.behind, counts.outside_lens) == (1, 1, 1, 1)
    assert counts.total == 4
    assert found.index.tolist() == [0]


def test_a_frame_without_peaks_is_an_empty_cloud():
    """No line in view is not an error."""
    found = triangulate(REFERENCE, [], [], 0.1, 30.0)
    assert found.counts.total == 0
    assert len(found.to_cloud()) == 0


def test_cloud_carries_sigma_range_row_and_angle():
    """The attributes of the cloud belong to their points."""
    pixels = project(REFERENCE.lens, visible_points(10))
    cloud = triangulate(REFERENCE, pixels[:, 1], pixels[:, 0], 0.1, 12.5).to_cloud()
    assert sorted(cloud.attributes) == ["angle", "range", "row", "sigma"]
    np.testing.assert_allclose(cloud.attributes["row"], pixels[:, 1], rtol=1e-6)
    assert (cloud.attributes["angle"] == np.float32(12.5)).all()


def test_sigma_of_the_pixel_alone_is_the_textbook_one_on_the_optical_axis_row():
    """Along z, 0.1 px at 15 m is 35 mm without distortion (sigma_z = z^2 sigma_u / (f b))."""
    plain = replace(REFERENCE, lens=replace(REFERENCE.lens, distortion=(0.0,) * 5), max_range=20)
    point = on_the_laser_plane(np.array([15.0]), np.array([0.0]))
    pixel = project(plain.lens, point)
    found = triangulate(plain, pixel[:, 1], pixel[:, 0], 0.1, 0.0)
    slant = found.range_m[0] / 15.0  # the range is longer than z, and so is its sigma
    sideways = point[0, 0] / 15.0
    expected = 15.0**2 * 0.1 / (plain.lens.fx * 0.5)
    # d r / d u' = -(z^2 / b) |x| + z u' / |x|; its second part is the textbook's omission.
    omitted = 15.0 * -sideways / slant * 0.1 / plain.lens.fx
    assert found.sigma_m[0] == pytest.approx(expected * slant + omitted, rel=1e-9)
    assert expected == pytest.approx(0.0347, abs=1e-4)


def test_gradient_is_the_derivative_of_the_range():
    """Each column agrees with triangulating through a slightly wrong geometry."""
    pixels = project(REFERENCE.lens, visible_points(50))
    geometry = replace(REFERENCE, max_range=100.0)
    points = triangulate(geometry, pixels[:, 1], pixels[:, 0], 0.0, 0.0)
    by_column, by_geometry = range_gradient(geometry, undistort(geometry.lens, pixels))

    def ranges(error: np.ndarray, shift: float = 0.0) -> np.ndarray:
        wrong = perturbed(geometry, error)
        return triangulate(wrong, pixels[:, 1], pixels[:, 0] + shift, 0.0, 0.0).range_m

    assert points.counts.kept == 50
    nothing = np.zeros(12)
    slope = (ranges(nothing, 1e-4) - ranges(nothing, -1e-4)) / 2e-4
    np.testing.assert_allclose(by_column, slope, rtol=1e-5)
    for index in range(12):
        error = 1e-6 * np.eye(12)[index]
        slope = (ranges(error) - ranges(-error)) / 2e-6
        np.testing.assert_allclose(by_geometry[:, index], slope, rtol=1e-4, atol=1e-6)


def test_sigma_is_what_monte_carlo_measures():
    """Random errors of the peak and of every parameter spread the range by the stated sigma."""
    sigmas = {
        "fx": 0.5, "cx": 0.2, "cy": 0.2, "k1": 1e-4, "k2": 1e-4, "p1": 1e-5,
        "plane_toe_in": 1e-4, "plane_roll": 1e-4, "plane_distance": 1e-4,
    }  # fmt: skip
    covariance = GeometryCovariance.from_sigmas(sigmas)
    geometry = replace(REFERENCE, max_range=100.0)
    points = on_the_laser_plane(np.array([1.0, 2.0, 5.0, 9.0]), np.array([0.5, -1.2, 3.0, 0.0]))
    pixels = project(geometry.lens, points)
    stated = triangulate(geometry, pixels[:, 1], pixels[:, 0], 0.1, 0.0, covariance).sigma_m
    rng = np.random.default_rng(3)
    spread = np.sqrt(np.diag(covariance.matrix))[:12]
    ranges = []
    for _ in range(1500):
        wrong = perturbed(geometry, rng.normal(0, 1, 12) * spread)
        noise = rng.normal(0, 0.1, len(pixels))
        ranges.append(triangulate(wrong, pixels[:, 1], pixels[:, 0] + noise, 0, 0).range_m)
    measured = np.std(ranges, axis=0)
    print("sigma [mm] stated", np.round(1e3 * stated, 2), "measured", np.round(1e3 * measured, 2))
    np.testing.assert_allclose(stated, measured, rtol=0.06)


def test_covariance_refuses_what_is_none():
    """Wrong names, shapes, asymmetric or negative matrices are named."""
    with pytest.raises(InputError, match="unknown geometry parameters focus"):
        GeometryCovariance.from_sigmas({"focus": 1.0})
    with pytest.raises(InputError, match="finite 16 x 16"):
        GeometryCovariance(np.eye(3))
    with pytest.raises(InputError, match="symmetric"):
        GeometryCovariance(-np.eye(len(PARAMETERS)))
    stated = GeometryCovariance.from_sigmas({"axis_roll": 0.25}).sigmas
    assert stated["axis_roll"] == 0.25 and math.fsum(stated.values()) == 0.25


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([[1.0]], [1.0], 0.1, 0.0), r"rows must have shape \(N,\)"),
        (([1.0], [1.0, 2.0], 0.1, 0.0), "columns must have the shape of rows"),
        (([1.0], [1.0], [0.1, 0.1], 0.0), "sigma_px must be a number"),
        (([1.0], [1.0], -0.1, 0.0), "sigma_px must be at least 0"),
        (([1.0], [1.0], 0.1, math.nan), "angle_deg must be finite"),
    ],
)
def test_arguments_that_do_not_fit_are_refused(arguments: tuple, message: str):
    """The message names the argument."""
    with pytest.raises(InputError, match=message):
        triangulate(REFERENCE, *arguments)
