"""The pinhole camera: its two constructors, its projection, what it refuses."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.errors import InputError
from tests.reference import projection, rotation
from tests.rendering.strategies import (
    fields_of_view,
    orientations,
    position_frames,
    positions,
    seeds,
)

K = [[500.0, 0.0, 320.0], [0.0, 510.0, 240.0], [0.0, 0.0, 1.0]]
SIZES = st.tuples(st.integers(1, 5000), st.integers(1, 5000))


def ahead(rng: np.random.Generator, pose: dw.Pose, count: int = 50) -> np.ndarray:
    """World points (float64) ahead of a pose, up to 75 degrees off its axis."""
    camera = rng.uniform((0.5, -1, -1), (10, 1, 1), (count, 3))
    camera[:, 1:] *= 3 * camera[:, :1]
    return (camera + np.array(pose.shift)) @ pose.rotation + np.array(pose.position)


# --- construction ---


@given(fov=st.tuples(fields_of_view, fields_of_view), size=SIZES)
def test_from_fov(fov, size):
    """fx = (W / 2) / tan(H_FOV / 2), cx = (W - 1) / 2, rows likewise."""
    camera = dw.PinholeCamera.from_fov(fov, size)
    assert camera.fx == pytest.approx(size[0] / 2 / math.tan(math.radians(fov[0]) / 2), rel=1e-15)
    assert camera.fy == pytest.approx(size[1] / 2 / math.tan(math.radians(fov[1]) / 2), rel=1e-15)
    assert (camera.cx, camera.cy) == ((size[0] - 1) / 2, (size[1] - 1) / 2)
    assert camera.size == size
    assert camera.K.tolist() == [
        [camera.fx, 0, camera.cx],
        [0, camera.fy, camera.cy],
        [0, 0, 1],
    ]


@given(fov=st.tuples(fields_of_view, fields_of_view), size=SIZES)
def test_the_field_of_view_ends_at_the_images_border(fov, size):
    """A ray at half the angle meets u = -0.5 (left) and W - 0.5 (right), v = -0.5 (up) likewise."""
    camera = dw.PinholeCamera.from_fov(fov, size)
    y, z = (math.tan(math.radians(angle) / 2) for angle in fov)
    u, v, _, _ = camera.project(np.array([[1, y, z], [1, -y, -z]]))
    np.testing.assert_allclose(u, (-0.5, size[0] - 0.5), rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(v, (-0.5, size[1] - 0.5), rtol=1e-12, atol=1e-9)


def test_from_matrix_without_extrinsics_stands_at_the_origin():
    """OpenCV's identity: it looks along the world's Z, X to the right, Y down."""
    camera = dw.PinholeCamera.from_matrix(K, (640, 480))
    np.testing.assert_array_equal(camera.K, K)
    u, v, depth, valid = camera.project(np.array([[0.1, 0.2, 2.0]]), depth="z")
    assert (u[0], v[0], depth[0], valid[0]) == (320 + 25, 240 + 51, 2, True)


@given(position=positions, orientation=orientations, seed=seeds)
def test_from_matrix_is_the_camera_it_was_taken_from(position, orientation, seed):
    """K and optical_from_world of a camera make the same camera again."""
    camera = dw.PinholeCamera.from_fov((70, 50), (64, 48), position, orientation)
    again = dw.PinholeCamera.from_matrix(
        camera.K, camera.size, optical_from_world=camera.pose.optical_from_world
    )
    points = ahead(np.random.default_rng(seed), camera.pose)
    for ours, theirs in zip(again.project(points), camera.project(points), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-9)
    assert again.size == camera.size


def test_whole_numbers_of_any_type_become_plain_ones():
    """NumPy's integers and 4.0 are sizes too; K is float64 whatever the camera was built from."""
    pose = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))
    for size in [(np.int64(4), np.uint16(3)), (4.0, 3.0), np.array([4, 3])]:
        for camera in (
            dw.PinholeCamera.from_fov((60, 45), size),
            dw.PinholeCamera.from_matrix(np.array(K, np.float32), size),
            dw.PinholeCamera(5, 5, 2, 1, size[0], size[1], pose),
        ):
            assert camera.size == (4, 3) and {type(side) for side in camera.size} == {int}
            assert camera.K.dtype == np.float64


def test_a_camera_is_a_value():
    """Equal cameras are equal and can be keys of a dictionary."""
    first, second = (dw.PinholeCamera.from_fov((60, 45), (8, 6), (1, 2, 3)) for _ in range(2))
    assert first == second and hash(first) == hash(second)
    assert first != dw.PinholeCamera.from_fov((60, 45), (8, 6), (1, 2, 4))


