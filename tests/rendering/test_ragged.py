"""Many clouds at once: each view has the bits and counts of its own cloud drawn alone."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp
from hypothesis import given
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.cameras import Camera
from depthwarp.devices import resolve_device
from depthwarp.errors import CapacityError, InputError
from depthwarp.rendering import RenderConfig, ViewPlan, ragged_splatting
from depthwarp.rendering.ragged import OUTPUTS, RaggedPlan
from depthwarp.rendering.views import DeviceViews
from depthwarp_kernels import ragged, splat
from depthwarp_kernels.point_source import PLAIN
from tests.rendering.strategies import SPECIAL, seeds

ALL = tuple(OUTPUTS)


def turned(lens: Camera, count: int) -> list[Camera]:
    """The same lens, looking elsewhere in each view."""
    poses = [
        dw.Pose.from_orientation((0.1 * n, -0.05 * n, 0), (3 * n, 5, 50 * n)) for n in range(count)
    ]
    return [lens.with_pose(pose) for pose in poses]


def clouds_of(seed: int, sizes: list[int]) -> list[np.ndarray]:
    """Points (N, 3) float32 all round the origin, some of them not finite or strange."""
    rng = np.random.default_rng(seed)
    clouds = [rng.uniform(-5, 5, (size, 3)).astype(np.float32) for size in sizes]
    for cloud in clouds:
        broken = rng.random(cloud.shape) < 0.02
        cloud[broken] = rng.choice(SPECIAL, broken.sum())
    return clouds


def joined(clouds: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Clouds one behind the other, and their offsets."""
    offsets = np.cumsum([0, *map(len, clouds)], dtype=np.int32)
    return np.concatenate(clouds), offsets


def upload(values: np.ndarray, dtype, device: str):
    """A Warp array."""
    return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device)


def assert_same(ours: dw.DepthMap, theirs: dw.DepthMap) -> None:
    """All of two maps is the same, bit for bit."""
    for name in ALL:
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
    assert ours.stats == theirs.stats and ours.camera == theirs.camera


def maps_of(cameras, clouds, cloud_of, device, **options) -> list[dw.DepthMap]:
    """The maps of a renderer's first call, with everything on the device."""
    points, offsets = joined(clouds)
    renderer = dw.Renderer(
        cameras, max_points=len(points), outputs=ALL, cloud_of=cloud_of, device=device, **options
    )
    renderer.render(upload(points, wp.vec3f, device), offsets=upload(offsets, wp.int32, device))
    return renderer.depth_maps()


@given(
    seeds,
    st.lists(st.sampled_from([0, 1, 2, 127, 128, 129, 300]), min_size=1, max_size=6),
    st.tuples(st.integers(1, 40), st.integers(1, 20)),
    st.integers(1, 5),
)
def test_each_view_is_its_cloud_alone(seed, sizes, size, views):
    """Any sizes of clouds, empty ones too, any image, several views of one cloud or none."""
    clouds = clouds_of(seed, sizes)
    cloud_of = np.random.default_rng(seed).integers(0, len(sizes), views)
    cameras = turned(dw.PinholeCamera.from_fov((70, 60), size), views)
    maps = maps_of(cameras, clouds, cloud_of, "cpu")
    for depth_map, camera, cloud in zip(maps, cameras, cloud_of, strict=True):
        assert_same(depth_map, dw.render(dw.PointCloud(clouds[cloud]), camera, device="cpu"))


@pytest.mark.parametrize(
    ("lens", "options"),
    [
        (dw.PinholeCamera.from_fov((70, 60), (30, 20)), {"filters": dw.filters.paper()}),
        (dw.EquirectangularCamera.looking((36, 18)), {"min_range": 1.0, "max_range": 4.0}),
    ],
)
def test_lenses_bounds_and_filters(device, lens, options):
    """What the settings do to one cloud they do to each of many; later calls draw anew."""
    cameras, options = turned(lens, 4), options | {"device": device}
    renderer = dw.Renderer(cameras, max_points=2000, outputs=ALL, **options)
    for seed in (1, 2):
        clouds = clouds_of(seed, [700, 0, 129, 500])
        points, offsets = joined(clouds)
        renderer.render(upload(points, wp.vec3f, device), offsets=offsets)
        for depth_map, camera, cloud in zip(renderer.depth_maps(), cameras, clouds, strict=True):
            assert_same(depth_map, dw.render(dw.PointCloud(cloud), camera, **options))


