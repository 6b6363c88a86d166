"""The depth sensor of many worlds against `dw.render` of every world and camera alone."""

from __future__ import annotations

import gc
import tracemalloc
from typing import Any

import numpy as np
import pytest
import warp as wp

import depthwarp as dw
from depthwarp.errors import InputError

ALL = ("depth", "index", "state")
WORLDS, CAMERAS, POINTS = 3, 2, 400


def pinhole(size: tuple[int, int] = (20, 15)) -> dw.PinholeCamera:
    return dw.PinholeCamera.from_fov((80, 65), size)


def fisheye() -> dw.FisheyeCamera:
    pose = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))
    return dw.FisheyeCamera(5.0, 5.0, 9.5, 7.0, 20, 15, pose, (0.01, 0.0, 0.0, 0.0))


def worlds_of(seed: int, worlds: int = WORLDS, points: int = POINTS) -> Any:
    """Points round the origin, some of them on the same rays."""
    rng = np.random.default_rng(seed)
    cloud = rng.uniform(-5, 5, (worlds, points, 3))
    cloud[:, ::3] *= 0.5
    return cloud.astype(np.float32)


def poses_of(seed: int, worlds: int = WORLDS, cameras: int = CAMERAS) -> Any:
    rng = np.random.default_rng(seed)
    matrices = [
        dw.Pose.from_orientation(
            rng.uniform(-1, 1, 3), rng.uniform(-180, 180, 3)
        ).optical_from_world
        for _ in range(worlds * cameras)
    ]
    return np.array(matrices, np.float32).reshape(worlds, cameras, 4, 4)


def sensor_of(lens: Any, outputs: tuple[str, ...] = ALL, **options: Any) -> dw.sim.DepthSensor:
    options = {"max_points_per_world": POINTS, "device": "cpu"} | options
    return dw.sim.DepthSensor(WORLDS, CAMERAS, None, lens, outputs=outputs, **options)


def drawn_by(sensor: dw.sim.DepthSensor, points: Any, poses: Any, *rest: Any, **more: Any) -> Any:
    """A step with arrays of the host, brought to the sensor's device."""
    kinds: list[Any] = [wp.vec3f, wp.mat44f, wp.int32]
    arrays = [
        None if array is None else wp.array(array, dtype=kind, device=sensor.device)
        for array, kind in zip((points, poses, *rest), kinds, strict=False)
    ]
    named = {
        name: wp.array(array, dtype=wp.float32, device=sensor.device)
        for name, array in more.items()
    }
    return sensor.step(*arrays, **named)


def expected_of(lens: Any, points: Any, pose: Any, **options: Any) -> Any:
    """What a renderer of one view draws, at the same float32 pose."""
    renderer = dw.Renderer([lens], max_points=1 << 20, outputs=ALL, device="cpu", **options)
    cloud = wp.array(np.ascontiguousarray(points), dtype=wp.vec3f, device="cpu")
    renderer.render(cloud, wp.array(pose[None], dtype=wp.mat44f, device="cpu"))
    return renderer.depth_maps()[0]


def assert_worlds(maps: Any, lens: Any, clouds: Any, poses: Any, **options: Any) -> None:
    for w, c in np.ndindex(poses.shape[:2]):
        expected = expected_of(lens, clouds[w], poses[w, c], **options)
        assert (expected.depth > 0).any() or len(clouds[w]) < 200
        for name in ALL:
            np.testing.assert_array_equal(maps[name].numpy()[w, c], getattr(expected, name))


@pytest.mark.parametrize("depth", ["range", "z"])
@pytest.mark.parametrize("lens", [pinhole(), fisheye()])
def test_every_view_is_that_of_its_world(device: str, lens: Any, depth: Any) -> None:
    """New points and poses with every step; each map, bit for bit, that of its world alone."""
    sensor = sensor_of(lens, device=device, depth=depth)
    for seed in (1, 2):
        points, poses = worlds_of(seed), poses_of(seed)
        maps = drawn_by(sensor, points, poses)
        assert maps["depth"].shape == sensor.shape
        assert_worlds(maps, lens, points, poses, depth=depth)
    assert sensor.status().is_clean


