"""Rigs: cameras by name, moved together."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given

import depthwarp as dw
from depthwarp.cameras import Rig
from depthwarp.errors import InputError
from tests.rendering.strategies import orientations, position_frames, positions

LEFT = dw.PinholeCamera.from_fov((60, 45), (640, 480), (0.3, 0.1, 0), (0, 5, 20))
RIGHT = dw.FisheyeCamera(
    200, 201, 159, 119, 320, 240, dw.Pose.from_orientation((0.3, -0.1, 0), (90, 0, -20), "rotated")
)
LIDAR = dw.SpinningLidar(
    512,
    (10.0, 0.0, -10.0),
    dw.Pose.from_orientation((0, 0, 0.2), (0, 0, 5)),
    pose_end=dw.Pose.from_orientation((0.5, 0, 0.2), (0, 0, 9)),
)
POINTS = np.random.default_rng(1).uniform(-20, 20, (200, 3))


def test_a_rig_is_a_mapping_in_its_order():
    """Names, cameras, length, membership; equal rigs are equal and can be keys."""
    rig = Rig.of({"left": LEFT, "right": RIGHT})
    assert list(rig) == ["left", "right"] and len(rig) == 2
    assert rig["right"] is RIGHT and "left" in rig and "middle" not in rig
    assert dict(rig) == {"left": LEFT, "right": RIGHT}
    assert rig == Rig(("left", "right"), (LEFT, RIGHT)) and hash(rig) == hash(Rig.of(dict(rig)))
    assert rig != Rig.of({"right": RIGHT, "left": LEFT})
    assert rig.get("middle") is None
    with pytest.raises(KeyError, match="no camera 'middle' in the rig; it has left, right"):
        rig["middle"]


@pytest.mark.parametrize(
    ("names", "cameras", "message"),
    [
        ((), (), "at least one camera"),
        (("a", "b"), (LEFT,), "2 names and 1 cameras"),
        (("a", "b", "a"), (LEFT, RIGHT, LEFT), "'a' stands twice"),
        ((1,), (LEFT,), "must be text, got 1"),
        (("a",), (LEFT.pose,), "got Pose as 'a'"),
    ],
)
def test_what_is_no_rig_is_refused(names, cameras, message):
    """The message says what is wrong."""
    with pytest.raises(InputError, match=message):
        Rig(names, cameras)


@given(position=positions, orientation=orientations, frame=position_frames)
def test_a_moved_rig_sees_what_the_rig_saw_in_its_own_frame(position, orientation, frame):
    """World to rig by the given pose, rig to camera by the camera's own, for every model."""
    pose = dw.Pose.from_orientation(position, orientation, frame)
    rig = Rig.of({"left": LEFT, "right": RIGHT, "lidar": LIDAR})
    moved = rig.with_pose(pose)
    assert moved.names == rig.names
    for name in rig:
        expected = rig[name].to_camera(pose.to_camera(POINTS))
        np.testing.assert_allclose(moved[name].to_camera(POINTS), expected, rtol=0, atol=1e-9)


def test_the_pose_is_where_the_rigs_origin_stands_and_where_its_axes_point():
    """A rig turned to the left by 90 degrees at (10, 0, 2): a worked example."""
    rig = Rig.of({"ahead": dw.PinholeCamera.from_fov((60, 45), (64, 48), position=(1, 0.5, 0))})
    camera = rig.with_pose(dw.Pose.from_orientation((10, 0, 2), (0, 0, 90)))["ahead"]
    # 1 m ahead in the rig is now +Y, 0.5 m to its left is now -X.
    np.testing.assert_allclose(camera.pose.center_world, (9.5, 1, 2), rtol=0, atol=1e-14)
    u, v, depth, _ = camera.project(np.array([[9.5, 4, 2]]))
    np.testing.assert_allclose([u[0], v[0], depth[0]], (31.5, 23.5, 3), rtol=0, atol=1e-12)


def test_a_rounded_rotation_moves_no_camera():
    """A rotation with 5 digits, as of a file, far from the origin: the centre stays where it is."""
    transform = np.eye(4)
    transform[:3, :3] = np.round(LEFT.pose.rotation, 5)
    transform[:3, 3] = transform[:3, :3] @ (-1000, 2000, 50)
    pose = dw.Pose.from_optical(transform)
    moved = Rig.of({"right": RIGHT}).with_pose(pose)["right"]
    expected = RIGHT.pose.to_camera(pose.to_camera(POINTS))
    np.testing.assert_allclose(moved.pose.to_camera(POINTS), expected, rtol=0, atol=1e-9)