def test_any_number_of_threads():
    """Enough work for several threads: the same bits and counts for 1 to 7 of them."""
    clouds = clouds_of(3, [1500] * 60)
    points, offsets = joined(clouds)
    cameras = turned(dw.PinholeCamera.from_fov((70, 60), (40, 40)), 60)
    cpu = resolve_device("cpu")
    expected = [
        dw.render(dw.PointCloud(cloud), camera, device="cpu")
        for cloud, camera in zip(clouds, cameras, strict=True)
    ]
    for threads in (1, 2, 7):
        views = [ViewPlan(camera) for camera in cameras]
        plan = RaggedPlan(views, RenderConfig(), ALL, cpu, threads)
        plan.render(
            upload(points, wp.vec3f, "cpu"),
            upload(offsets, wp.int32, "cpu"),
            upload(np.arange(60), wp.int32, "cpu"),
        )
        for ours, theirs in zip(plan.depth_maps(), expected, strict=True):
            assert_same(ours, theirs)


def test_the_kernels_for_cuda():
    """Launched on the CPU, one thread after the other, they draw what the fused one does."""
    clouds, cloud_of = clouds_of(4, [300, 0, 1, 257]), np.array([3, 2, 1, 0, 3], np.int32)
    points, offsets = joined(clouds)
    cameras = turned(dw.PinholeCamera.from_fov((70, 60), (15, 10)), 5)
    cpu = resolve_device("cpu")
    views = DeviceViews([ViewPlan(camera) for camera in cameras], RenderConfig(), cpu)
    keys = wp.full((5, 150), splat.EMPTY_KEY, dtype=wp.uint64, device=cpu)
    counts = wp.zeros((5, ragged.RAGGED_COLUMNS), dtype=wp.int64, device=cpu)
    outputs = [wp.zeros((5, 150), dtype=dtype, device=cpu) for dtype in OUTPUTS.values()]
    spans = np.stack([offsets[:-1], offsets[1:]], axis=1).astype(np.int32)
    clouds_on = [upload(spans, wp.vec2i, "cpu"), upload(cloud_of, wp.int32, "cpu")]
    wp.launch(
        ragged.ragged_kernel(splat.SplatConfig(PLAIN, views.model, "range", False)),
        dim=(5, ragged.LANES),
        inputs=[*views.arrays, upload(points, wp.vec3f, "cpu"), *clouds_on, 0],
        outputs=[keys, counts],
        device=cpu,
    )
    wp.launch(
        ragged.resolve_kernel(frozenset(ALL)),
        dim=(5, 150),
        inputs=[keys],
        outputs=[*outputs, counts],
        device=cpu,
    )
    for v, expected in enumerate(maps_of(cameras, clouds, cloud_of, "cpu")):
        for name, array in zip(ALL, outputs, strict=True):
            np.testing.assert_array_equal(array.numpy()[v], getattr(expected, name).ravel())
        s = expected.stats
        assert counts.numpy()[v].tolist() == [
            *(s.not_finite, s.behind, s.outside, s.too_far, s.too_near, s.drawn, s.total)
        ]


