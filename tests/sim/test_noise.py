"""The sensor model: kernel against loops, its statistics, and that its numbers can be repeated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings

import depthwarp as dw
from depthwarp.errors import InputError
from depthwarp.filters.maps import DeviceMaps
from depthwarp.sim.noise import NoiseStep, SensorNoise
from tests.filters.maps import layered_maps
from tests.reference import sim_noise as reference

ALL = SensorNoise(
    min_range=0.5,
    disparity_noise=3e-3,
    disparity_step=2e-3,
    depth_step=0.001,
    grazing_angle=50.0,
    flying_share=0.4,
    flying_jump=0.2,
    seed=(123 << 32) + 77,
)
SQUARE = dw.PinholeCamera.from_fov((60, 60), (64, 64))


class Sensor:
    """The maps of some worlds on a device, and the noise on them."""

    def __init__(self, noise, depth, cameras, device, kind="range", state=None, threads=None):
        self.depth = np.asarray(depth, np.float32)
        self.index = np.where(self.depth > 0, np.arange(self.depth.size).reshape(depth.shape), -1)
        self.state = np.where(self.depth > 0, 1, 0) if state is None else state
        self.maps = DeviceMaps(
            wp.empty(self.depth.shape, dtype=wp.float32, device=device),
            wp.empty(self.depth.shape, dtype=wp.int32, device=device),
            wp.empty(self.depth.shape, dtype=wp.uint8, device=device),
            threads=threads,
        )
        self.load()
        worlds = len(depth) // len(cameras)
        self.noise: NoiseStep = noise.build(self.maps, worlds, cameras, kind)

    def load(self) -> None:
        """Put the true maps on the device."""
        self.maps.depth.assign(self.depth)
        self.maps.index.assign(self.index.astype(np.int32))
        self.maps.state.assign(self.state.astype(np.uint8))

    def read(self):
        """Depth, index and state as they are on the device."""
        maps = self.maps.depth, self.maps.index, self.maps.state
        return tuple(array.numpy().copy() for array in maps)

    def step(self):
        """The true maps after one step of the sensor."""
        self.load()
        self.noise()
        return self.read()


def same(first, second) -> bool:
    """Whether all bits of the maps are the same."""
    return all(a.tobytes() == b.tobytes() for a, b in zip(first, second, strict=True))


def wall(depth: float, worlds: int = 1) -> np.ndarray:
    """Images of 64 x 64 px that are one depth all over."""
    return np.full((worlds, 64, 64), depth, np.float32)


def plane(camera: dw.PinholeCamera, tilt: float) -> np.ndarray:
    """Range [m] of a plane 2 m ahead, its normal turned by degrees from the optical axis."""
    v, u = np.indices((camera.height, camera.width))
    rays = camera.directions(u, v)
    normal = np.array([np.cos(np.radians(tilt)), 0, np.sin(np.radians(tilt))])
    return (2 * normal[0] / (rays @ normal))[None]


# --- the generator ---


@pytest.mark.parametrize(
    ("counter", "key", "expected"),
    [
        ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        (
            (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
            (0xA4093822, 0x299F31D0),
            (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
        ),
    ],
)
def test_loops_use_the_published_generator(counter, key, expected):
    """The known answers of Philox4x32-10 that its authors give."""
    assert reference.philox(counter, key) == expected


@pytest.mark.parametrize("word", [0, 1, 2, 0x3FFFFFFF, 0x80000000, 0xB504F333, 0xFFFFFFFF])
def test_logarithm_is_right(word):
    """Within 3 units of the last place from the smallest uniform number to 1."""
    x = np.float32(word | 1) / np.float32(2**32)
    assert reference.log(x) == pytest.approx(np.log(np.float64(x)), rel=2e-7, abs=1e-12)


# --- kernel == loops, bit for bit ---


@pytest.mark.parametrize(
    "noise",
    [
        ALL,
        SensorNoise(grazing_angle=5.0, seed=5),
        SensorNoise(flying_share=1.0, flying_jump=0.05, min_range=3.0),
        SensorNoise(disparity_noise=0.2, disparity_step=0.3),
    ],
    ids=["all", "grazing", "flying", "disparity"],
)
@settings(max_examples=5)
@given(depth_map=layered_maps())
def test_noise_is_the_loops(device, noise, depth_map):
    """Any map and lens, two worlds with two cameras, two steps, together or some parts alone."""
    camera = depth_map.camera
    shape = (4, *depth_map.depth.shape)
    depth = np.stack([np.roll(depth_map.depth, k, axis=1) for k in range(4)])
    state = np.stack([np.roll(depth_map.state, k, axis=1) for k in range(4)])
    sensor = Sensor(noise, depth, [camera] * 2, device, state=state)
    near, far = (camera.unproject(np.full(shape[1:], metres)) for metres in (1.0, 2.0))
    rays = np.stack([2 * near - far, far - near]).astype(np.float32)
    for step in (1, 2):
        ours = sensor.step()
        for v in range(4):
            true = sensor.depth[v], sensor.index[v].astype(np.int32), sensor.state[v]
            theirs = reference.add_noise(true, noise, rays, camera.wraps, v // 2, v % 2, step)
            assert same([a[v] for a in ours], theirs)


def test_all_off_changes_nothing(device):
    """The plain model leaves every bit, odd depths included."""
    rng = np.random.default_rng(0)
    depth = rng.uniform(0, 5, (2, 64, 64)).astype(np.float32)
    depth[:, ::7] = 0
    depth[:, 3, :3] = np.nan, np.inf, -1
    sensor = Sensor(SensorNoise(), depth, [SQUARE], device)
    true = sensor.read()
    assert same(sensor.step(), true)


# --- what can be repeated ---


def test_threads_do_not_matter():
    """One thread or several give the same bits."""
    depth = np.repeat(plane(SQUARE, 40.0), 16, axis=0)
    one = Sensor(ALL, depth, [SQUARE] * 2, "cpu", threads=1)
    more = Sensor(ALL, depth, [SQUARE] * 2, "cpu", threads=3)
    for _ in range(2):
        assert same(one.step(), more.step())


def test_every_world_camera_and_step_has_its_own_numbers(device):
    """No two images of two worlds, two cameras and two steps are alike, nor correlated."""
    sensor = Sensor(SensorNoise(disparity_noise=1e-3), wall(2.0, 4), [SQUARE] * 2, device)
    images = np.concatenate([sensor.step()[0] for _ in range(2)]).reshape(8, -1)
    correlation = np.corrcoef(images) - np.eye(8)
    assert np.abs(correlation).max() < 5 / np.sqrt(images.shape[1])


def test_a_world_is_the_same_among_more_worlds(device):
    """A world's numbers do not depend on how many worlds there are; the seed changes them."""
    few = Sensor(ALL, wall(2.0, 2), [SQUARE], device).step()
    many = Sensor(ALL, wall(2.0, 5), [SQUARE], device).step()
    assert same(few, [array[:2] for array in many[:1]] + [few[1], many[2][:2]])
    for seed in (ALL.seed + 1, ALL.seed + (1 << 32)):
        other = Sensor(replace(ALL, seed=seed), wall(2.0, 2), [SQUARE], device).step()
        assert (other[0] != few[0]).mean() > 0.5


