"""JAX arrays in a sensor's step, and the step inside `jax.jit`."""

from __future__ import annotations

import gc
import weakref
from typing import Any

import numpy as np
import pytest
import warp as wp

import depthwarp as dw
from depthwarp.errors import InputError
from depthwarp.sim import DepthSensor
from depthwarp.sim.handed import adopt
from depthwarp.sim.jax_call import jax_step

jax: Any = pytest.importorskip("jax")
jnp: Any = jax.numpy
CPU = wp.get_device("cpu")
WORLDS, CAMERAS, POINTS = 2, 2, 200


@pytest.fixture(autouse=True)
def on_the_cpu() -> Any:
    with jax.default_device(jax.devices("cpu")[0]):
        yield


def make_sensor() -> DepthSensor:
    lens = dw.PinholeCamera.from_fov((80, 65), (20, 15))
    return DepthSensor(
        WORLDS, CAMERAS, None, lens, POINTS, device="cpu", outputs=("depth", "index", "state")
    )


@pytest.fixture(scope="module")
def sensor() -> DepthSensor:
    return make_sensor()


def scene(seed: int, worlds: int = WORLDS) -> tuple[Any, Any]:
    """Points and poses of some worlds."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-5, 5, (worlds, POINTS, 3)).astype(np.float32)
    poses = [
        dw.Pose.from_orientation(rng.uniform(-1, 1, 3), rng.uniform(-180, 180, 3))
        for _ in range(worlds * CAMERAS)
    ]
    matrices = np.array([pose.optical_from_world for pose in poses], np.float32)
    return points, matrices.reshape(worlds, CAMERAS, 4, 4)


def drawn(sensor: DepthSensor, *arrays: Any, **options: Any) -> dict[str, Any]:
    """What a step with NumPy arrays gives."""
    maps = {n: a.numpy().copy() for n, a in sensor.step(*arrays, **options).items()}
    assert (maps["depth"] > 0).any()
    return maps


def assert_same(images: Any, expected: dict[str, Any]) -> None:
    assert list(images) == list(expected)
    for name, array in expected.items():
        assert images[name].dtype == array.dtype
        np.testing.assert_array_equal(np.asarray(images[name]), array)


def test_an_array_keeps_its_address() -> None:
    """(2, 5, 3) numbers become (2, 5) vectors of the same memory, which lives on with them."""
    source = jnp.arange(30.0).reshape(2, 5, 3)
    array = adopt("points", source, wp.vec3f, (2, None), CPU)
    assert array.ptr == source.unsafe_buffer_pointer() and array.shape == (2, 5)
    del source
    gc.collect()
    np.testing.assert_array_equal(array.numpy().ravel(), np.arange(30))


def test_an_array_is_waited_for() -> None:
    """JAX computes while Python goes on; a step reads an array when it is computed."""
    matrix = jnp.full((400, 400), 1 / 400)
    product = jax.jit(lambda a: jax.lax.fori_loop(0, 40, lambda _, b: b @ a, a))(matrix)
    array = adopt("points", product, wp.float32, (400, 400), CPU)
    np.testing.assert_allclose(array.numpy(), 1 / 400, rtol=1e-4)


def test_refused() -> None:
    """Another type, an array that is being traced, and JAX arrays as `out` are errors."""

    def take(value: Any, writable: bool = False) -> Any:
        return adopt("points", value, wp.vec3f, (2, None), CPU, writable)

    with pytest.raises(InputError, match=r"got int32: hand points\.astype\(jnp\.float32\)"):
        take(jnp.zeros((2, 5, 3), jnp.int32))
    with pytest.raises(InputError, match="never change: use dw.sim.jax_step"):
        take(jnp.zeros((2, 5, 3)), writable=True)
    with pytest.raises(InputError, match="inside jax.jit use dw.sim.jax_step"):
        jax.jit(take)(jnp.zeros((2, 5, 3)))


def test_eager_arrays_of_jax(sensor: DepthSensor) -> None:
    """A step takes JAX arrays as it takes NumPy arrays."""
    expected = drawn(sensor, *scene(1))
    maps = sensor.step(*map(jnp.asarray, scene(1)))
    assert_same({name: array.numpy() for name, array in maps.items()}, expected)


def test_inside_jit(sensor: DepthSensor) -> None:
    """In a compiled program, and called alone, the step gives the bits of `sensor.step`."""
    points, poses = scene(2)
    step = jax_step(sensor)
    half = drawn(sensor, points * np.float32(0.5), poses)
    assert_same(jax.jit(lambda p, t: step(p * 0.5, t))(points, poses), half)
    assert_same(step(points, poses), drawn(sensor, points, poses))
    counts = np.array([50, 0], np.int32)
    depth = np.full(sensor.shape, 2.5, np.float32)
    expected = drawn(sensor, points, poses, counts, scene_depth=depth)
    assert_same(jax.jit(step)(points, poses, counts, scene_depth=depth), expected)


def test_a_differentiated_program(sensor: DepthSensor) -> None:
    """Derivatives through a step are an error and not 0; with stop_gradient it is a constant."""
    points, poses = scene(8)
    step = jax_step(sensor)
    with pytest.raises(ValueError, match="depth_sensor_step.* cannot be differentiated"):
        jax.grad(lambda p: step(p, poses)["depth"].sum())(points)

    def weighted(scale: Any) -> Any:
        return scale * step(jax.lax.stop_gradient(points * scale), poses)["depth"].max()

    expected = drawn(sensor, points, poses)["depth"].max()
    assert jax.jit(jax.grad(weighted))(jnp.float32(1)) == expected


def test_steps_of_a_scan(sensor: DepthSensor) -> None:
    """In a `lax.scan` each step sees the points that the one before has moved."""
    points, poses = scene(3)
    step = jax_step(sensor)

    def move(state: Any, _: Any) -> Any:
        images = step(state, poses)
        return state + images["depth"].max(), images

    final, images = jax.jit(lambda p: jax.lax.scan(move, p, length=2))(points)
    for k in range(2):
        expected = drawn(sensor, points, poses)
        assert_same({name: array[k] for name, array in images.items()}, expected)
        points = points + expected["depth"].max()
    np.testing.assert_array_equal(np.asarray(final), points)


def test_vmap_of_a_program_of_one_world(sensor: DepthSensor) -> None:
    """Mapped over all worlds it is one step; an argument that is not mapped is every world's."""
    points, poses = scene(4)
    step = jax_step(sensor)

    def look(cloud: Any, looks: Any) -> Any:
        return {name: array[0] for name, array in step(cloud[None], looks[None]).items()}

    assert_same(jax.jit(jax.vmap(look))(points, poses), drawn(sensor, points, poses))
    shared = np.broadcast_to(points[0], points.shape).copy()
    assert_same(jax.vmap(look, (None, 0))(points[0], poses), drawn(sensor, shared, poses))


