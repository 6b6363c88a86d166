"""Depth maps for the tests of filters."""

from __future__ import annotations

import numpy as np
import warp as wp
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.filters.maps import DeviceMaps, device_grids
from tests.reference.layers import Grid
from tests.rendering.strategies import seeds

MAPS = {"depth": wp.float32, "index": wp.int32, "state": wp.uint8}

SHAPES = st.one_of(
    st.sampled_from([(1, 1), (1, 19), (23, 1), (2, 2), (16, 33), (6, 70), (4, 107)]),
    st.tuples(st.integers(1, 22), st.integers(1, 26)),
)


def make_map(depth: np.ndarray, camera: dw.cameras.Camera | None = None, state=None) -> dw.DepthMap:
    """A depth map of an array: measured where above 0, with the pixels' numbers as winners."""
    depth = np.array(depth, np.float32)
    drawn = depth > 0
    if camera is None:
        camera = dw.PinholeCamera.from_fov((60, 45), depth.shape[::-1])
    if state is None:
        state = np.where(drawn, dw.State.MEASURED, dw.State.EMPTY)
    index = np.where(drawn, np.arange(depth.size).reshape(depth.shape), -1).astype(np.int32)
    count = int(drawn.sum())
    stats = dw.RenderStats(count, 0, 0, 0, 0, 0, 0, count)
    state = np.asarray(state, np.uint8)
    return dw.DepthMap(depth, index, state, camera, "range", 0.0, 15.0, stats)


def arrays_of(depth_map: dw.DepthMap):
    """The three maps, as the loops take and return them."""
    return depth_map.depth, depth_map.index, depth_map.state


def assert_maps(depth_map: dw.DepthMap, expected) -> None:
    """The same depth bits, winners and states."""
    for ours, theirs in zip(arrays_of(depth_map), expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def stacked(maps: list[dw.DepthMap], name: str) -> np.ndarray:
    """One of the three maps, of all views."""
    return np.stack([getattr(one, name) for one in maps])


def device_maps(maps: list[dw.DepthMap], device: str, threads: int | None = None) -> DeviceMaps:
    """A batch of maps on the device."""
    own = [wp.array(stacked(maps, name), dtype=kind, device=device) for name, kind in MAPS.items()]
    return DeviceMaps(*own, device_grids([one.camera for one in maps], device), threads=threads)


def grid_of(depth_map: dw.DepthMap) -> Grid:
    """What the loops know of the camera."""
    return Grid(*depth_map.camera.pixel_pitch, wraps=depth_map.camera.wraps)


def sparse(depth_map: dw.DepthMap, share: float) -> dw.DepthMap:
    """The map with so many of its pixels, drawn at random."""
    kept = np.random.default_rng(1).random(depth_map.depth.shape) < share
    return make_map(np.where(kept, depth_map.depth, 0), depth_map.camera)


@st.composite
def layered_maps(draw: st.DrawFn) -> dw.DepthMap:
    """Small maps of two slanted layers with gaps, noise, ties and erased pixels; any lens."""
    rows, columns = draw(SHAPES)
    rng = np.random.default_rng(draw(seeds))
    v, u = np.indices((rows, columns))
    tilt = rng.uniform(-0.1, 0.1, (2, 2))
    far, near = 6 + tilt[0, 0] * u + tilt[0, 1] * v, 3 + tilt[1, 0] * u + tilt[1, 1] * v
    depth = np.where(
        rng.random((rows, columns)) < draw(st.sampled_from([0.0, 0.5, 0.8])), near, far
    )
    depth += rng.normal(0, draw(st.sampled_from([0.0, 0.004, 0.3])), depth.shape)
    depth = np.maximum(depth, 0.1)
    if draw(st.booleans()):
        depth = np.round(depth)  # ties
    kept = rng.random(depth.shape) < draw(st.sampled_from([0.0, 0.05, 0.3, 0.8, 1.0]))
    depth = np.where(kept & (depth > 0), depth, 0).astype(np.float32)
    state = np.where(depth > 0, dw.State.MEASURED, dw.State.EMPTY)
    state[(rng.random(depth.shape) < 0.03) & (depth > 0)] = dw.State.ERASED  # with its depth kept
    return make_map(depth, draw(cameras(columns, rows)), state)


def cameras(width: int, height: int) -> st.SearchStrategy[dw.cameras.Camera]:
    """Lenses of every kind of pixel spacing, with and without a full turn."""
    pose = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))
    made = [
        dw.PinholeCamera.from_fov((20, 15), (width, height)),
        dw.PinholeCamera.from_fov((60, 45), (width, height)),
        dw.OrthographicCamera(0.01, width, height, pose),
        dw.EquirectangularCamera(width, height, pose),
        dw.EquirectangularCamera(width, height, pose, azimuths=90.0),
    ]
    return st.sampled_from(made)
