"""Prepared clouds: whatever the cloud and the camera, the maps are those of the cloud itself."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.errors import CapacityError, DeviceError, InputError
from depthwarp.rendering import RenderConfig
from depthwarp.rendering.cuda_splatting import CudaSplatter
from depthwarp.rendering.views import DeviceViews
from depthwarp_kernels.point_source import BLOCK
from depthwarp_kernels.splat import COUNT_COLUMNS
from tests.cameras.models import IDENTITY, MODELS, cameras_of
from tests.rendering.clumps import SIZES, assert_same_map, clumps
from tests.rendering.strategies import seeds

MODEL_NAMES = list(MODELS)
WITH_Z = ["pinhole", "fisheye"]


def assert_prepared_is_plain(points: np.ndarray, camera: dw.Camera, device: str, **options) -> None:
    """Both ways of drawing a cloud give one map."""
    cloud = dw.PointCloud(points)
    chunks = cloud.prepare(device=device)
    ours = dw.render(chunks, camera, device=device, **options)
    assert_same_map(ours, dw.render(cloud, camera, device=device, **options))
    assert ours.stats.total == len(points)


def room(count: int, seed: int = 0) -> np.ndarray:
    """Points on the walls of a room of 8 m x 6 m x 3 m about the origin, shuffled."""
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.5, 0.5, (count, 3))
    axis = rng.integers(0, 3, count)
    points[np.arange(count), axis] = rng.choice([-0.5, 0.5], count)
    return (points * (8, 6, 3)).astype(np.float32)


# --- one result ---


@pytest.mark.parametrize(
    ("model", "kind"), [(m, "range") for m in MODEL_NAMES] + [(m, "z") for m in WITH_Z]
)
@settings(max_examples=15)
@given(data=st.data())
def test_a_prepared_cloud_renders_as_the_cloud(device, model, kind, data):
    """Any model, lens, pose and bounds; clumps ahead, behind, around, tiny, huge, not finite."""
    camera = data.draw(cameras_of(model))
    points = data.draw(clumps(camera.pose))
    near = data.draw(st.sampled_from([0.0, 0.0, 0.3, 1e6]))
    far = data.draw(st.sampled_from([15.0, math.inf, 2.0]))
    if not near < far:
        far = math.inf
    assert_prepared_is_plain(points, camera, device, depth=kind, min_range=near, max_range=far)


@pytest.mark.parametrize("size", [*SIZES, 20_000])
def test_any_number_of_points(device, size):
    """From none to many: one more or less than a block, the last block whole or not."""
    points = room(size)
    camera = dw.PinholeCamera.from_fov((90, 70), (40, 30), (0.5, 0.2, 0.1), (3, 4, 30))
    assert_prepared_is_plain(points, camera, device)
    assert len(dw.PointCloud(points).prepare(device=device)) == size


@pytest.mark.parametrize("where", ["first", "last", "all", "scattered"])
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_points_that_are_not_finite(device, value, where):
    """They are counted, drawn nowhere and shift no index, wherever they stand."""
    points = room(1500)
    rows = {
        "first": slice(0, 600),
        "last": slice(-600, None),
        "all": slice(None),
        "scattered": np.random.default_rng(1).random(1500) < 0.5,
    }[where]
    points[rows, 1] = value
    camera = dw.EquirectangularCamera.looking((60, 30))
    assert_prepared_is_plain(points, camera, device)
    chunks = dw.PointCloud(points).prepare(device=device)
    lost = 1500 - np.isfinite(points[:, 1]).sum()
    assert dw.render(chunks, camera, device=device).stats.not_finite == lost
    assert chunks.blocks == -(-(1500 - lost) // BLOCK)


@pytest.mark.parametrize("axes", [(), (0,), (1,), (2,), (0, 1), (1, 2), (0, 1, 2)])
@pytest.mark.parametrize("value", [0.0, -0.0, 1.5, 1e-42])
def test_flat_clouds(device, axes, value):
    """All of one value on some axes: a plane, a line, one point; the side of the extent is 0."""
    points = np.abs(room(1100)) + np.float32(0.5)
    points[:, list(axes)] = value
    camera = dw.PinholeCamera.from_fov((90, 90), (30, 30), (-0.5, 0, 0), (0, -20, 30))
    assert_prepared_is_plain(points, camera, device)


@pytest.mark.parametrize("scale", [1e-44, 1e-30, 1e-15, 1e4, 1e18, 1e25, 3e37])
@pytest.mark.parametrize("model", ["pinhole", "fisheye", "double_sphere", "equirectangular"])
@pytest.mark.parametrize("turn", [0, 90, 180])
def test_scales_at_the_ends_of_the_numbers(device, model, scale, turn):
    """Clouds whose squares are 0 or infinite: they count as they do one by one."""
    with np.errstate(under="ignore"):
        points = (room(1100) * np.float32(scale)).astype(np.float32)
    points[:, 0] += np.float32(2 * scale)
    pose = dw.Pose.from_orientation((0, 0, 0), (10, 20, turn))
    camera = MODELS[model](np.random.default_rng(3), pose, 24)
    for kind in camera.depth_kinds:
        for far in (15.0, math.inf):
            assert_prepared_is_plain(points, camera, device, max_range=far, depth=kind)


@pytest.mark.parametrize("distance", [3e18, 1e20, 1e30])
@pytest.mark.parametrize(
    "model", ["pinhole", "brown", "fisheye", "double_sphere", "equirectangular", "cylindrical"]
)
def test_small_blocks_so_far_away_that_squares_overflow(device, model, distance):
    """What a lens makes of such points, a pixel or none, it makes of them in blocks too."""
    rng = np.random.default_rng(17)
    ways = rng.normal(size=(40, 1, 3))
    ways /= np.linalg.norm(ways, axis=2, keepdims=True)
    blocks = distance * (ways + 1e-3 * rng.uniform(-1, 1, (40, BLOCK, 3)))
    for _ in range(2):
        camera = MODELS[model](rng, IDENTITY, 24)
        points = blocks.reshape(-1, 3).astype(np.float32)
        assert_prepared_is_plain(points, camera, device, max_range=math.inf)


def test_points_that_overflow_in_the_camera_frame(device):
    """Finite in the world, not in the camera frame: counted as not finite, not as behind."""
    rng = np.random.default_rng(5)
    points = rng.uniform(-1, 1, (1024, 3)).astype(np.float32) * np.float32(3.3e38)
    for orientation in ((0, 0, 0), (0, 0, 180), (40, 30, 20), (0, 45, 135)):
        camera = dw.PinholeCamera.from_fov((60, 60), (8, 8), (0, 0, 0), orientation)
        assert_prepared_is_plain(points, camera, device, max_range=math.inf)
        panorama = dw.EquirectangularCamera.looking(
            (8, 8), orientation=orientation, elevations=(20, 60)
        )
        assert_prepared_is_plain(points, panorama, device, max_range=math.inf)


@pytest.mark.parametrize("offset", [1e3, 5e5, 1e7])
def test_far_offsets(device, offset):
    """A room at map coordinates and the camera in it: rounding moves points, and loses none."""
    shift = np.array([offset, -0.7 * offset, 0.1 * offset], np.float32)
    points = room(4000) + shift
    for yaw in range(0, 360, 45):
        camera = dw.PinholeCamera.from_fov((40, 30), (64, 48), shift + np.float32(0.3), (2, 5, yaw))
        assert_prepared_is_plain(points, camera, device, max_range=100.0)


@settings(max_examples=15)
@given(seed=seeds, copies=st.integers(2, 1200))
def test_the_lowest_row_of_the_caller_wins_a_tie(seed, copies):
    """Duplicates lie anywhere in the cloud and in its blocks: the caller's first is drawn."""
    rng = np.random.default_rng(seed)
    points = room(1400, seed)
    same = np.sort(rng.choice(1400, copies, replace=False))
    points[same] = (0.5, 0.01, 0.01)  # in front of all others
    camera = dw.PinholeCamera.from_fov((60, 60), (5, 5))
    depth_map = dw.render(dw.PointCloud(points).prepare(device="cpu"), camera, device="cpu")
    assert depth_map.index[2, 2] == same[0]
    assert_prepared_is_plain(points, camera, "cpu")