def test_parts_do_not_disturb_each_other(device):
    """The noise of a pixel is the same whether dropouts are on or off."""
    noisy = SensorNoise(disparity_noise=1e-3, seed=4)
    depth = plane(SQUARE, 60.0)
    plain = Sensor(noisy, depth, [SQUARE], device).step()[0]
    dropped = Sensor(replace(noisy, grazing_angle=30.0), depth, [SQUARE], device).step()[0]
    assert 0.1 < (dropped == 0).mean() < 0.9
    assert (plain[dropped > 0] == dropped[dropped > 0]).all()


def test_reset_repeats(device):
    """After a reset the same steps follow; after one to step 1, the second one."""
    sensor = Sensor(ALL, wall(2.0), [SQUARE], device)
    first, second = sensor.step(), sensor.step()
    assert not same(first, second)
    sensor.noise.reset()
    assert same(sensor.step(), first)
    sensor.noise.reset(1)
    assert same(sensor.step(), second)


def test_replay_is_the_eager_step(device):
    """A captured graph goes on with the counter on the device: as many steps, the same bits."""
    if wp.get_device(device).is_cuda and not wp.is_mempool_enabled(device):
        pytest.skip("no memory pool: no capture")
    depth = np.repeat(plane(SQUARE, 40.0), 16, axis=0)  # enough rows for several threads
    eager = Sensor(ALL, depth, [SQUARE] * 2, device)
    captured = Sensor(ALL, depth, [SQUARE] * 2, device)
    with wp.ScopedCapture(device=device) as capture:
        captured.noise()
    for _ in range(3):
        captured.load()
        wp.capture_launch(capture.graph)
        assert same(captured.read(), eager.step())
    with wp.ScopedCapture(device=device) as capture:
        captured.noise.reset()
        captured.noise()
    captured.load()
    wp.capture_launch(capture.graph)
    eager.noise.reset()
    assert same(captured.read(), eager.step())


# --- statistics ---


