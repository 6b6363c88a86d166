"""The paper's loop Z-buffer as the twin of the kernels, and views to try both on."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from hypothesis import assume
from hypothesis import strategies as st

import depthwarp as dw
from tests.reference import projection, rotation, segmentation, zbuffer
from tests.rendering.strategies import (
    range_views,
)

KINDS = ["range", "z"]
FLOAT32_MAX = float(np.finfo(np.float32).max)
IDENTITY = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))


def camera_points(pose: dw.Pose, points: np.ndarray):
    """X, Y, Z in float32, as the kernel computes them."""
    return rotation.to_camera(points, pose.rotation, pose.position, pose.shift, np.float32)


def selected_by(view: dw.RangeView, line_count: int, xyz) -> np.ndarray:
    """The literal union (8)(9) in float32."""
    return segmentation.segment_union(
        *xyz, segmentation.rectangles(line_count, view.steps, np.float32)
    )


def twin(points: np.ndarray, camera: dw.PinholeCamera, selected=None, **options):
    """Depth, winner and counts of the loop, with the pinhole in float32."""
    xyz = camera_points(camera.pose, points)
    u, v = projection.project_pinhole(*xyz, camera.fx, camera.fy, camera.cx, camera.cy, np.float32)
    column, row = projection.pixel(u, v)
    options["max_range"] = min(options["max_range"], FLOAT32_MAX)  # no bound: still no infinities
    return zbuffer.render_loop(
        *xyz,
        column,
        row,
        width=camera.width,
        height=camera.height,
        selected=selected,
        **options,
    )


def assert_is_twin(depth_map: dw.DepthMap, expected) -> None:
    """The same bits of depth, the same winners, the same counts; a state that agrees with them."""
    depth, index, counts = expected
    np.testing.assert_array_equal(depth_map.depth.view(np.uint32), depth.view(np.uint32))
    np.testing.assert_array_equal(depth_map.index, index)
    assert dict(depth_map.stats) == counts
    assert_consistent(depth_map)


def assert_consistent(depth_map: dw.DepthMap) -> None:
    """What every map without filters obeys."""
    size = depth_map.camera.height, depth_map.camera.width
    assert depth_map.depth.shape == depth_map.index.shape == depth_map.state.shape == size
    assert depth_map.depth.dtype == np.float32
    assert depth_map.index.dtype == np.int32
    assert depth_map.state.dtype == np.uint8
    drawn = depth_map.state == dw.State.MEASURED
    np.testing.assert_array_equal(depth_map.depth > 0, drawn)
    np.testing.assert_array_equal(depth_map.index >= 0, drawn)
    np.testing.assert_array_equal(depth_map.index[~drawn], -1)
    assert (depth_map.state[~drawn] == dw.State.EMPTY).all()
    assert np.isfinite(depth_map.depth).all()
    assert len(np.unique(depth_map.index[drawn])) == drawn.sum() == depth_map.stats.drawn
    stats = dict(depth_map.stats)
    assert sum(stats.values()) == 2 * stats["total"] and min(stats.values()) >= 0


@st.composite
def bounds(draw: st.DrawFn, points: np.ndarray, pose: dw.Pose, kind: str) -> dict[str, float]:
    """Depth kind and range bounds; often the exact depth of a point, or the float beside it."""
    depths = zbuffer.DEPTH_KINDS[kind](*camera_points(pose, points), np.float32)
    depths = depths[np.isfinite(depths) & (depths > 0)].tolist()
    far = draw(st.sampled_from([15.0, math.inf, 0.1, *depths[:20]]))
    near = draw(st.sampled_from([0.0, 0.0, 0.1, *depths[-20:]]))
    if draw(st.booleans()):
        near = float(np.nextafter(np.float32(near), np.float32(1e9)))
    options = {"depth_kind": kind, "min_range": near, "max_range": far}
    assume(near < far)
    return options


def render(points: np.ndarray, camera, options: dict, device: str) -> dw.DepthMap:
    """`dw.render` with the options of the loop."""
    return dw.render(
        dw.PointCloud(points),
        camera,
        depth=options["depth_kind"],
        min_range=options["min_range"],
        max_range=options["max_range"],
        device=device,
    )


@st.composite
def small_range_views(draw: st.DrawFn, points_of) -> tuple[dw.RangeView, np.ndarray, int]:
    """A range view with a map of at most 24 pixels a side, a cloud, and the number N_L."""
    view = draw(range_views(depth_plane=True))
    points = draw(points_of(view.pose))
    if draw(st.booleans()):
        view = dataclasses.replace(view, depth_plane=None)
        farthest = segmentation.max_x_ahead(*camera_points(view.pose, points))
        assume(farthest > 0)
        line_count = segmentation.line_count(farthest, view.steps[0])
        assume(line_count < 4000)  # the loop over rectangles is slow
    else:
        line_count = segmentation.line_count(view.depth_plane, view.steps[0])
    _, half_width, half_height = segmentation.depth_plane(line_count, view.steps)
    side = draw(st.integers(1, 24))
    q_depth_map = 2 * max(half_width, half_height) / side
    return dataclasses.replace(view, q_depth_map=q_depth_map), points, line_count