# --- everywhere a cloud goes ---


@pytest.mark.parametrize("model", ["pinhole", "equirectangular"])
def test_filters_see_the_same_map(device, model):
    """The paper's filters after the splat of a prepared cloud."""
    camera = MODELS[model](
        np.random.default_rng(2), dw.Pose.from_orientation((0, 0, 0), (0,) * 3), 60
    )
    camera = dataclasses.replace(camera, width=60, height=40)
    assert_prepared_is_plain(room(6000), camera, device, filters=dw.filters.paper())


def test_a_cloud_is_prepared_once_and_rendered_many_times(device):
    """Neither the order of the views nor what was drawn before leaves a trace."""
    cloud = dw.PointCloud(room(5000))
    chunks = cloud.prepare(device=device)
    cameras = [
        dw.PinholeCamera.from_fov((70, 50), (32, 24), (1, 0.5, 0), (0, 0, yaw))
        for yaw in (0, 120, 240, 0, 120)
    ]
    maps = [dw.render(chunks, camera, device=device) for camera in cameras]
    assert_same_map(maps[0], maps[3])
    assert_same_map(maps[1], maps[4])
    for depth_map, camera in zip(maps, cameras, strict=True):
        assert_same_map(depth_map, dw.render(cloud, camera, device=device))


def test_the_blocks_are_a_copy(device):
    """What becomes of the cloud's memory afterwards does not matter."""
    points = room(3000)
    cloud = dw.PointCloud(points)
    chunks = cloud.prepare(device=device)
    camera = dw.EquirectangularCamera.looking((36, 18))
    expected = dw.render(dw.PointCloud(points.copy()), camera, device=device)
    points[:] = 0.0
    assert_same_map(dw.render(chunks, camera, device=device), expected)