def test_numbers_on_the_device_are_bounded(device):
    """Offsets beyond the points or falling, clouds that there are not: nothing else is read."""
    points = clouds_of(5, [600])[0]
    offsets = np.array([-7, 200, 100, 2**31 - 1, -(2**31), 300], np.int32)
    cloud_of = np.array([0, 1, 2, 3, 4, 5, -1, 2**31 - 1, -(2**31)], np.int32)
    cameras = turned(dw.PinholeCamera.from_fov((70, 60), (15, 10)), len(cloud_of))
    renderer = dw.Renderer(cameras, max_points=600, device=device)
    renderer.render(
        upload(points, wp.vec3f, device),
        offsets=upload(offsets, wp.int32, device),
        cloud_of=upload(cloud_of, wp.int32, device),
    )
    for depth_map, camera, cloud in zip(renderer.depth_maps(), cameras, cloud_of, strict=True):
        begin, end = 0, 0
        if 0 <= cloud < 5:
            begin = int(np.clip(offsets[cloud], 0, 600))
            end = int(np.clip(offsets[cloud + 1], begin, 600))
        alone = dw.PointCloud(points[begin:end])
        assert_same(depth_map, dw.render(alone, camera, device=device))


def test_only_what_is_asked_for_is_there(device):
    """Depth alone: no other map is allocated, and the depth is the same."""
    cameras = turned(dw.PinholeCamera.from_fov((70, 60), (30, 20)), 3)
    points, offsets = joined(clouds_of(6, [400, 10, 300]))
    views = [ViewPlan(camera) for camera in cameras]
    plan = RaggedPlan(views, RenderConfig(), ("depth",), resolve_device(device))
    assert plan.maps.index is None and plan.maps.state is None
    renderer = dw.Renderer(cameras, max_points=1000, outputs=("depth",), device=device)
    maps = renderer.render(upload(points, wp.vec3f, device), offsets=offsets)
    assert set(maps) == {"depth"}
    expected = [
        dw.render(dw.PointCloud(cloud), camera, device=device).depth
        for cloud, camera in zip(np.split(points, offsets[1:-1]), cameras, strict=True)
    ]
    np.testing.assert_array_equal(maps["depth"].numpy(), expected)
    with pytest.raises(InputError, match="ask for the outputs 'depth' and 'index'"):
        renderer.depth_maps()


def test_more_maps_than_memory(monkeypatch):
    """Refused in the first call, before anything is allocated."""
    camera = dw.PinholeCamera.from_fov((70, 60), (1 << 12, 1 << 12))
    renderer = dw.Renderer([camera] * 9, max_points=10, device="cpu")
    monkeypatch.setattr("depthwarp.devices.free_memory", lambda device: 1 << 30)
    with pytest.raises(CapacityError, match="9 depth maps of 4096 x 4096"):
        renderer.render(np.zeros((9, 3), np.float32), offsets=np.arange(10))


@pytest.mark.parametrize("static", [False, True])
@pytest.mark.parametrize(("size", "lanes"), [((15, 10), 1), ((120, 90), ragged.LANES)])
def test_the_launches_for_cuda(monkeypatch, size, lanes, static):
    """Small images in shared memory, large ones not: on the CPU they draw what its own do."""
    clouds, cpu = clouds_of(7, [300, 0, 257]), resolve_device("cpu")
    points, offsets = joined(clouds)
    views = [ViewPlan(camera) for camera in turned(dw.PinholeCamera.from_fov((70, 60), size), 3)]
    common = dw.PointCloud(clouds_of(8, [2000])[0]).prepare(device="cpu") if static else None
    on_device = [
        upload(points, wp.vec3f, "cpu"),
        upload(offsets, wp.int32, "cpu"),
        upload(np.arange(3), wp.int32, "cpu"),
    ]

    def drawn() -> list[dw.DepthMap]:
        plan = RaggedPlan(views, RenderConfig(), ALL, cpu, static=common)
        plan.render(*on_device)
        return plan.depth_maps()

    expected = drawn()
    monkeypatch.setattr(ragged_splatting, "LANES", lanes)  # on a CPU a block has one thread
    monkeypatch.setattr(ragged_splatting, "groups_of", lambda _: 4)
    monkeypatch.setattr(
        "depthwarp.rendering.ragged.CpuViews", lambda *of, **_: ragged_splatting.CudaViews(*of[:5])
    )
    for ours, theirs in zip(drawn(), expected, strict=True):
        assert (theirs.depth > 0).any() or not (static or theirs.stats.total)
        assert_same(ours, theirs)