# --- projection ---


@given(
    position=positions,
    orientation=orientations,
    frame=position_frames,
    fov=st.tuples(st.floats(5, 150), st.floats(5, 150)),
    seed=seeds,
)
def test_projection_is_that_of_opencv(position, orientation, frame, fov, seed):
    """`cv2.projectPoints` with K and optical_from_world gives the same u and v, in double."""
    camera = dw.PinholeCamera.from_fov(fov, (640, 480), position, orientation, frame)
    points = ahead(np.random.default_rng(seed), camera.pose)
    u, v, _, _ = camera.project(points)
    transform = camera.pose.optical_from_world
    # OpenCV turns by a rotation vector, which is inexact; so the points are turned here.
    optical = points @ transform[:3, :3].T + transform[:3, 3]
    pixels, _ = cv2.projectPoints(optical, np.zeros(3), np.zeros(3), camera.K, None)
    np.testing.assert_allclose(np.stack([u, v], axis=1), pixels[:, 0], rtol=1e-9, atol=1e-9)


@given(position=positions, orientation=orientations, frame=position_frames, seed=seeds)
def test_projection_and_depths_are_the_references(position, orientation, frame, seed):
    """u, v, Euclidean range and z depth against the reference's rotation and pinhole."""
    camera = dw.PinholeCamera.from_fov((80, 60), (320, 200), position, orientation, frame)
    pose, points = camera.pose, ahead(np.random.default_rng(seed), camera.pose)
    X, Y, Z = rotation.to_camera(points, pose.rotation, pose.position, pose.shift, np.float64)
    expected = projection.project_pinhole(
        X, Y, Z, camera.fx, camera.fy, camera.cx, camera.cy, np.float64
    )
    u, v, distance, valid = camera.project(points)
    np.testing.assert_allclose((u, v), expected, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(distance, np.sqrt(X**2 + Y**2 + Z**2), rtol=1e-12)
    np.testing.assert_allclose(camera.project(points, depth="z")[2], X, rtol=1e-12)
    np.testing.assert_array_equal(valid, projection.inside(u, v, 320, 200))


def test_left_is_a_low_column_and_up_is_a_low_row():
    """Camera Y is left, Z is up; pixel (0, 0) is the upper left one."""
    camera = dw.PinholeCamera.from_fov((90, 90), (101, 101))
    u, v, _, _ = camera.project(np.array([[2.0, 1, 0], [2, -1, 0], [2, 0, 1], [2, 0, -1]]))
    np.testing.assert_allclose(u, (24.75, 75.25, 50, 50))
    np.testing.assert_allclose(v, (50, 50, 24.75, 75.25))


def test_valid_is_the_pixel_in_the_image_borders_included_on_one_side():
    """An image W wide spans u from -0.5 (in) to W - 0.5 (out), as floor(u + 0.5) tells."""
    pose = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))
    camera = dw.PinholeCamera(1.0, 1.0, 0.0, 0.0, 3, 4, pose)  # u = -Y / X, v = -Z / X
    one, zero = np.ones(6), np.zeros(6)
    u = np.array([-0.5, np.nextafter(-0.5, -1), 0, 2.5, np.nextafter(2.5, 0), 9])
    valid = camera.project(np.stack([one, -u, zero], axis=1))[3]
    assert valid.tolist() == [True, False, True, False, True, False]
    v = np.array([-0.5, np.nextafter(-0.5, -1), 0, 3.5, np.nextafter(3.5, 0), 9])
    valid = camera.project(np.stack([one, zero, -v], axis=1))[3]
    assert valid.tolist() == [True, False, True, False, True, False]


def test_points_without_a_picture_are_nan_and_not_valid():
    """Behind, beside, at the camera, not finite: NaN in u, v and depth, and no warning."""
    camera = dw.PinholeCamera.from_fov((90, 90), (10, 10), position=(1, 1, 1))
    points = np.array(
        [[0, 1, 1], [1, 1, 1], [1, 2, 1], [np.nan, 1, 1], [2, np.inf, 1], [np.inf, 1, 1], [2, 1, 1]]
    )
    for depth in ("range", "z"):
        u, v, distance, valid = camera.project(points, depth=depth)
        assert valid.tolist() == [False] * 6 + [True]
        for values in (u, v, distance):
            assert np.isnan(values[:6]).all() and np.isfinite(values[6])