def test_a_batch_may_mix_prepared_and_plain_clouds(device):
    """Each view has the bits of its own render, whichever kind its cloud is."""
    first, second = dw.PointCloud(room(3000, 1)), dw.PointCloud(room(700, 2))
    chunks = first.prepare(device=device)
    clouds = [first, chunks, second.prepare(device=device), chunks, second]
    cameras = [
        dw.PinholeCamera.from_fov((80, 60), (16, 12), orientation=(0, 0, 70 * n)) for n in range(5)
    ]
    plain = [first, first, second, first, second]
    maps = dw.render_batch(clouds, cameras, device=device)
    for depth_map, cloud, camera in zip(maps, plain, cameras, strict=True):
        assert_same_map(depth_map, dw.render(cloud, camera, device=device))


def test_the_camera_of_a_range_view_sees_a_prepared_cloud(device):
    """What the message recommends in place of a range view: its camera."""
    cloud = dw.PointCloud(room(3000))
    camera = dw.RangeView((0, 0, 0), (0, 0, 30), (60, 50), 0.1, 0.2).camera(cloud, device=device)
    assert_prepared_is_plain(cloud.points_world, camera, device)
    assert dw.render(cloud.prepare(device=device), camera, device=device).stats.drawn > 0


def cuda_splatter(views: DeviceViews, config: RenderConfig) -> CudaSplatter:
    """What a plan makes on CUDA, here on the CPU."""
    width, height = views.size
    keys = wp.empty((views.count, width * height), dtype=wp.uint64, device="cpu")
    counts = wp.empty((views.count, COUNT_COLUMNS), dtype=wp.int64, device="cpu")
    return CudaSplatter(views, config.depth, keys, counts, groups=5)


@pytest.mark.parametrize("model", MODEL_NAMES)
def test_a_plan_with_the_splat_for_cuda(monkeypatch, model):
    """Its kernels run on a CPU too, and draw the same maps with the same counts."""
    rng = np.random.default_rng(19)
    cloud = dw.PointCloud(np.concatenate([room(3000), room(700) * np.float32(1e19)]))
    chunks = cloud.prepare(device="cpu")
    for _ in range(3):
        pose = dw.Pose.from_orientation(rng.uniform(-1, 1, 3), rng.uniform(-180, 180, 3))
        camera = MODELS[model](rng, pose, 40)
        expected = dw.render(cloud, camera, device="cpu")
        with monkeypatch.context() as patch:
            patch.setattr(
                "depthwarp.rendering.plan.splatter_of",
                lambda views, config, device, **how: cuda_splatter(views, config),
            )
            assert_same_map(dw.render(chunks, camera, device="cpu"), expected)


# --- refusals ---


def test_a_range_view_of_a_prepared_cloud_is_refused():
    """It takes its depth plane from the cloud; the message says what to do."""
    chunks = dw.PointCloud(room(700)).prepare(device="cpu")
    view = dw.RangeView((0, 0, 0), (0, 0, 0), (60, 50), 0.1, 0.5)
    for call in (
        lambda: dw.render(chunks, view, device="cpu"),
        lambda: dw.render_batch(chunks, [view], device="cpu"),
    ):
        with pytest.raises(InputError, match=r"view\.camera\(cloud\)"):
            call()


def test_an_unknown_device_is_refused():
    """Before anything is computed, with the devices that there are."""
    with pytest.raises(DeviceError, match="cpu"):
        dw.PointCloud(room(3)).prepare(device="cuda:77")