def test_counts_say_how_many_points_a_world_has(device: str) -> None:
    """Rows behind a world's count are not drawn, whatever they hold."""
    sensor, lens = sensor_of(pinhole(), device=device), pinhole()
    points, poses = worlds_of(3), poses_of(3)
    counts = np.array([0, 1, 250], np.int32)
    maps = drawn_by(sensor, points, poses, counts)
    clouds = [points[w, :count] for w, count in enumerate(counts)]
    for w, c in np.ndindex(poses.shape[:2]):
        expected = expected_of(lens, clouds[w], poses[w, c])
        np.testing.assert_array_equal(maps["index"].numpy()[w, c], expected.index)
    assert sensor.status().is_clean


def test_worlds_one_behind_the_other(device: str) -> None:
    """Ragged points: the counts divide them."""
    sensor, lens = sensor_of(pinhole(), device=device), pinhole()
    rows, poses = worlds_of(4).reshape(-1, 3), poses_of(4)
    counts = np.array([300, 0, 400], np.int32)
    maps = drawn_by(sensor, rows, poses, counts)
    clouds = np.split(rows[:700], [300, 300])
    for w, c in np.ndindex(poses.shape[:2]):
        expected = expected_of(lens, clouds[w], poses[w, c])
        np.testing.assert_array_equal(maps["depth"].numpy()[w, c], expected.depth)
    assert sensor.status().is_clean


def test_points_of_a_world_are_in_no_other(device: str) -> None:
    """Each world is a sphere of its own radius: no pixel of it has another one's."""
    rng = np.random.default_rng(5)
    ways = rng.normal(size=(WORLDS, POINTS, 3))
    radii = np.arange(1, WORLDS + 1)
    points = ways / np.linalg.norm(ways, axis=-1, keepdims=True) * radii[:, None, None]
    identity = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0)).optical_from_world.astype(np.float32)
    poses = np.tile(identity, (WORLDS, CAMERAS, 1, 1))
    depth = drawn_by(sensor_of(pinhole(), device=device), points.astype(np.float32), poses)[
        "depth"
    ].numpy()
    for world, radius in enumerate(radii):
        seen = depth[world][depth[world] > 0]
        assert seen.size and np.abs(seen - radius).max() < 1e-5


def test_surplus_points_are_counted_and_not_drawn(device: str) -> None:
    """Counts beyond the room and below 0 are noted until somebody asks; other worlds are whole."""
    sensor, lens = sensor_of(pinhole(), device=device), pinhole()
    points, poses = worlds_of(6), poses_of(6)
    maps = drawn_by(sensor, points, poses, np.array([POINTS + 7, -3, 10], np.int32))
    drawn_by(sensor, points, poses, np.array([POINTS + 2, 1, 10], np.int32))
    status = sensor.status()
    assert status.surplus.tolist() == [7, 0, 0]
    assert status.negative_count.tolist() == [False, True, False]
    assert str(status) == (
        "up to 7 points too many in world 0; a negative count of points in world 1"
    )
    assert sensor.status().is_clean and str(sensor.status()) == "nothing went wrong"
    maps = drawn_by(sensor, points, poses, np.array([POINTS + 7, -3, 10], np.int32))
    assert_worlds(maps, lens, [points[0], points[1, :0], points[2, :10]], poses)


def test_ragged_points_beyond_the_room(device: str) -> None:
    """A world too large, and counts beyond the points: what is drawn lies within both."""
    sensor, lens = sensor_of(pinhole(), device=device, max_points_per_world=100), pinhole()
    rows, poses = worlds_of(7)[0], poses_of(7)
    maps = drawn_by(sensor, rows, poses, np.array([150, 200, 200], np.int32))
    assert sensor.status().surplus.tolist() == [50, 100, 150]
    assert_worlds(maps, lens, [rows[:100], rows[150:250], rows[350:400]], poses)


