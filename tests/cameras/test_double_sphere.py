"""The double sphere camera: the paper's projection, its exact inverse and domain."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.errors import InputError, LensDomainWarning
from tests.cameras.models import IDENTITY, cameras_of, quietly
from tests.cameras.test_brown import POINTS, kernel_error, points_in_view

LENSES = [(xi, alpha) for xi in (-0.6, -0.2, 0.0, 0.3, 0.7) for alpha in (0.0, 0.2, 0.5, 0.6, 0.9)]


def angle_image(xi: float, alpha: float, theta: np.ndarray) -> np.ndarray:
    """Distance from the principal point, in focal lengths: equations (40) to (42)."""
    x, y = np.cos(theta), np.sin(theta)
    second = np.sqrt(y * y + (xi + x) ** 2)
    with np.errstate(divide="ignore"):
        return y / (alpha * second + (1 - alpha) * (xi + x))


@pytest.mark.parametrize(("xi", "alpha"), LENSES)
def test_the_domain_ends_where_the_picture_does(xi, alpha):
    """The first angle at which the distance in the image stops to grow, or is infinite."""
    camera = quietly(dw.DoubleSphereCamera, 9, 9, 9, 9, xi, alpha, 20, 20, IDENTITY)
    theta = np.linspace(0, np.pi, 200_001)[:-1]
    distance = angle_image(xi, alpha, theta)
    stops = np.flatnonzero((np.diff(distance) <= 0) | (distance[1:] < 0))
    expected = theta[stops[0]] if stops.size else np.pi
    assert np.arccos(camera.least_cosine) == pytest.approx(expected, abs=1e-4)


def test_the_kernel_is_within_a_hundredth_of_a_pixel(device):
    """Random lenses of 640 to 4000 px, 10^5 points each all over the image; printed."""
    rng = np.random.default_rng(1)
    for _ in range(4):
        size = int(rng.integers(640, 4001)), int(rng.integers(640, 4001))
        xi, alpha = rng.uniform(-0.4, 0.4), rng.uniform(0.3, 0.75)
        f = 0.5 * size[0] / rng.uniform(0.6, 1.3)
        pose = dw.Pose.from_orientation(rng.uniform(-2, 2, 3), rng.uniform(-180, 180, 3))
        center = (size[0] - 1) / 2, (size[1] - 1) / 2
        camera = quietly(dw.DoubleSphereCamera, f, f, *center, xi, alpha, *size, pose)
        points = points_in_view(camera, rng, POINTS)
        x, y, z = pose.to_camera(points).T
        cosine = x / np.sqrt(x * x + y * y + z * z)
        inside = cosine > camera.least_cosine + 1e-5
        points, cosine = points[inside], cosine[inside]
        x, y, z = pose.to_camera(points).T
        scale = f * angle_image(xi, alpha, np.arccos(cosine)) / np.hypot(y, z)
        exact = np.stack([center[0] - y * scale, center[1] - z * scale])
        near_axis = np.hypot(y, z) < 1e-3  # there the arc cosine is not exact enough
        error = kernel_error(camera, points[~near_axis], exact[:, ~near_axis], device)
        print(
            f"double sphere {size}: {len(points)} points, {(x <= 0).mean():.0%} of them behind, "
            f"at most {error:.5f} px off"
        )
        assert error < 0.01


@settings(max_examples=40)
@given(camera=cameras_of("double_sphere"))
def test_directions_invert_the_projection(camera):
    """Every pixel that has a ray is where the ray is drawn."""
    v, u = np.indices((camera.height, camera.width), dtype=np.float64)
    rays = camera.directions(u, v)
    seen = np.isfinite(rays[..., 0])
    np.testing.assert_allclose(np.linalg.norm(rays[seen], axis=-1), 1, rtol=1e-12)
    again_u, again_v = camera.image_of(rays[seen])
    drawn = np.isfinite(again_u)
    assert drawn.sum() >= seen.sum() - 4
    np.testing.assert_allclose(again_u[drawn], u[seen][drawn], atol=1e-6)
    np.testing.assert_allclose(again_v[drawn], v[seen][drawn], atol=1e-6)


@pytest.mark.parametrize(("xi", "alpha"), [(-0.6, 0.1), (-0.3, 0.9), (0.4, 0.8), (0.2, 0.0)])
def test_nothing_folds_back(device, xi, alpha):
    """All drawn points lie within the greatest angle, and on the ray of their pixel."""
    camera = quietly(dw.DoubleSphereCamera, 70, 70, 79.5, 59.5, xi, alpha, 160, 120, IDENTITY)
    points = np.random.default_rng(3).uniform(-5, 5, (40_000, 3)).astype(np.float32)
    depth_map = dw.render(dw.PointCloud(points), camera, device=device)
    v, u = np.nonzero(depth_map.index >= 0)
    winners = points[depth_map.index[v, u]].astype(np.float64)
    along = winners / np.linalg.norm(winners, axis=1)[:, None]
    assert (along[:, 0] > camera.least_cosine - 1e-6).all()
    exact_u, exact_v = camera.image_of(winners)
    inside = np.isfinite(exact_u)
    assert inside.mean() > 0.99
    np.testing.assert_allclose(
        camera.directions(exact_u[inside], exact_v[inside]), along[inside], atol=1e-4
    )


def test_lost_pixels_warn_with_their_share():
    """Beyond r^2 = 1 / (2 alpha - 1) no ray is drawn."""
    v, u = np.indices((480, 640))
    lost = (np.hypot(u - 319.5, v - 239.5) > 250 / (2 * 0.8 - 1) ** 0.5).mean()
    assert 0.05 < lost < 0.5
    with pytest.warns(LensDomainWarning) as caught:
        camera = dw.DoubleSphereCamera(250, 250, 319.5, 239.5, 0.1, 0.8, 640, 480, IDENTITY)
    assert camera.lost_share() == pytest.approx(lost, abs=0.02)
    assert caught[0].filename == __file__
    dw.DoubleSphereCamera(450, 450, 319.5, 239.5, 0.1, 0.8, 640, 480, IDENTITY)  # no warning


@given(numbers=st.sampled_from([(1.0, 0.5), (-1.0, 0.5), (0.1, 1.0), (0.1, -0.1), (np.nan, 0.5)]))
def test_numbers_out_of_range_are_refused(numbers):
    """xi and alpha by name."""
    with pytest.raises(InputError, match="^(xi|alpha) must be"):
        dw.DoubleSphereCamera(9, 9, 9, 9, *numbers, 20, 20, IDENTITY)