def test_vmap_over_a_multiple_of_the_worlds(sensor: DepthSensor) -> None:
    """Three times the sensor's worlds are three steps."""
    points, poses = scene(5, 3 * WORLDS)
    stacked = [array.reshape(3, WORLDS, *array.shape[1:]) for array in (points, poses)]
    images = jax.vmap(jax_step(sensor))(*stacked)
    for k in range(3):
        expected = drawn(sensor, stacked[0][k], stacked[1][k])
        assert_same({name: array[k] for name, array in images.items()}, expected)


@pytest.mark.parametrize(
    ("points", "poses", "message"),
    [
        ((2, 9, 3), np.float64, r"poses must be float32, got float64: hand poses\.astype\(jnp"),
        ((2, 9, 4), np.float32, r"points must have the shape \(2, any, 3\), got \(2, 9, 4\)"),
        ((4, 9, 3), np.float32, r"points must have the shape \(2, any, 3\), got \(4, 9, 3\)"),
        (None, np.float32, "points must be a JAX array, got list"),
    ],
    ids=["type", "vectors", "worlds", "list"],
)
def test_wrong_arrays(sensor: DepthSensor, points: Any, poses: Any, message: str) -> None:
    """A wrong type or shape is an error while the program is traced, before anything runs."""
    step = jax_step(sensor)
    cloud = [[[1.0, 2.0, 3.0]]] if points is None else np.zeros(points, np.float32)
    with pytest.raises(InputError, match=message):
        step(cloud, scene(1)[1].astype(poses))


def test_wrong_number_of_worlds(sensor: DepthSensor, capfd: Any) -> None:
    """No multiple of the sensor's worlds, or a share of them without vmap, is an error."""
    points, poses = scene(6, 3)
    step = jax_step(sensor)
    with pytest.raises(InputError, match="those of 3 worlds, and the sensor has 2"):
        step(points, poses)
    with pytest.raises(jax.errors.JaxRuntimeError, match="handed 1 worlds, and the sensor has 2"):
        jax.block_until_ready(step(points[:1], poses[:1]))
    capfd.readouterr()  # Warp prints what failed inside of XLA


def test_memory_of_a_sensor_is_given_back(capfd: Any) -> None:
    """What Warp registers with XLA for ever does not keep a sensor alive."""
    sensor = make_sensor()
    step = jax_step(sensor)
    program = jax.jit(step).lower(*scene(7)).compile()
    assert_same(program(*scene(7)), drawn(sensor, *scene(7)))
    alive = weakref.ref(sensor)
    del sensor, step
    gc.collect()
    assert alive() is None
    with pytest.raises((ValueError, RuntimeError), match="the sensor .* is gone"):
        jax.block_until_ready(program(*scene(7)))
    capfd.readouterr()
