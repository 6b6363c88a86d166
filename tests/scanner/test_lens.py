"""The lens: OpenCV's model, its exact inverse, and where it ends."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from depthwarp.errors import InputError
from depthwarp.scanner.geometry import Lens, reference_geometry
from depthwarp.scanner.lens import distort, distortion_jacobian, lens_radius, project, undistort

REFERENCE = reference_geometry().lens
CROOKED = replace(REFERENCE, distortion=(-0.2, 0.06, 2e-3, -1e-3, -0.004))


def whole_frame(lens: Lens) -> np.ndarray:
    width, height = lens.size
    u, v = np.meshgrid(np.linspace(-0.5, width - 0.5, 61), np.linspace(-0.5, height - 0.5, 81))
    return np.column_stack([u.ravel(), v.ravel()])


@pytest.mark.parametrize("lens", [REFERENCE, CROOKED])
def test_distort_is_opencvs_projection(lens: Lens):
    """The forward direction agrees with cv2.projectPoints to rounding."""
    rng = np.random.default_rng(1)
    points = np.column_stack([rng.uniform(-1, 1, (500, 2)), np.ones(500)]) * 3.0
    expected, _ = cv2.projectPoints(
        points, np.zeros(3), np.zeros(3), lens.K, np.array(lens.distortion)
    )
    np.testing.assert_allclose(project(lens, points), expected[:, 0], rtol=0, atol=1e-9)


@pytest.mark.parametrize("lens", [REFERENCE, CROOKED])
def test_every_pixel_of_the_frame_comes_back_within_a_billionth(lens: Lens):
    """Undistort and distort are inverse to 1e-9 px up to the corners of a 90 degree lens."""
    pixels = whole_frame(lens)
    back = distort(lens, undistort(lens, pixels))
    assert np.abs(back - pixels).max() <= 1e-9


def test_opencvs_default_would_be_off_by_pixels_at_the_corner():
    """The iteration criteria matter: five rounds leave more than a pixel."""
    corner = np.array([[[0.0, 0.0]]])
    criteria = (cv2.TERM_CRITERIA_COUNT, 5, 0.0)
    shim = getattr(cv2, "undistortPointsIter", None)
    coefficients = np.array(REFERENCE.distortion)
    if shim is None:
        coarse = cv2.undistortPoints(corner, REFERENCE.K, coefficients, criteria=criteria)
    else:
        coarse = shim(corner, REFERENCE.K, coefficients, np.eye(3), np.eye(3), criteria)
    assert np.abs(distort(REFERENCE, coarse[0]) - corner[0]).max() > 1.0


@given(st.floats(-0.3, 0.1), st.floats(0.0, 0.1), st.floats(-0.8, 0.8), st.floats(-0.8, 0.8))
def test_any_lens_gives_back_a_ray_inside_its_domain(k1: float, k2: float, x: float, y: float):
    """Where the forward direction answers, the inverse leads to the same ray."""
    lens = Lens(1000.0, 1000.0, 500.0, 400.0, (1000, 800), (k1, k2, 0.0, 0.0, 0.0))
    pixels = distort(lens, [[x, y]])
    if np.hypot(x, y) < 0.95 * lens_radius(lens):  # at the fold itself the inverse is ill-posed
        np.testing.assert_allclose(undistort(lens, pixels), [[x, y]], atol=1e-9)


def test_beyond_the_fold_there_is_no_answer():
    """Pixels and rays past the radius where the image folds back are NaN, the others are not."""
    folding = Lens(1000.0, 1000.0, 0.0, 0.0, (2000, 2000), (-0.25, 0.0, 0.0, 0.0, 0.0))
    radius = lens_radius(folding)
    assert radius == pytest.approx(np.sqrt(4 / 3))
    edge = 1000 * radius * (1 - 0.25 * radius**2)  # the farthest pixel that any ray reaches
    rays = undistort(folding, [[0.99 * edge, 0.0], [1.01 * edge, 0.0], [np.nan, 0.0]])
    assert np.isfinite(rays[:, 0]).tolist() == [True, False, False]
    pixels = distort(folding, [[0.99 * radius, 0.0], [1.01 * radius, 0.0]])
    assert np.isfinite(pixels[:, 0]).tolist() == [True, False]
    assert lens_radius(REFERENCE) == np.inf


def test_points_beside_or_behind_the_camera_are_not_seen():
    """Projection needs a depth above zero."""
    pixels = project(REFERENCE, [[0.1, 0.0, 1.0], [0.1, 0.0, 0.0], [0.1, 0.0, -1.0]])
    assert np.isfinite(pixels[:, 0]).tolist() == [True, False, False]


def test_jacobian_is_the_derivative_of_the_bending():
    """Analytic derivatives agree with central differences."""
    rays = np.random.default_rng(2).uniform(-0.8, 0.8, (20, 2))
    by_ray, by_coefficient = distortion_jacobian(CROOKED, rays)
    focal, step = (CROOKED.fx, CROOKED.fy), 1e-6
    for axis in range(2):
        shift = step * np.eye(2)[axis]
        slope = (distort(CROOKED, rays + shift) - distort(CROOKED, rays - shift)) / (2 * step)
        np.testing.assert_allclose(by_ray[:, :, axis], slope / focal, atol=1e-8)
    for index in range(5):
        shift = step * np.eye(5)[index]
        up, down = (
            replace(CROOKED, distortion=tuple(np.array(CROOKED.distortion) + sign * shift))
            for sign in (1, -1)
        )
        slope = (distort(up, rays) - distort(down, rays)) / (2 * step)
        np.testing.assert_allclose(by_coefficient[:, :, index], slope / focal, atol=1e-8)


def test_no_peaks_are_no_rays_and_wrong_shapes_are_refused():
    """An empty frame is no error; an array that is not (N, 2) is."""
    assert undistort(REFERENCE, np.empty((0, 2))).shape == (0, 2)
    assert distort(REFERENCE, np.empty((0, 2))).shape == (0, 2)
    with pytest.raises(InputError, match=r"pixels must have shape \(N, 2\), got \(3,\)"):
        undistort(REFERENCE, [1.0, 2.0, 3.0])
    with pytest.raises(InputError, match=r"points_optical must have shape \(N, 3\)"):
        project(REFERENCE, [[1.0, 2.0]])
