"""Poses: the rotation of equations (3) to (6), the two readings of P_C, OpenCV's matrices."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given

import depthwarp as dw
from depthwarp.cameras.pose import rotation_camera_from_world
from depthwarp.errors import InputError
from tests.reference import rotation
from tests.rendering.strategies import orientations, position_frames, positions, seeds

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1.5, -2, 0.25]], float)


# --- equations (3) to (6) ---


@given(orientation=orientations)
def test_rotation_is_that_of_the_printed_matrices(orientation):
    """R = Rx(alpha) Ry(beta) Rz(gamma), with the paper's passive matrices; a proper rotation."""
    pose = dw.Pose.from_orientation((0, 0, 0), orientation)
    np.testing.assert_allclose(
        pose.rotation, rotation.camera_from_world(orientation), rtol=0, atol=1e-15
    )
    np.testing.assert_array_equal(rotation_camera_from_world(orientation), pose.rotation)
    np.testing.assert_allclose(pose.rotation @ pose.rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(pose.rotation) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("orientation", "seen_ahead"),
    [
        ((0, 0, 0), (1, 0, 0)),
        ((0, 0, 90), (0, 1, 0)),  # yaw turns the view from +X to +Y
        ((0, 90, 0), (0, 0, -1)),  # pitch turns it down
        ((90, 0, 0), (1, 0, 0)),  # roll keeps the axis
        ((0, 90, 90), (0, 0, -1)),  # yaw first, then pitch
        ((45, 0, 180), (-1, 0, 0)),
    ],
)
def test_where_the_camera_looks(orientation, seen_ahead):
    """The world direction that ends up on the camera's X axis."""
    pose = dw.Pose.from_orientation((0, 0, 0), orientation)
    np.testing.assert_allclose(pose.rotation @ seen_ahead, (1, 0, 0), atol=1e-15)


def test_yaw_is_applied_first_then_pitch_then_roll():
    """The product of the three single rotations in that order, and in no other one."""
    turns = (10, 20, 30)
    roll, pitch, yaw = (
        dw.Pose.from_orientation((0, 0, 0), tuple(turns[i] if i == axis else 0 for i in range(3)))
        for axis in range(3)
    )
    together = dw.Pose.from_orientation((0, 0, 0), turns).rotation
    np.testing.assert_allclose(together, roll.rotation @ pitch.rotation @ yaw.rotation, atol=1e-15)
    assert np.abs(together - yaw.rotation @ pitch.rotation @ roll.rotation).max() > 0.05


# --- the two readings of P_C ---


@given(position=positions, orientation=orientations, frame=position_frames, seed=seeds)
def test_camera_points_are_the_references(position, orientation, frame, seed):
    """World: R (p - P_C). Rotated: R p - P_C."""
    pose = dw.Pose.from_orientation(position, orientation, frame)
    points = np.random.default_rng(seed).uniform(-10, 10, (20, 3))
    reading = {
        "world": rotation.to_camera_world_position,
        "rotated": rotation.to_camera_rotated_position,
    }[frame]
    expected = reading(points, rotation.camera_from_world(orientation), position, np.float64)
    np.testing.assert_allclose(pose.to_camera(points), np.stack(expected, axis=1), atol=1e-13)
    np.testing.assert_allclose(
        pose.to_camera(pose.center_world[None]), np.zeros((1, 3)), atol=1e-13
    )


def test_the_two_readings_by_hand():
    """Yaw 90: +Y of the world is ahead. P_C = (1, 2, 3) is subtracted before or after the turn."""
    point = np.array([[5.0, 7.0, 9.0]])
    world = dw.Pose.from_orientation((1, 2, 3), (0, 0, 90))
    rotated = dw.Pose.from_orientation((1, 2, 3), (0, 0, 90), "rotated")
    np.testing.assert_allclose(world.to_camera(point), [[5, -4, 6]], atol=1e-14)
    np.testing.assert_allclose(rotated.to_camera(point), [[6, -7, 6]], atol=1e-14)
    np.testing.assert_allclose(world.center_world, (1, 2, 3), atol=1e-15)
    np.testing.assert_allclose(rotated.center_world, (-2, 1, 3), atol=1e-15)


@given(position=positions)
def test_the_two_readings_agree_when_nothing_is_turned(position):
    """R = I: the same camera points, to the bit."""
    world = dw.Pose.from_orientation(position, (0, 0, 0))
    rotated = dw.Pose.from_orientation(position, (0, 0, 0), "rotated")
    np.testing.assert_array_equal(world.to_camera(CORNERS), rotated.to_camera(CORNERS))


# --- OpenCV's axes ---