@pytest.mark.parametrize("kind", ["range", "z"])
@pytest.mark.parametrize("depth", [1.0, 4.0, 10.0])
def test_noise_grows_with_the_square_of_depth(device, depth, kind):
    """Standard deviation within 2 %, no bias, shape of a normal distribution."""
    noise = SensorNoise(disparity_noise=1.425e-3, seed=3)
    sensor = Sensor(noise, wall(depth, 10), [SQUARE], device, kind)
    scores = (sensor.step()[0].astype(float) - depth).ravel() / (1.425e-3 * depth**2)
    assert scores.std() == pytest.approx(1, abs=0.02)
    assert abs(scores.mean()) < 4 / np.sqrt(scores.size)
    assert (scores**3).mean() == pytest.approx(0, abs=0.08)
    assert (scores**4).mean() == pytest.approx(3, abs=0.2)
    for bound, share in ((1.0, 0.3173), (2.0, 0.0455), (3.0, 0.0027)):
        expected = 4 * np.sqrt(share / scores.size)
        assert (np.abs(scores) > bound).mean() == pytest.approx(share, abs=expected)


def test_disparity_has_steps(device):
    """1/z is a whole multiple of the step, the nearest; beyond its half there is nothing."""
    depth = np.geomspace(0.3, 300, 64 * 64).reshape(1, 64, 64)
    step = 0.01
    result = Sensor(SensorNoise(disparity_step=step), depth, [SQUARE], device).step()[0]
    seen = result > 0
    np.testing.assert_array_equal(seen, 1 / depth / step > 0.5)
    levels = 1 / result[seen].astype(float) / step
    np.testing.assert_allclose(levels, np.round(levels), rtol=1e-6)
    assert np.abs(levels - 1 / depth[seen] / step).max() < 0.5001


def test_depth_has_steps(device):
    """Depth is the nearest whole multiple; what rounds to 0 is empty in all three maps."""
    depth = np.linspace(0.001, 1, 64 * 64).reshape(1, 64, 64)
    result, index, state = Sensor(SensorNoise(depth_step=0.02), depth, [SQUARE], device).step()
    np.testing.assert_allclose(result, np.round(depth / 0.02) * 0.02, atol=1e-6)
    empty = result == 0
    assert empty.any()
    np.testing.assert_array_equal(empty, index == -1)
    np.testing.assert_array_equal(state, np.where(empty, dw.State.EMPTY, dw.State.MEASURED))


def test_nothing_is_nearer_than_the_least_range(device):
    """Neither before the noise nor after it; what is farther stays."""
    depth = np.linspace(0.4, 0.8, 64 * 64).reshape(1, 64, 64)
    clean = Sensor(SensorNoise(min_range=0.6), depth, [SQUARE], device).step()[0]
    np.testing.assert_array_equal(clean, np.where(depth >= 0.6, depth, 0).astype(np.float32))
    noise = SensorNoise(min_range=0.6, disparity_noise=0.1)
    noisy = Sensor(noise, depth, [SQUARE], device).step()[0]
    assert noisy[noisy > 0].min() >= np.float32(0.6)
    assert (noisy[depth < 0.599] == 0).all()
    assert 0.05 < (noisy[depth > 0.601] == 0).mean() < 0.2


# --- neighbours ---


@pytest.mark.parametrize("kind", ["range", "z"])
def test_dropouts_follow_the_angle_of_incidence(device, kind):
    """On a slanted plane each pixel drops out by the angle between its own ray and the normal."""
    start, tilt, worlds = 30.0, 50.0, 60
    v, u = np.indices((64, 64))
    rays = SQUARE.directions(u, v)
    depth = np.repeat(plane(SQUARE, tilt), worlds, axis=0)
    if kind == "z":
        depth = depth * rays[..., 0]
    sensor = Sensor(SensorNoise(grazing_angle=start), depth, [SQUARE], device, kind)
    lost = (sensor.step()[0] == 0).mean(axis=0)
    cosine = rays @ np.array([np.cos(np.radians(tilt)), 0, np.sin(np.radians(tilt))])
    expected = np.maximum(1 - cosine / np.cos(np.radians(start)), 0)
    # Of a row all pixels have much the same angle: 64 columns and 60 worlds.
    np.testing.assert_allclose(lost.mean(axis=1), expected.mean(axis=1), atol=0.035)
    assert expected.mean(axis=1).max() > 0.5
    assert (expected == 0).any() and not lost[expected == 0].any()


def test_a_grazing_floor_loses_more_than_a_facing_wall(device):
    """A floor loses much, more the farther it is; a wall ahead loses nothing."""
    v, u = np.indices((64, 64))
    rays = SQUARE.directions(u, v)
    with np.errstate(divide="ignore"):
        floor = np.where(rays[..., 2] < -0.02, -1.0 / rays[..., 2], 0)
    noise = SensorNoise(grazing_angle=45.0)
    result = Sensor(noise, floor[None], [SQUARE], device).step()[0][0]
    lost = (floor > 0) & (result == 0)
    near, far = floor[-8:] > 0, (floor > 6)
    assert lost[far].mean() > lost[-8:][near].mean() + 0.3
    facing = 2.0 / rays[..., :1].reshape(1, 64, 64)
    assert (Sensor(noise, facing, [SQUARE], device).step()[0] > 0).all()


