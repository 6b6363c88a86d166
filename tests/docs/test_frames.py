"""The sentences of `docs/conventions.md` under "Frames"."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import depthwarp as dw
from depthwarp.errors import InputError
from tests.docs.sentences import (
    ORIGIN,
    SQUARE,
    looking,
    pixel,
    says,
)


@says("The world frame is right-handed, with Z up.")
def test_world():
    """Above the camera is +Z; X forward, Y left and Z up are right-handed."""
    assert pixel(looking(0, 0, 0), (2, 0, 1))[1] < 5
    np.testing.assert_array_equal(np.cross((1, 0, 0), (0, 1, 0)), (0, 0, 1))
    assert np.linalg.det(ORIGIN.rotation) == 1


@says("The camera frame has X forward, Y to the left and Z up.")
def test_camera_frame():
    """Points ahead, left of and above the axis."""
    u, v = SQUARE.image_of(np.array([[2.0, 0, 0], [2, 1, 0], [2, 0, 1]]))
    assert (u.tolist(), v.tolist()) == ([5, 0, 5], [5, 5, 0])


@says("A camera with the orientation (0, 0, 0) looks along the world's X axis.")
def test_forward():
    """The axis is in the middle of the image."""
    assert pixel(looking(0, 0, 0), (3, 0, 0)) == (5, 5)


@says("A positive yaw turns the view to the left.")
def test_yaw():
    """After 90 degrees the world's Y axis is ahead."""
    assert pixel(looking(0, 0, 90), (0, 3, 0)) == pytest.approx((5, 5))


@says("A positive pitch turns the view down.")
def test_pitch():
    """After 90 degrees the camera looks at the floor."""
    assert pixel(looking(0, 90, 0), (0, 0, -3)) == pytest.approx((5, 5))


@says("A positive roll turns the picture anticlockwise.")
def test_roll():
    """After 90 degrees what was on the left is below."""
    u, v = pixel(looking(90, 0, 0), (3, 1, 0))
    assert u == pytest.approx(5) and v > 6


@says(
    "Orientations are (roll, pitch, yaw) in degrees, and the rotation from world to camera is "
    "Rx(roll) Ry(pitch) Rz(yaw), passive."
)
def test_orientation():
    """Against OpenCV's rotation vectors: passive turns are those of the negative vectors."""
    angles = np.radians((20.0, -35.0, 70.0))
    turns = [cv2.Rodrigues(-angle * axis)[0] for angle, axis in zip(angles, np.eye(3), strict=True)]
    pose = dw.Pose.from_orientation((0, 0, 0), np.degrees(angles))
    np.testing.assert_allclose(pose.rotation, turns[0] @ turns[1] @ turns[2], atol=1e-12)


@says("OpenCV's optical frame has X to the right, Y down and Z forward.")
def test_optical_frame():
    """The camera's forward, left and up in the optical frame."""
    forward, left, up = (ORIGIN.optical_from_world[:3, :3] @ axis for axis in np.eye(3))
    assert (forward.tolist(), left.tolist(), up.tolist()) == ([0, 0, 1], [-1, 0, 0], [0, -1, 0])


@says(
    "`optical_from_world` is a 4 x 4 matrix that takes world points, as column vectors, to the "
    "optical frame."
)
def test_optical_from_world():
    """It gives the point that K draws at the pixel."""
    camera = dw.PinholeCamera.from_fov((70, 50), (64, 48), (1, 2, 3), (5, 10, 20))
    point = (4.0, 3.0, 2.5)
    optical = camera.pose.optical_from_world @ (*point, 1)
    u, v, w = camera.K @ optical[:3]
    assert pixel(camera, point) == pytest.approx((u / w, v / w))


@says("OpenGL's camera frame is the optical frame turned by 180 degrees about X.")
def test_opengl():
    """X stays to the right, Y becomes up and Z becomes backwards."""
    turn = cv2.Rodrigues(np.array([np.pi, 0, 0]))[0]
    np.testing.assert_allclose(turn @ (1, 0, 0), (1, 0, 0), atol=1e-12)
    np.testing.assert_allclose(turn @ (0, -1, 0), (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(turn @ (0, 0, 1), (0, 0, -1), atol=1e-12)


@says("A matrix whose upper 3 x 3 is not a rotation is refused, and the message says by how much.")
def test_not_a_rotation():
    """A stretched axis, a mirrored one."""
    with pytest.raises(InputError, match=r"differs from the identity by 0\.21"):
        dw.Pose.from_optical(np.diag([1.1, 1, 1, 1]))
    with pytest.raises(InputError, match=r"determinant -1"):
        dw.Pose.from_optical(np.diag([-1, 1, 1, 1]))