def test_a_cloud_on_another_device_is_refused(monkeypatch):
    """The message names both devices and the call that helps."""
    chunks = dw.PointCloud(room(700)).prepare(device="cpu")

    class Elsewhere:
        alias = "cuda:1"

    monkeypatch.setattr(chunks, "device", Elsewhere())
    with pytest.raises(InputError, match=r"cuda:1.*prepare\(device='cpu'\)"):
        dw.render(chunks, dw.PinholeCamera.from_fov((60, 60), (4, 4)), device="cpu")


def test_a_cloud_that_does_not_fit_is_refused(monkeypatch):
    """Before the first allocation, with what is needed and what is free."""
    monkeypatch.setattr("depthwarp.devices.free_memory", lambda device: 1000)
    with pytest.raises(CapacityError, match="in parts"):
        dw.PointCloud(room(700)).prepare(device="cpu")


# --- blocks ---


def assert_blocks_hold(points: np.ndarray) -> None:
    """Every finite row once, with its bits; each sphere holds its block's points."""
    chunks = dw.PointCloud(points).prepare(device="cpu")
    x, y, z, rows = (
        array.numpy()[: chunks.finite]
        for array in (chunks.source.x, chunks.source.y, chunks.source.z, chunks.source.original)
    )
    finite = np.flatnonzero(np.isfinite(points).all(axis=1))
    np.testing.assert_array_equal(np.sort(rows), finite)
    held = np.stack([x, y, z], axis=1)
    np.testing.assert_array_equal(held.view(np.uint32), points[rows].view(np.uint32))
    spheres = chunks.source.spheres.numpy().astype(np.float64)
    assert len(spheres) == chunks.blocks
    for block, (*center, radius) in enumerate(spheres):
        part = held[block * BLOCK : (block + 1) * BLOCK].astype(np.float64)
        away = np.sqrt(((part - center) ** 2).sum(axis=1)).max()
        # Squares of less than 1e-19 m are 0 in float32; culling adds more than that.
        assert away <= radius + 1e-18


@settings(max_examples=20)
@given(data=st.data())
def test_blocks_hold_the_cloud_and_their_spheres_hold_them(data):
    """Whatever the cloud: none of its points is lost, doubled or outside of its sphere."""
    assert_blocks_hold(data.draw(clumps(IDENTITY)))


@pytest.mark.parametrize("size", [2, 512, 513, 1500])
def test_spheres_reach_to_both_ends_of_a_line(size):
    """On a line the first and the last point of a block decide on its sphere."""
    assert_blocks_hold(np.linspace(0, 9, size, dtype=np.float32)[:, None] * np.ones(3, np.float32))


def test_blocks_are_compact():
    """In spatial order a block of a room covers a small part of it: that is what culling needs."""
    chunks = dw.PointCloud(room(100_000)).prepare(device="cpu")
    radii = chunks.source.spheres.numpy()[:, 3]
    assert np.median(radii) < 1.0 and chunks.blocks == 196


def test_what_fills_up_the_last_block_is_not_finite():
    """Kernels that read a block to its end draw nothing behind the cloud's last point."""
    chunks = dw.PointCloud(room(513)).prepare(device="cpu")
    assert chunks.source.x.shape == (2 * BLOCK,)
    for axis in (chunks.source.x, chunks.source.y, chunks.source.z):
        assert np.isnan(axis.numpy()[513:]).all() and np.isfinite(axis.numpy()[:513]).all()


def test_preparing_uses_all_cores_alike(monkeypatch):
    """The same blocks whatever number of threads prepares them."""
    made = []
    for cores in (1, 2, 5):
        monkeypatch.setattr("depthwarp.prepared.launching.usable_cores", lambda cores=cores: cores)
        made.append(dw.PointCloud(room(5120)).prepare(device="cpu").source)
    for other in made[1:]:
        np.testing.assert_array_equal(other.x.numpy(), made[0].x.numpy())
        np.testing.assert_array_equal(other.original.numpy(), made[0].original.numpy())
        np.testing.assert_array_equal(other.spheres.numpy(), made[0].spheres.numpy())


def test_it_says_what_it_is():
    """`len` and `repr`, with the points that are not finite."""
    points = room(1030)
    points[7] = np.nan
    chunks = dw.PointCloud(points).prepare(device="cpu")
    assert len(chunks) == 1030
    assert repr(chunks) == "PreparedCloud(1030 points in 3 blocks, 12.0 bytes a point, on cpu)"
    assert chunks.device == wp.get_device("cpu")