def test_projection_of_no_points():
    """Empty in, empty out."""
    camera = dw.PinholeCamera.from_fov((90, 90), (10, 10))
    u, v, distance, valid = camera.project(np.empty((0, 3)))
    assert u.shape == v.shape == distance.shape == valid.shape == (0,)


def test_projection_computes_in_float64():
    """float32 points are widened first: a third has 16 digits, not 7."""
    camera = dw.PinholeCamera.from_fov((90, 90), (2, 2))
    u, _, _, _ = camera.project(np.array([[3, 1, 0]], np.float32))
    assert u.dtype == np.float64 and u[0] == pytest.approx(0.5 - 1 / 3, rel=1e-15)


# --- bad input ---


@pytest.mark.parametrize("angle", [0, -1, 180, 200, math.nan, math.inf])
@pytest.mark.parametrize("place", [0, 1])
def test_a_field_of_view_out_of_range_is_refused(angle, place):
    """Each angle is above 0 and below 180 degrees."""
    fov = [60.0, 60.0]
    fov[place] = angle
    with pytest.raises(InputError, match="^fov"):
        dw.PinholeCamera.from_fov(fov, (10, 10))


@pytest.mark.parametrize(
    "size",
    [
        (0, 10),
        (10, 0),
        (-1, 10),
        (10**9, 10),
        (10, 10**9),
        (10.5, 10),
        (math.nan, 10),
        (10, math.inf),
        ("ten", 10),
        (10, None),
        (10,),
        (10, 10, 3),
    ],
)
def test_a_size_out_of_range_is_refused(size):
    """Two whole numbers from 1 to about a million, from either constructor."""
    with pytest.raises(InputError, match="^size"):
        dw.PinholeCamera.from_fov((60, 45), size)
    with pytest.raises(InputError, match="^size"):
        dw.PinholeCamera.from_matrix(K, size)


@pytest.mark.parametrize(
    "matrix",
    [
        np.eye(4),
        np.eye(2),
        np.full((3, 3), np.nan),
        [[500, 1, 320], [0, 510, 240], [0, 0, 1]],
        [[500, 0, 320], [2, 510, 240], [0, 0, 1]],
        [[500, 0, 320], [0, 510, 240], [0, 0, 2]],
        [[500, 0, 320], [0, 510, 240], [320, 240, 1]],
    ],
    ids=["4 x 4", "2 x 2", "NaN", "skew", "skew below", "scaled", "transposed"],
)
def test_a_matrix_that_is_no_k_is_refused(matrix):
    """The message names K and what it has to look like."""
    with pytest.raises(InputError, match="^K must be"):
        dw.PinholeCamera.from_matrix(matrix, (640, 480))


@pytest.mark.parametrize("place", [(0, 0), (1, 1)])
@pytest.mark.parametrize("focal", [0.0, -500.0])
def test_a_focal_length_that_is_not_positive_is_refused(place, focal):
    """A camera that mirrors or sees nothing."""
    matrix = np.array(K)
    matrix[place] = focal
    with pytest.raises(InputError, match="^f[xy] must be"):
        dw.PinholeCamera.from_matrix(matrix, (640, 480))


def test_numbers_that_are_not_finite_are_refused():
    """The plain constructor checks as the named ones do."""
    pose = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))
    for name, values in {
        "fx": (math.nan, 1, 0, 0),
        "fy": (1, math.inf, 0, 0),
        "principal point": (1, 1, math.nan, 0),
    }.items():
        with pytest.raises(InputError, match=name):
            dw.PinholeCamera(*values, 4, 4, pose)


def test_zero_distortion_is_an_ideal_lens():
    """Coefficients of 0 change nothing: the camera is equal to one without."""
    ideal = dw.PinholeCamera.from_matrix(K, (640, 480), distortion=(0, 0, 0, 0, 0))
    assert ideal == dw.PinholeCamera.from_matrix(K, (640, 480))


def test_extrinsics_that_are_no_rotation_are_refused():
    """The check of `Pose.from_optical`."""
    with pytest.raises(InputError, match="not a rotation"):
        dw.PinholeCamera.from_matrix(K, (640, 480), optical_from_world=np.diag([2, 2, 2, 1]))


def test_an_unknown_depth_kind_is_refused():
    """Named by words; the message lists them."""
    camera = dw.PinholeCamera.from_fov((60, 45), (10, 10))
    with pytest.raises(InputError, match="'range', 'z'"):
        camera.project(np.ones((1, 3)), depth="euclidean")
