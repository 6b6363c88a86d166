"""The fisheye: OpenCV's projection, angles beyond 90 degrees, and its domain."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings

import depthwarp as dw
from depthwarp.errors import InputError, LensDomainWarning
from tests.cameras.models import IDENTITY, quietly
from tests.cameras.test_brown import POINTS, kernel_error, points_in_view
from tests.rendering.strategies import seeds


def fisheye(rng: np.random.Generator) -> dw.FisheyeCamera:
    """A lens of a half field of view of 60 to 100 degrees across, 640 to 4000 px a side."""
    size = int(rng.integers(640, 4001)), int(rng.integers(640, 4001))
    f = 0.5 * size[0] / rng.uniform(1.05, 1.75)
    coefficients = tuple((rng.uniform(-1, 1, 4) * (0.05, 0.02, 0.005, 0.001)).tolist())
    pose = dw.Pose.from_orientation(rng.uniform(-2, 2, 3), rng.uniform(-180, 180, 3))
    center = (size[0] - 1) / 2 + rng.uniform(-20, 20), (size[1] - 1) / 2 + rng.uniform(-20, 20)
    focal = f, f * rng.uniform(0.95, 1.05)
    return quietly(dw.FisheyeCamera, *focal, *center, *size, pose, coefficients)


def opencv_image(camera: dw.FisheyeCamera, points_world: np.ndarray) -> np.ndarray:
    """cv2.fisheye.projectPoints in float64, of points turned into the optical frame first."""
    transform = camera.pose.optical_from_world
    optical = points_world.astype(np.float64) @ transform[:3, :3].T + transform[:3, 3]
    none = np.zeros(3)
    image, _ = cv2.fisheye.projectPoints(
        optical[:, None], none, none, camera.K, np.array(camera.distortion)
    )
    return image[:, 0].T


def formula_image(camera: dw.FisheyeCamera, points_world: np.ndarray) -> np.ndarray:
    """Kannala-Brandt by angles, in float64: OpenCV's own is for points ahead only."""
    x, y, z = camera.pose.to_camera(points_world).T
    theta, around = np.arctan2(np.hypot(y, z), x), np.arctan2(-z, -y)
    k1, k2, k3, k4 = camera.distortion
    bent = theta + k1 * theta**3 + k2 * theta**5 + k3 * theta**7 + k4 * theta**9
    return np.stack(
        [
            camera.cx + camera.fx * bent * np.cos(around),
            camera.cy + camera.fy * bent * np.sin(around),
        ]
    )


def ahead(camera: dw.Camera, points_world: np.ndarray) -> np.ndarray:
    """Whether points lie at least 1 degree ahead of the camera's plane."""
    x, y, z = camera.pose.to_camera(points_world).T
    return x > 0.02 * np.hypot(y, z)


@settings(max_examples=30)
@given(seed=seeds)
def test_projection_is_opencvs(seed):
    """`project` to 1e-9 of the image, of any calibration; behind, that of the angles."""
    rng = np.random.default_rng(seed)
    camera = fisheye(rng)
    points = points_in_view(camera, rng, 500)
    u, v, _, _ = camera.project(points)
    drawn = np.isfinite(u)
    assert drawn.mean() > 0.99
    uv = np.stack([u, v])
    np.testing.assert_allclose(
        uv[:, drawn], formula_image(camera, points)[:, drawn], rtol=1e-9, atol=1e-9
    )
    drawn &= ahead(camera, points)
    np.testing.assert_allclose(
        uv[:, drawn], opencv_image(camera, points)[:, drawn], rtol=1e-9, atol=1e-9
    )


def test_the_kernel_is_within_a_hundredth_of_a_pixel(device):
    """Random calibrations, 10^5 points each all over the image, also behind; printed."""
    rng = np.random.default_rng(1)
    for _ in range(5):
        camera = fisheye(rng)
        points = points_in_view(camera, rng, POINTS)
        x, y, z = camera.pose.to_camera(points).T
        points = points[np.arctan2(np.hypot(y, z), x) < camera.max_angle - 1e-5]
        exact = formula_image(camera, points)
        error = kernel_error(camera, points, exact, device)
        print(
            f"fisheye {camera.size}: {len(points)} points, {(x <= 0).mean():.0%} of them behind, "
            f"at most {error:.5f} px off"
        )
        assert error < 0.01
        some = ahead(camera, points)
        assert kernel_error(camera, points[some], opencv_image(camera, points[some]), device) < 0.01


def test_angles_up_to_straight_behind(device):
    """An equidistant lens of 360 degrees: every 10 degrees on a circle of its own; 180 on none."""
    f = 100 / np.pi
    camera = quietly(dw.FisheyeCamera, f, f, 100, 100, 201, 201, IDENTITY)
    assert camera.max_angle == np.pi
    angles = np.radians(np.arange(0, 180, 10))
    points = np.stack([np.cos(angles), -np.sin(angles), 0 * angles], axis=1) * 3
    points = np.concatenate([points, [[-3, 0, 0]]]).astype(np.float32)
    depth_map = dw.render(dw.PointCloud(points), camera, device=device)
    columns = np.floor(100 + np.arange(0, 180, 10) / 1.8 + 0.5).astype(int)
    np.testing.assert_array_equal(depth_map.index[100, columns], np.arange(18))
    assert (depth_map.stats.drawn, depth_map.stats.outside) == (18, 1)
    assert not camera.project(points)[3][-1]