@given(position=positions, orientation=orientations, frame=position_frames)
def test_optical_axes_are_opencvs(position, orientation, frame):
    """x = -Y, y = -Z, z = X of the camera frame, for any pose."""
    pose = dw.Pose.from_orientation(position, orientation, frame)
    homogeneous = np.column_stack([CORNERS, np.ones(len(CORNERS))])
    optical = (homogeneous @ pose.optical_from_world.T)[:, :3]
    X, Y, Z = pose.to_camera(CORNERS).T
    np.testing.assert_allclose(optical, np.stack([-Y, -Z, X], axis=1), atol=1e-13)
    np.testing.assert_array_equal(pose.optical_from_world[3], (0, 0, 0, 1))


@given(position=positions, orientation=orientations, frame=position_frames)
def test_a_pose_comes_back_from_its_optical_matrix(position, orientation, frame):
    """`Pose.from_optical(pose.optical_from_world)` sees every point where `pose` does."""
    pose = dw.Pose.from_orientation(position, orientation, frame)
    back = dw.Pose.from_optical(pose.optical_from_world)
    np.testing.assert_allclose(back.to_camera(CORNERS), pose.to_camera(CORNERS), atol=1e-13)
    np.testing.assert_allclose(back.optical_from_world, pose.optical_from_world, atol=1e-13)
    assert back.shift == (0, 0, 0)


def test_the_identity_looks_along_the_worlds_z():
    """An optical matrix of ones on the diagonal: Z ahead, -X left, -Y up."""
    pose = dw.Pose.from_optical(np.eye(4))
    np.testing.assert_array_equal(pose.rotation, [[0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    np.testing.assert_array_equal(pose.center_world, (0, 0, 0))


@given(position=positions, orientation=orientations)
def test_a_matrix_written_with_few_digits_moves_no_point(position, orientation):
    """A rotation rounded to 5 digits is taken as it is written, its translation with it."""
    far = tuple(1000 * coordinate for coordinate in position)
    matrix = dw.Pose.from_orientation(far, orientation).optical_from_world.round(5)
    np.testing.assert_allclose(
        dw.Pose.from_optical(matrix).optical_from_world, matrix, rtol=0, atol=1e-9
    )


# --- bad input ---


def test_a_matrix_that_is_no_rotation_is_refused_with_its_error():
    """The message says by how much R R^T differs from the identity, and the determinant."""
    matrix = np.eye(4)
    matrix[:3, :3] *= 1.1
    with pytest.raises(InputError, match=r"not a rotation.*by 0\.21.*determinant 1\.331"):
        dw.Pose.from_optical(matrix)
    matrix = np.eye(4)
    matrix[0, 1] = 0.01
    with pytest.raises(InputError, match=r"by 0\.01\b"):
        dw.Pose.from_optical(matrix)


def test_a_reflection_is_refused():
    """Orthogonal, but of determinant -1: a mirrored world, in these words."""
    with pytest.raises(InputError, match="not a rotation but a mirror image.*determinant -1") as e:
        dw.Pose.from_optical(np.diag([1.0, 1.0, -1.0, 1.0]))
    assert "differs" not in str(e.value)


@pytest.mark.parametrize(
    "matrix",
    [np.eye(3), np.eye(4)[:3], np.zeros((4, 4, 1)), np.full((4, 4), np.nan), np.diag([np.inf] * 4)],
    ids=["3 x 3", "3 x 4", "4 x 4 x 1", "NaN", "infinite"],
)
def test_a_matrix_of_another_shape_or_not_finite_is_refused(matrix):
    """Only a finite 4 x 4 matrix; the message tells the shape."""
    with pytest.raises(InputError, match="4 x 4"):
        dw.Pose.from_optical(matrix)


def test_a_matrix_for_row_vectors_is_refused():
    """The translation in the last row: the message says to transpose."""
    matrix = np.eye(4)
    matrix[3, :3] = (1, 2, 3)
    with pytest.raises(InputError, match="transposed"):
        dw.Pose.from_optical(matrix)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [
        (((0, 0), (0, 0, 0)), "position"),
        (((0, 0, math.nan), (0, 0, 0)), "position"),
        (((0, 0, 0), (0, math.inf, 0)), "orientation"),
        (((0, 0, 0), (0, 0)), "orientation"),
        (((0, 0, 0), (0, 0, 0), "camera"), "position_frame"),
    ],
)
def test_numbers_that_are_no_pose_are_refused(arguments, name):
    """The message begins with the argument's name."""
    with pytest.raises(InputError, match=f"^{name}"):
        dw.Pose.from_orientation(*arguments)


IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.eye(3) * 1.1, r"camera_from_world is not a rotation .* by 0\.21"),
        (((1, 0.2, 0), (0, 1, 0), (0, 0, 1)), r"differs from the identity by 0\.2\b"),
        (np.diag([1, -1, 1]), "mirror image"),
        (((1, 0, 0), (0, math.nan, 0), (0, 0, 1)), r"a row of camera_from_world.*0\.0, nan, 0\.0"),
        (np.eye(4), "3 x 3"),
        ("pose", "3 x 3"),
        (((1, 0), (0, 1), (0, 0)), "must be 3 finite numbers"),
    ],
    ids=["stretched", "sheared", "mirrored", "NaN", "4 x 4", "text", "3 x 2"],
)
def test_a_pose_is_checked_where_it_is_made(matrix, message):
    """The constructor takes a rotation and nothing else."""
    with pytest.raises(InputError, match=message):
        dw.Pose(matrix, (0, 0, 0))