@pytest.mark.parametrize("static", [False, True])
def test_a_pose_that_is_none_leaves_its_image_empty(device: str, static: bool) -> None:
    """NaN, infinite, scaled, mirrored: noted; all other images are as they are without it."""
    points, poses = worlds_of(8), poses_of(8)
    world = dw.PointCloud(worlds_of(9).reshape(-1, 3)).prepare(device=device) if static else None
    sensor = sensor_of(pinhole(), device=device, static_map=world)
    before = {name: array.numpy().copy() for name, array in drawn_by(sensor, points, poses).items()}
    spoiled = {
        "nan": np.full((4, 4), np.nan),
        "infinite": np.where(np.arange(16).reshape(4, 4) == 3, np.inf, poses[1, 0]),
        "scaled": poses[1, 0] * np.array([[1.01], [1.01], [1.01], [1]]),
        "mirrored": poses[1, 0] * np.array([[-1], [1], [1], [1]]),
        "zero": np.zeros((4, 4)),
    }
    for matrix in spoiled.values():
        bad = poses.copy()
        bad[1, 0] = matrix
        maps = drawn_by(sensor, points, bad)
        assert not maps["depth"].numpy()[1, 0].any() and (maps["index"].numpy()[1, 0] == -1).all()
        for name, array in maps.items():
            others = array.numpy().reshape(WORLDS * CAMERAS, -1).copy()
            expected = before[name].reshape(WORLDS * CAMERAS, -1).copy()
            others[CAMERAS] = expected[CAMERAS] = 0
            np.testing.assert_array_equal(others, expected)
        assert sensor.status().bad_pose.tolist() == [False, True, False]
    drawn_by(sensor, points, poses)
    assert sensor.status().is_clean


@pytest.mark.parametrize("prepared", [False, True])
def test_a_static_map_is_under_all_worlds(device: str, prepared: bool) -> None:
    """The maps of both clouds together, the static points first."""
    world = dw.PointCloud(worlds_of(10, 1, 3000)[0])
    sensor = sensor_of(
        pinhole(), device=device, static_map=world.prepare(device=device) if prepared else world
    )
    for seed in (11, 12):
        points, poses = worlds_of(seed), poses_of(seed)
        clouds = [np.concatenate([world.points_world, own]) for own in points]
        assert_worlds(drawn_by(sensor, points, poses), pinhole(), clouds, poses)
    alone = drawn_by(sensor, None, poses)
    assert_worlds(alone, pinhole(), [world.points_world] * WORLDS, poses)


def test_filters_see_all_points(device: str) -> None:
    """Hidden points of the static map behind a world's own are erased as `dw.render` does it."""
    filters = dw.filters.best()
    world = dw.PointCloud(worlds_of(13, 1, 900)[0])
    sensor = sensor_of(pinhole(), device=device, static_map=world, filters=filters)
    points, poses = worlds_of(14), poses_of(14)
    clouds = [np.concatenate([world.points_world, own]) for own in points]
    assert_worlds(drawn_by(sensor, points, poses), pinhole(), clouds, poses, filters=filters)


def test_the_nearer_of_two_renderers(device: str) -> None:
    """Where another image is nearer or alone it stays, unless it is no depth or out of bounds."""
    sensor = sensor_of(pinhole(), device=device, max_range=6.0, min_range=0.2)
    points, poses = worlds_of(15), poses_of(15)
    ours = {name: array.numpy().copy() for name, array in drawn_by(sensor, points, poses).items()}
    rng = np.random.default_rng(16)
    theirs = rng.uniform(0.1, 7, sensor.shape).astype(np.float32)
    theirs[rng.random(sensor.shape) < 0.5] = 0
    theirs[0, 0, 0, :4] = np.nan, np.inf, -1, 1e30
    maps = drawn_by(sensor, points, poses, scene_depth=theirs)
    with np.errstate(invalid="ignore"):
        seen = (theirs >= np.float32(0.2)) & (theirs <= 6)
    taken = seen & ((ours["depth"] == 0) | (theirs < ours["depth"]))
    assert taken.any() and not taken.all()
    np.testing.assert_array_equal(maps["depth"].numpy(), np.where(taken, theirs, ours["depth"]))
    np.testing.assert_array_equal(maps["index"].numpy(), np.where(taken, -1, ours["index"]))
    np.testing.assert_array_equal(
        maps["state"].numpy(), np.where(taken, dw.State.MEASURED, ours["state"])
    )


