"""Depth and image position of winners on Warp's tape, against differences of NumPy formulas."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pytest
import warp as wp

import depthwarp as dw
from depthwarp.errors import InputError
from depthwarp.sim.winners import launch_winner_depth

from .winner_scenes import (
    COLUMNS,
    ROWS,
    STATIC,
    Scene,
    expected,
    expected_gradients,
    make_index,
    make_scene,
    seeds_of,
)

SINGLE = (wp.float32, wp.vec2f, wp.vec3f, wp.vec4f, wp.mat44f)
DOUBLE = (wp.float64, wp.vec2d, wp.vec3d, wp.vec4d, wp.mat44d)


class Arrays(NamedTuple):
    """A scene on a device, by the names of the launch's arguments."""

    points: Any
    poses: Any
    index: Any
    depth_out: Any
    intrinsics: Any
    uv_out: Any
    static_map: Any

    def launch(self, **options: Any) -> None:
        launch_winner_depth(**self._asdict(), **options)


def upload(scene: Scene, index: Any, device: str, types: Any = DOUBLE) -> Arrays:
    scalar, vec2, vec3, vec4, mat44 = types

    def array(values: Any, dtype: Any) -> Any:
        return wp.array(values, dtype=dtype, device=device, requires_grad=True)

    return Arrays(
        array(scene.points, vec3),
        array(scene.poses, mat44),
        wp.array(index, dtype=wp.int32, device=device),
        array(np.full(index.shape, 7.0), scalar),
        array(scene.intrinsics, vec4),
        array(np.full((*index.shape, 2), 7.0), vec2),
        array(scene.static_map, vec3),
    )


def backward(arrays: Arrays, kind: str, by_depth: Any, by_uv: Any) -> Scene:
    """Gradients of the weighted sum by the scene."""
    tape = wp.Tape()
    with tape:
        arrays.launch(depth=kind)
    seeds = {
        out: wp.array(values, dtype=out.dtype, device=out.device)
        for out, values in ((arrays.depth_out, by_depth), (arrays.uv_out, by_uv))
    }
    tape.backward(grads=seeds)
    found = (arrays.points, arrays.static_map, arrays.poses, arrays.intrinsics)
    return Scene(*(array.grad.numpy() for array in found))


@pytest.mark.parametrize("kind", ["range", "z"])
@pytest.mark.parametrize(("types", "tolerance"), [(SINGLE, 2e-6), (DOUBLE, 1e-14)])
def test_values_are_those_of_the_formulas(kind, types, tolerance, device):
    """Depth and position of every winner; 0 where there is none; both precisions."""
    scene, index = make_scene(), make_index()
    arrays = upload(scene, index, device, types)
    arrays.launch(depth=kind)
    depth, uv = expected(scene, index, kind)
    np.testing.assert_allclose(arrays.depth_out.numpy(), depth, rtol=tolerance)
    np.testing.assert_allclose(arrays.uv_out.numpy(), uv, rtol=tolerance, atol=20 * tolerance)
    assert not arrays.depth_out.numpy()[index < 0].any()


@pytest.mark.parametrize("kind", ["range", "z"])
@pytest.mark.parametrize(("types", "tolerance"), [(SINGLE, 2e-5), (DOUBLE, 1e-8)])
def test_gradients_are_those_of_the_formulas(kind, types, tolerance, device):
    """By points, static points (summed over the worlds), all numbers of poses, and intrinsics."""
    scene, index = make_scene(), make_index()
    found = backward(upload(scene, index, device, types), kind, *seeds_of(index))
    wanted = expected_gradients(kind)
    for name in Scene._fields:
        largest = np.abs(getattr(wanted, name)).max()
        np.testing.assert_allclose(
            getattr(found, name), getattr(wanted, name), atol=tolerance * largest, err_msg=name
        )


def test_depth_does_not_depend_on_the_lens(device):
    """The gradient of depth by the intrinsics is exactly zero, that of the position is not."""
    scene, index = make_scene(), make_index()
    by_depth, by_uv = seeds_of(index)
    arrays = upload(scene, index, device)
    assert not backward(arrays, "range", by_depth, 0 * by_uv).intrinsics.any()
    assert backward(arrays, "range", 0 * by_depth, by_uv).intrinsics.all()


def test_pixels_without_a_winner_have_no_gradient(device):
    """Indices below 0 and beyond the points, in an image where the pose is not a number."""
    scene, index = make_scene(), make_index()
    index[:] = -1
    index[0, 0, 0, 0], index[1, 1, 2, 1] = 1000, -7
    scene.poses[:] = np.nan
    arrays = upload(scene, index, device)
    gradients = backward(arrays, "range", *seeds_of(index))
    assert not any(values.any() for values in gradients)
    assert not arrays.depth_out.numpy().any() and not arrays.uv_out.numpy().any()


def test_a_winner_that_is_not_ahead_has_a_depth_but_no_position(device):
    """After a move of the pose: (0, 0), and gradients that are finite, at the camera itself too."""
    scene, index = make_scene(), np.full((2, 2, 1, 2), STATIC, np.int32)
    index[..., 1] += 1
    scene.poses[:] = np.eye(4)
    scene.points[:, :2] = (0.0, 0.0, 0.0), (3.0, 4.0, 0.0)
    arrays = upload(scene, index, device)
    gradients = backward(arrays, "range", np.ones(index.shape), np.ones((*index.shape, 2)))
    assert arrays.depth_out.numpy()[0, 0].tolist() == [[0.0, 5.0]]
    assert not arrays.uv_out.numpy().any()
    np.testing.assert_allclose(gradients.points[0, :2], [[0, 0, 0], [1.2, 1.6, 0]])