@pytest.mark.parametrize("name", ["position", "shift"])
@pytest.mark.parametrize("value", [(0, 0), (0, 0, math.inf), "here", 3])
def test_places_are_checked_where_a_pose_is_made(name, value):
    """Three finite numbers each."""
    with pytest.raises(InputError, match=f"^{name} must be 3"):
        dw.Pose(IDENTITY, **{"position": (0, 0, 0), name: value})


def test_a_pose_of_arrays_is_one_of_numbers():
    """Arrays are taken as tuples of plain numbers: the pose can be compared and hashed."""
    pose = dw.Pose(np.eye(3, dtype=np.float32), np.array([1, 2, 3]))
    assert pose == dw.Pose(IDENTITY, (1.0, 2.0, 3.0)) and hash(pose)
    assert {type(value) for value in (*pose.position, *pose.camera_from_world[0])} == {float}


def test_products_of_rounded_rotations_are_poses():
    """Each of two matrices may be off by the rounding of a file: a rig's cameras are products."""
    rounded = dw.Pose.from_optical(np.diag([1 + 4e-5] * 3 + [1.0]))
    camera = dw.PinholeCamera.from_fov((60, 45), (4, 3)).with_pose(rounded)
    rig = dw.cameras.Rig.of({"a": camera}).with_pose(rounded).with_pose(rounded)
    assert rig["a"].pose.rotation.max() > 1 + 1e-4


CAMERAS = {
    "pinhole": lambda pose: dw.PinholeCamera(9.0, 9.0, 1.0, 1.0, 3, 3, pose),
    "fisheye": lambda pose: dw.FisheyeCamera(9.0, 9.0, 1.0, 1.0, 3, 3, pose),
    "double_sphere": lambda pose: dw.DoubleSphereCamera(9.0, 9.0, 1.0, 1.0, 0.1, 0.5, 3, 3, pose),
    "equirectangular": lambda pose: dw.EquirectangularCamera(8, 4, pose),
    "cylindrical": lambda pose: dw.CylindricalCamera(8, 4, pose),
    "orthographic": lambda pose: dw.OrthographicCamera(0.1, 3, 3, pose),
    "spinning": lambda pose: dw.SpinningLidar(8, (1.0, -1.0), pose),
}


@pytest.mark.parametrize("model", CAMERAS)
@pytest.mark.parametrize("pose", ["pose", (1, 2, 3), np.eye(4), None])
def test_a_camera_takes_nothing_but_a_pose(model, pose):
    """Of every model, made or moved: the message names what makes a pose."""
    with pytest.raises(InputError, match=r"^pose must be a Pose, got \w+: Pose\.from_orientation"):
        CAMERAS[model](pose)
    camera = CAMERAS[model](dw.Pose.from_orientation((0, 0, 0), (0, 0, 0)))
    with pytest.raises(InputError, match="Pose.from_optical"):
        camera.with_pose(pose)
    with pytest.raises(InputError, match="must be a Pose"):
        dw.cameras.Rig.of({"a": camera}).with_pose(pose)


def test_the_end_of_a_motion_is_a_pose():
    """Three numbers are none."""
    pose = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))
    with pytest.raises(InputError, match="^pose_end must be a Pose, got tuple"):
        dw.SpinningLidar(8, (1.0, -1.0), pose, pose_end=(1, 2, 3))


def test_messages_hold_plain_numbers():
    """Which entry is not finite, and no names of NumPy's types."""
    matrix = np.eye(4)
    matrix[3, 0] = 0.1
    with pytest.raises(InputError, match=r"got \(0\.1, 0\.0, 0\.0, 1\.0\)"):
        dw.Pose.from_optical(matrix)
    matrix = np.eye(4)
    matrix[1, 2] = np.nan
    with pytest.raises(InputError, match=r"finite 4 x 4 matrix, got nan at \[1, 2\]"):
        dw.Pose.from_optical(matrix)
    with pytest.raises(InputError, match="4 x 4 matrix, got 'matrix'"):
        dw.Pose.from_optical("matrix")
    with pytest.raises(InputError, match=r"K must be a finite 3 x 3 matrix, got inf at \[0, 2\]"):
        dw.PinholeCamera.from_matrix([[9, 0, np.inf], [0, 9, 1], [0, 0, 1]], (3, 3))
    with pytest.raises(InputError, match=r"tuple \(width, height\), got \(4\.5, 3\)"):
        dw.PinholeCamera.from_fov((60, 45), np.array([4.5, 3]).tolist()[:1] + [np.int64(3)])