@pytest.mark.parametrize("static", [False, True])
def test_a_replayed_graph_draws_what_a_call_does(static: bool) -> None:
    """Captured on the CPU: new numbers in the same arrays, the same bits as a call."""
    world = dw.PointCloud(worlds_of(17, 1, 3000)[0]).prepare(device="cpu") if static else None
    sensor = sensor_of(pinhole(), static_map=world, filters=dw.filters.best())
    points = wp.array(worlds_of(18), dtype=wp.vec3f, device="cpu")
    poses = wp.array(poses_of(18), dtype=wp.mat44f, device="cpu")
    counts = wp.array([400, 400, 400], dtype=wp.int32, device="cpu")
    sensor.step(points, poses, counts)
    with wp.ScopedCapture(device="cpu") as capture:
        captured = sensor.step(points, poses, counts)
    for seed, count in ((19, 400), (20, 123)):
        points.assign(worlds_of(seed))
        poses.assign(poses_of(seed))
        counts.assign([count] * WORLDS)
        wp.capture_launch(capture.graph)
        replayed = {name: array.numpy().copy() for name, array in captured.items()}
        for name, array in sensor.step(points, poses, counts).items():
            np.testing.assert_array_equal(array.numpy(), replayed[name])
        assert (replayed["depth"] > 0).any()


def test_a_graph_keeps_its_shapes() -> None:
    """Steps of other shapes between two replays change nothing of what a graph draws."""
    sensor = sensor_of(pinhole())
    points = wp.array(worlds_of(24), dtype=wp.vec3f, device="cpu")
    poses = wp.array(poses_of(24), dtype=wp.mat44f, device="cpu")
    expected = sensor.step(points, poses)["depth"].numpy().copy()
    with wp.ScopedCapture(device="cpu") as capture:
        captured = sensor.step(points, poses)
    sensor.step(worlds_of(25, points=7), poses)
    sensor.step(worlds_of(25), poses, np.full(WORLDS, 3, np.int32))
    wp.capture_launch(capture.graph)
    np.testing.assert_array_equal(captured["depth"].numpy(), expected)


def test_an_erased_pixel_is_empty_for_another_renderer() -> None:
    """One that kept its depth: a farther depth of theirs takes its place."""
    kept = [dw.filters.remove_hidden("paper", threshold=0.1, keep_depth=True)]
    sensor = sensor_of(pinhole(), filters=kept)
    points, poses = worlds_of(26), poses_of(26)
    erased = sensor.step(points, poses)["state"].numpy() == dw.State.ERASED
    far = np.full(sensor.shape, 14.5, np.float32)
    maps = sensor.step(points, poses, scene_depth=far)
    assert erased.any() and (maps["depth"].numpy()[erased] == 14.5).all()
    assert (maps["state"].numpy()[erased] == dw.State.MEASURED).all()


def test_vectors_of_any_maker_are_points() -> None:
    """A vector type that equals `wp.vec3f` without being it."""
    sensor = sensor_of(pinhole())
    vector: Any = wp.types.vector(length=3, dtype=wp.float32)
    points, poses = worlds_of(27), poses_of(27)
    expected = sensor.step(points, poses)["depth"].numpy().copy()
    found = sensor.step(wp.array(points, dtype=vector, device="cpu"), poses)["depth"].numpy()
    np.testing.assert_array_equal(found, expected)


