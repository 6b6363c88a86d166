"""What hypothesis draws: clouds with every kind of trouble in them, poses, views and cameras.

A cloud is made from one drawn seed, so an example costs little and still shrinks by its size.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from hypothesis import strategies as st

import depthwarp as dw

SPECIAL = np.array(
    [0.0, -0.0, np.nan, np.inf, -np.inf, 1e30, -1e30, 3e38, 1e-40, -1e-40, 1e-30, 1e-20],
    dtype=np.float32,
)

angles = st.one_of(
    st.sampled_from([0.0, 90.0, -90.0, 180.0, 20.0, 50.0]), st.floats(-720, 720, width=32)
)
orientations = st.one_of(st.just((0.0, 0.0, 0.0)), st.tuples(angles, angles, angles))
coordinates = st.one_of(st.just(0.0), st.floats(-3, 3, width=32))
positions = st.tuples(coordinates, coordinates, coordinates)
position_frames = st.sampled_from(["world", "rotated"])
fields_of_view = st.one_of(
    st.sampled_from([1.0, 60.0, 90.0, 120.0, 179.0]), st.floats(1, 179, width=32)
)
seeds = st.integers(0, 2**32 - 1)


def ahead_of(pose: dw.Pose, points_camera: np.ndarray) -> np.ndarray:
    """World points (float32) of camera points: on a pose that is not turned, the same numbers."""
    points = (points_camera + np.array(pose.shift)) @ pose.rotation + np.array(pose.position)
    return points.astype(np.float32)


@st.composite
def clouds(draw: st.DrawFn, pose: dw.Pose, min_size: int = 0, max_size: int = 200) -> np.ndarray:
    """Points (N, 3) float32, most of them ahead of a pose.

    Among them: exact duplicates, points of one range (ties), on the axis, at the camera, behind,
    and ones with coordinates that are not finite, huge or tiny. Shuffled.
    """
    rng = np.random.default_rng(draw(seeds))
    size = draw(st.integers(min_size, max_size))
    reach = draw(st.sampled_from([0.05, 1.0, 5.0, 20.0]))
    camera = rng.uniform(-reach, reach, (size, 3))
    ahead = rng.random(size) < 0.8
    camera[ahead, 0] = np.abs(camera[ahead, 0])
    mirrored = rng.random(size) < 0.2  # Y -> -Y and the like: another pixel or the same, one range
    camera[mirrored] = np.roll(camera, 1, axis=0)[mirrored] * rng.choice([-1, 1], 3)
    camera[rng.random(size) < 0.05, 1:] = 0.0
    camera[rng.random(size) < 0.03] = 0.0
    points = ahead_of(pose, camera)
    duplicated = rng.random(size) < draw(st.sampled_from([0.0, 0.3]))
    points[duplicated] = points[rng.integers(0, max(size, 1), duplicated.sum())]
    broken = rng.random((size, 3)) < draw(st.sampled_from([0.0, 0.05]))
    points[broken] = rng.choice(SPECIAL, broken.sum())
    return points


@st.composite
def range_views(draw: st.DrawFn, depth_plane: bool) -> dw.RangeView:
    """Range views of any pose, angle and step, up to about 2000 rectangles."""
    view = dw.RangeView(
        position=draw(positions),
        orientation=draw(orientations),
        fov=(draw(fields_of_view), draw(fields_of_view)),
        position_frame=draw(position_frames),
        depth_plane=draw(st.floats(0.01, 20)) if depth_plane else None,
    )
    reach = view.depth_plane or 20.0
    lines = draw(st.one_of(st.integers(1, 20), st.integers(1, 2000)))
    return dataclasses.replace(view, q_line=view.q_line * reach / lines / view.steps[0])


@st.composite
def cameras(draw: st.DrawFn, max_side: int = 24) -> dw.PinholeCamera:
    """Cameras by field of view; small images, so that many points meet in a pixel."""
    return dw.PinholeCamera.from_fov(
        fov=(draw(fields_of_view), draw(fields_of_view)),
        size=(draw(st.integers(1, max_side)), draw(st.integers(1, max_side))),
        position=draw(positions),
        orientation=draw(orientations),
        position_frame=draw(position_frames),
    )