def test_pixels_fly_only_at_edges(device):
    """Before a far wall a near board: pixels beside its outline take depths between both."""
    depth = wall(4.0)
    depth[:, 20:40, 20:40] = 2.0
    depth[:, 30, 30] = 0  # a hole is no edge
    noise = SensorNoise(flying_share=0.5, seed=9)
    sensor = Sensor(noise, depth, [SQUARE], device, "z")
    result, index, state = (array[0] for array in sensor.step())
    near = depth[0] == 2.0
    near[30, 30] = True
    edge = np.zeros((64, 64), bool)
    for axis in (0, 1):
        for shift in (-1, 1):
            edge |= near != np.roll(near, shift, axis)
    moved = result != depth[0]
    assert not moved[~edge].any()
    assert 0.35 < moved[edge].mean() < 0.65
    assert ((result[moved] > 2) & (result[moved] < 4)).all()
    ways = np.abs(result - depth[0])[moved] / 2
    assert ways.mean() == pytest.approx(0.5, abs=0.1)
    np.testing.assert_array_equal(index, sensor.index[0])
    np.testing.assert_array_equal(state, sensor.state[0])


@pytest.mark.parametrize("kind", ["range", "z"])
def test_a_slope_is_no_edge(device, kind):
    """On a floor neighbours can be metres apart, and nothing flies; a thin pole before it does."""
    v, u = np.indices((64, 64))
    rays = SQUARE.directions(u, v)
    along = rays[..., 0] if kind == "z" else 1.0
    with np.errstate(divide="ignore"):
        floor = np.where(rays[..., 2] < -0.02, -1.0 / rays[..., 2] * along, 0)[None]
    assert np.abs(np.diff(floor[0], axis=0))[33:].max() > 3
    noise = SensorNoise(flying_share=1.0)
    assert same(Sensor(noise, floor, [SQUARE], device, kind).step()[:1], [floor.astype(np.float32)])
    floor[:, 40:, 30] = 1.0
    moved = Sensor(noise, floor, [SQUARE], device, kind).step()[0] != floor.astype(np.float32)
    assert moved[0, 40:50, 30].all()
    assert not moved[0, :, 33:].any()


def test_a_full_turn_has_no_edge_at_its_seam(device):
    """The last column's right neighbour is the first one."""
    pose = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))
    camera = dw.EquirectangularCamera(32, 16, pose)
    depth = np.full((1, 16, 32), 2.0)
    depth[:, :, 0] = 5.0
    noise = SensorNoise(flying_share=1.0)
    moved = Sensor(noise, depth, [camera], device).step()[0] != depth
    np.testing.assert_array_equal(np.unique(np.nonzero(moved)[2]), [0, 1, 31])


def test_erased_pixels_count_as_empty(device):
    """An erased pixel that kept its depth stays as it is and makes no edge."""
    depth = wall(4.0)
    depth[:, 20:30, 20:30] = 2.0
    state = np.where(depth == 2.0, dw.State.ERASED, dw.State.MEASURED)
    sensor = Sensor(SensorNoise(flying_share=1.0), depth, [SQUARE], device, "z", state)
    true = sensor.read()
    assert same(sensor.step(), true)


# --- bad input ---


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("min_range", -0.1),
        ("min_range", float("nan")),
        ("disparity_noise", float("inf")),
        ("disparity_noise", "much"),
        ("disparity_step", -1),
        ("depth_step", None),
        ("grazing_angle", 90.5),
        ("grazing_angle", -1),
        ("flying_share", 1.5),
        ("flying_share", True),
        ("flying_jump", 0),
        ("seed", -1),
        ("seed", 0.5),
        ("seed", 1 << 64),
    ],
)
def test_bad_numbers_are_refused(name, value):
    """The message names what is out of its range."""
    with pytest.raises(InputError, match=name):
        SensorNoise(**{name: value})


def test_maps_that_do_not_fit_are_refused(device):
    """Another number of views or another size than the worlds and cameras have; a bad step."""
    with pytest.raises(InputError, match="3 worlds"):
        maps = Sensor(ALL, wall(2.0, 2), [SQUARE], device).maps
        ALL.build(maps, 3, [SQUARE])
    with pytest.raises(InputError, match="sizes"):
        ALL.build(maps, 1, [SQUARE, dw.PinholeCamera.from_fov((60, 60), (32, 64))])
    with pytest.raises(InputError, match="0 cameras"):
        ALL.build(maps, 2, [])
    with pytest.raises(InputError, match="step"):
        Sensor(ALL, wall(2.0), [SQUARE], device).noise.reset(-1)