def test_results_go_where_they_are_wanted() -> None:
    """`out`: the caller's arrays are written and returned; others stay the sensor's."""
    sensor = sensor_of(pinhole())
    points, poses = worlds_of(21), poses_of(21)
    mine = np.zeros(sensor.shape, np.float32)
    maps = sensor.step(points, poses, out={"depth": mine})
    assert maps["depth"].ptr == mine.ctypes.data and (mine > 0).any()
    np.testing.assert_array_equal(mine, sensor.step(points, poses)["depth"].numpy())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"points": worlds_of(1)[:2]}, "points must"),
        ({"points": worlds_of(1).astype(np.float64)}, "float32"),
        ({"points": worlds_of(1, points=POINTS + 1)}, "max_points_per_world = 400"),
        ({"points": worlds_of(1)[0]}, "counts are missing"),
        ({"points": None}, "no static map"),
        ({"poses": poses_of(1)[:, :1]}, "poses"),
        ({"poses": poses_of(1).astype(np.float64)}, "float32"),
        ({"counts": np.array([1, 2], np.int32)}, "counts"),
        ({"counts": np.array([1, 2, 3])}, "int32"),
        ({"out": {"normal": np.zeros(1, np.float32)}}, "no output of this sensor"),
        ({"out": {"depth": np.zeros((2, 2), np.float32)}}, "out"),
        ({"out": [1]}, "by the names"),
        ({"scene_depth": np.zeros((3, 2, 4, 4), np.float32)}, "scene_depth"),
    ],
)
def test_what_does_not_fit_is_refused(change: dict[str, Any], words: str) -> None:
    """In words, before anything is drawn."""
    sensor = sensor_of(pinhole())
    arguments = {"points": worlds_of(1), "poses": poses_of(1)} | change
    with pytest.raises(InputError, match=words):
        sensor.step(**arguments)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"num_worlds": 0}, "num_worlds"),
        ({"cameras_per_world": 1.5}, "cameras_per_world"),
        ({"size": (21, 15)}, r"size is \(21, 15\) and the model's own \(20, 15\)"),
        ({"model": [pinhole()]}, "one for each of the 2 cameras"),
        ({"model": "pinhole"}, "model must be a camera"),
        ({"model": [pinhole(), pinhole((9, 9))], "size": None}, "one model and size"),
        ({"max_points_per_world": 0}, "max_points_per_world"),
        ({"outputs": ("normal",)}, "outputs"),
        ({"static_map": np.zeros((3, 3))}, "static_map must be"),
    ],
)
def test_a_sensor_that_cannot_be(change: dict[str, Any], words: str) -> None:
    """Each argument is named."""
    arguments = {
        "num_worlds": 3,
        "cameras_per_world": 2,
        "size": (20, 15),
        "model": pinhole(),
        "max_points_per_world": 10,
        "device": "cpu",
    } | change
    with pytest.raises(InputError, match=words):
        dw.sim.DepthSensor(**arguments)


@pytest.mark.parametrize("static", [False, True])
def test_after_the_first_step_nothing_is_allocated(
    monkeypatch: pytest.MonkeyPatch, static: bool
) -> None:
    """No memory of the device, and on the host nothing that stays."""
    world = dw.PointCloud(worlds_of(22, 1, 3000)[0]) if static else None
    noise = dw.sim.SensorNoise(disparity_noise=1e-3, flying_share=0.2, grazing_angle=70.0)
    sensor = sensor_of(
        pinhole(), static_map=world, filters=dw.filters.best(), noise=noise, outputs=ALL
    )
    points = wp.array(worlds_of(23), dtype=wp.vec3f, device="cpu")
    poses, scene = poses_of(23), np.full(sensor.shape, 3.0, np.float32)
    counts, out = np.full(WORLDS, 300, np.int32), {"depth": np.zeros(sensor.shape, np.float32)}

    def step() -> None:
        sensor.step(points, poses, counts, out, scene_depth=scene)

    step()
    allocator = type(wp.get_device("cpu").default_allocator)
    monkeypatch.setattr(allocator, "allocate", _no_allocation)
    with pytest.raises(AssertionError, match="allocated"):
        wp.zeros(1, device="cpu")
    step()
    step()  # what Python keeps of a call, it keeps by now
    tracemalloc.start()
    try:
        step()
        before = tracemalloc.get_traced_memory()[0]
        for _ in range(50):
            step()
        gc.collect()
        assert tracemalloc.get_traced_memory()[0] - before < 2000
    finally:
        tracemalloc.stop()


def _no_allocation(*_: object) -> None:
    raise AssertionError("allocated")