def test_the_edge_of_the_domain_by_hand():
    """1 + 3 k1 theta^2 = 0; a lens that grows for ever ends at 180 degrees."""
    for k1, edge in [(-0.1, (1 / 0.3) ** 0.5), (-0.5, (1 / 1.5) ** 0.5), (0.1, np.pi), (0, np.pi)]:
        camera = quietly(dw.FisheyeCamera, 9, 9, 9, 9, 20, 20, IDENTITY, (k1, 0, 0, 0))
        assert camera.max_angle == pytest.approx(edge, rel=1e-12)


def test_nothing_folds_back(device):
    """Random lenses whose picture comes back at wide angles: winners are within the domain."""
    rng = np.random.default_rng(2)
    points = rng.uniform(-5, 5, (40_000, 3)).astype(np.float32)
    for _ in range(5):
        coefficients = (float(rng.uniform(-0.16, -0.09)), float(rng.uniform(-0.002, 0)), 0, 0)
        camera = quietly(dw.FisheyeCamera, 60, 60, 79.5, 59.5, 160, 120, IDENTITY, coefficients)
        u, v = formula_image(camera, points)
        theta = np.arctan2(np.hypot(points[:, 1], points[:, 2]), points[:, 0])
        came_back = (theta > camera.max_angle) & (abs(u - 79.5) < 79) & (abs(v - 59.5) < 59)
        assert came_back.sum() > 100
        depth_map = dw.render(dw.PointCloud(points), camera, device=device)
        winners = depth_map.index[depth_map.index >= 0]
        assert winners.size > 100
        assert (theta[winners] <= camera.max_angle + 1e-6).all()


@pytest.mark.parametrize(
    "coefficients", [(-0.1, 0, 0, 0), (-0.05, -0.02, 0.0, 0.0), (0.02, 0, 0, 0)]
)
def test_lost_pixels_warn_with_their_share(coefficients):
    """The share of pixels farther out than the greatest angle is drawn; of none no warning."""
    v, u = np.indices((480, 640))
    theta = np.linspace(0, np.pi, 100_001)
    bent = theta * (1 + coefficients[0] * theta**2 + coefficients[1] * theta**4)
    growing = np.diff(bent) > 0
    edge = bent[len(growing) if growing.all() else np.flatnonzero(~growing)[0]]
    lost = (np.hypot(u - 319.5, v - 239.5) > edge * 250).mean()
    arguments = (250, 250, 319.5, 239.5, 640, 480, IDENTITY, coefficients)
    if lost == 0:
        dw.FisheyeCamera(*arguments)  # warnings are errors
        return
    with pytest.warns(LensDomainWarning, match="folds back") as caught:
        camera = dw.FisheyeCamera(*arguments)
    assert camera.lost_share() == pytest.approx(lost, abs=0.02)
    assert caught[0].filename == __file__


def test_from_matrix_is_the_constructor():
    """K, size, coefficients and OpenCV's extrinsics; all but K and the size can be left out."""
    K = np.array([[300.0, 0, 320], [0, 310, 240], [0, 0, 1]])
    camera = dw.FisheyeCamera.from_matrix(K, (640, 480), (0.01, 0, 0, 0), np.eye(4))
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (300, 310, 320, 240)
    np.testing.assert_array_equal(camera.K, K)
    assert camera.distortion == (0.01, 0, 0, 0)
    assert dw.FisheyeCamera.from_matrix(K, (640, 480)).distortion == (0, 0, 0, 0)
    u, v, _, _ = camera.project(np.array([[0, 0, 2.0]]))
    assert (u[0], v[0]) == (320, 240)


@pytest.mark.parametrize("distortion", [(), (0.1,) * 3, (0.1,) * 5, (np.nan, 0, 0, 0)])
def test_coefficients_that_are_not_four_numbers_are_refused(distortion):
    """By name."""
    with pytest.raises(InputError, match="distortion"):
        dw.FisheyeCamera(9, 9, 9, 9, 20, 20, IDENTITY, distortion)


def test_a_circle_that_ends_in_the_image_is_no_fault():
    """An equidistant lens ends at 180 degrees: the warning says so and blames no coefficient."""
    with pytest.warns(LensDomainWarning, match="circle ends there, at 180 degrees") as caught:
        dw.FisheyeCamera(20.0, 20.0, 79.5, 79.5, 160, 160, IDENTITY)
    message = str(caught[0].message)
    assert "coefficients" not in message and "no ray reaches about 5" in message


def test_a_small_image_has_an_exact_share():
    """Up to the grid's size every pixel is looked at, and nothing is only about right."""
    with pytest.warns(LensDomainWarning) as caught:
        camera = dw.FisheyeCamera(5.0, 5.0, 19.5, 19.5, 40, 40, IDENTITY)
    rays = camera.directions(*np.meshgrid(np.arange(40), np.arange(40)))
    assert f"reaches {np.isnan(rays[..., 0]).mean():.1%} of" in str(caught[0].message)