def drawn(sensor: Any, points: Any, poses: Any, device: str) -> tuple[Any, Any]:
    maps = sensor.step(
        wp.array(points, dtype=wp.vec3f, device=device),
        wp.array(poses, dtype=wp.mat44f, device=device),
    )
    return maps["depth"].numpy().copy(), maps["index"].numpy().copy()


def sensor_scene(device: str) -> tuple[Any, Any, Any, Any, Any]:
    """A sensor of two worlds with a static map, its lens, points and poses in float32."""
    rng = np.random.default_rng(3)
    lens = dw.PinholeCamera.from_fov((70, 60), (24, 20))
    static = rng.uniform(-3, 3, (200, 3)).astype(np.float32) + np.float32([0, 0, 6])
    points = rng.uniform(-3, 3, (2, 100, 3)).astype(np.float32) + np.float32([0, 0, 6])
    sensor = dw.sim.DepthSensor(
        2, 2, None, lens, 100, device, ("depth", "index"), static_map=dw.PointCloud(static)
    )
    return sensor, lens, static, points, make_scene().poses.astype(np.float32)


def test_winners_are_those_of_the_sensor(device):
    """A step's own depth but for rounding, and positions inside the pixels that were won."""
    sensor, lens, static, points, poses = sensor_scene(device)
    depth, index = drawn(sensor, points, poses, device)
    intrinsics = np.tile([lens.fx, lens.fy, lens.cx, lens.cy], (2, 2, 1))
    arrays = upload(Scene(points, static, poses, intrinsics), index, device, SINGLE)
    arrays.launch()
    np.testing.assert_allclose(arrays.depth_out.numpy(), depth, rtol=1e-6)
    won = np.argwhere(index >= 0)
    assert len(won) > 300
    off = arrays.uv_out.numpy()[index >= 0] - won[:, [3, 2]]
    assert np.abs(off).max() < 0.5 + 1e-4


def test_the_sensor_follows_the_gradient(device):
    """Where winners stay, the depth of a second step differs as the pose's gradient says."""
    sensor, _, static, points, poses = sensor_scene(device)
    depth, index = drawn(sensor, points, poses, device)
    moved = dw.sim.se3.se3_exp(np.array([3e-3, 2e-3, 4e-3, 1e-3, 2e-3, 0.0])) @ poses
    moved = moved.astype(np.float32)
    later, later_index = drawn(sensor, points, moved, device)
    stays = (index == later_index) & (index >= 0)
    assert stays.sum() > 200
    scene = Scene(points, static, 0.5 * (poses + moved), np.ones((2, 2, 4)))
    arrays = upload(scene, index, device)
    gradient = backward(arrays, "range", stays * 1.0, np.zeros((*index.shape, 2))).poses
    change = (later.astype(np.float64) - depth)[stays].sum()
    assert abs(change) > 0.3
    assert change == pytest.approx((gradient * (moved - poses.astype(np.float64))).sum(), rel=1e-3)


def test_a_captured_launch_equals_an_eager_one(device):
    """Replayed after the points have moved, bit for bit; without lens and static map too."""
    scene, index = make_scene(), make_index() - STATIC
    arrays = upload(scene, index, device, SINGLE)._replace(
        intrinsics=None, uv_out=None, static_map=None
    )
    arrays.launch()
    with wp.ScopedCapture(device=device) as capture:
        arrays.launch()
    arrays.points.assign(scene.points + 1)
    wp.capture_launch(capture.graph)
    replayed = arrays.depth_out.numpy().copy()
    arrays.depth_out.fill_(-1.0)
    arrays.launch()
    np.testing.assert_array_equal(arrays.depth_out.numpy(), replayed)
    assert (replayed > 0).any()


def fresh(dtype: Any, *shape: int) -> Any:
    return wp.zeros(shape, dtype=dtype, device="cpu")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("points", np.zeros((2, 6, 3)), "points must be a wp.array, got ndarray"),
        ("points", fresh(wp.float32, 2, 6, 3), "points must be a contiguous wp.array of vec3f"),
        ("poses", fresh(wp.mat44f, 2, 2), "poses must be a contiguous wp.array of mat44d"),
        ("poses", fresh(wp.mat44d, 3, 2), r"\(W, C, 4, 4\) with W = 2, got \(3, 2, 4, 4\)"),
        ("poses", fresh(wp.mat44d, 4, 2)[::2], "contiguous"),
        ("index", fresh(wp.int64, 2, 2, ROWS, COLUMNS), "index must be .* int32"),
        ("index", fresh(wp.int32, 2, ROWS, COLUMNS), r"index must have .* W = 2, C = 2, got"),
        ("depth_out", fresh(wp.float64, 2, 2, ROWS, 3), "depth_out must have the shape"),
        ("intrinsics", fresh(wp.vec4d, 1, 4), "intrinsics must have the shape"),
        ("intrinsics", None, "intrinsics and uv_out belong together"),
        ("uv_out", fresh(wp.float64, 2, 2, ROWS, COLUMNS), "uv_out must be .* vec2d"),
        ("static_map", fresh(wp.vec3d, 1, STATIC), r"static_map must have the shape \(S, 3\)"),
        ("static_map", fresh(wp.vec3f, STATIC), "static_map must be .* vec3d"),
    ],
)
def test_bad_arrays_are_refused(name, value, message):
    """The message names the argument and says what it must be."""
    arrays = upload(make_scene(), make_index(), "cpu")
    with pytest.raises(InputError, match=message):
        arrays._replace(**{name: value}).launch()


def test_an_unknown_depth_is_refused():
    """Only the sensor's two kinds."""
    with pytest.raises(InputError, match="depth must be one of 'range', 'z'"):
        upload(make_scene(), make_index(), "cpu").launch(depth="x")
