"""Any number of views in turn: each as it would be alone, in the memory of a tile."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

import depthwarp as dw
from depthwarp.errors import InputError
from depthwarp.rendering import tiles


def cloud_of(seed: int, count: int = 500) -> dw.PointCloud:
    """Points all round the origin."""
    points = np.random.default_rng(seed).uniform(-5, 5, (count, 3))
    return dw.PointCloud(points.astype(np.float32))


def turning(lens: dw.Camera, count: int) -> Iterator[dw.Camera]:
    """The same lens in many directions, from a generator."""
    for n in range(count):
        yield lens.with_pose(dw.Pose.from_orientation((0.01 * n, 0, 0), (0, n % 7, 37 * n)))


def assert_same(ours: dw.DepthMap, theirs: dw.DepthMap) -> None:
    """All of two maps is the same, bit for bit."""
    for name in ("depth", "index", "state"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
    assert ours.stats == theirs.stats and ours.camera == theirs.camera


@pytest.fixture
def small_tiles(monkeypatch):
    """Tiles of 20 images of 16 x 12 pixels."""
    monkeypatch.setattr(tiles, "TILE_BYTES", 20 * 16 * 12 * tiles.MAP_BYTES)


@pytest.fixture
def plans_made(monkeypatch) -> list[str]:
    """The names of the plans that are made, in order."""
    made: list[str] = []

    def counting(plan):
        def make(*arguments):
            made.append(plan.__name__)
            return plan(*arguments)

        return make

    for name in ("RenderPlan", "RaggedPlan"):
        monkeypatch.setattr(tiles, name, counting(getattr(tiles, name)))
    return made


LENS = dw.PinholeCamera.from_fov((80, 60), (16, 12))


@pytest.mark.parametrize("prepared", [False, True])
def test_each_map_is_its_view_alone(device, small_tiles, plans_made, prepared):
    """Several tiles from a generator, the last one smaller; one plan for all full tiles."""
    cloud = cloud_of(1)
    source = cloud.prepare(device=device) if prepared else cloud
    options = {"filters": dw.filters.paper(), "max_range": 6.0, "device": device}
    maps = list(dw.render_stream(source, turning(LENS, 70), **options))
    assert plans_made == (["RenderPlan"] * 2 if prepared else ["RaggedPlan"] + ["RenderPlan"])
    assert len(maps) == 70
    for depth_map, camera in zip(maps, turning(LENS, 70), strict=True):
        assert_same(depth_map, dw.render(cloud, camera, **options))


def test_lenses_and_clouds_in_turn(device, small_tiles, plans_made, monkeypatch):
    """A rig of two sizes, small clouds and large ones: in order, each kind with its plan."""
    monkeypatch.setattr(tiles, "SMALL_CLOUD", 500)
    wide = dw.PinholeCamera.from_fov((100, 60), (8, 6))
    cameras = [
        view for pair in zip(turning(LENS, 60), turning(wide, 60), strict=True) for view in pair
    ]
    large = cloud_of(9, 600)
    clouds = [large if n % 30 == 7 else cloud_of(n, 11 * (n % 5)) for n in range(120)]
    maps = list(dw.render_stream(iter(clouds), iter(cameras), device=device))
    assert plans_made.count("RaggedPlan") <= 4
    for depth_map, cloud, camera in zip(maps, clouds, cameras, strict=True):
        assert_same(depth_map, dw.render(cloud, camera, device=device))
        assert depth_map.stats.total == len(cloud)


def test_large_clouds_come_one_by_one(small_tiles, monkeypatch):
    """Of clouds that fill a tile each, no more than one is taken before a map is there."""
    monkeypatch.setattr(tiles, "SMALL_CLOUD", 10)
    taken = []

    def clouds() -> Iterator[dw.PointCloud]:
        for n in range(4):
            taken.append(n)
            yield cloud_of(n, 6000)

    for n, depth_map in enumerate(dw.render_stream(clouds(), turning(LENS, 4), device="cpu")):
        assert len(taken) <= n + 2 and depth_map.stats.total == 6000


def test_range_views_of_small_clouds(device):
    """The paper's segmentation, many views together."""
    views = [
        dw.RangeView((0, 0, 0), (0, 0, 20 * n), (60, 50), 0.5, 0.5, depth_plane=5.0)
        for n in range(17)
    ]
    cloud = cloud_of(3)
    for depth_map, view in zip(dw.render_stream(cloud, views, device=device), views, strict=True):
        assert_same(depth_map, dw.render(cloud, view, device=device))


@pytest.mark.parametrize("prepared", [False, True])
def test_an_endless_stream(small_tiles, prepared):
    """Maps come before the cameras end, and are the caller's: later ones do not change them."""
    cameras = itertools.chain(turning(LENS, 60), itertools.repeat(LENS))
    source = cloud_of(1).prepare(device="cpu") if prepared else cloud_of(1)
    stream = dw.render_stream(source, cameras, device="cpu")
    kept = [next(stream) for _ in range(60)][7]
    assert_same(kept, dw.render(cloud_of(1), kept.camera, device="cpu"))
    assert kept.depth.base is None and kept.depth.any()


def resident() -> int:
    """Memory of this process [bytes]."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) * 1024
    raise LookupError("VmRSS")


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="measures memory in /proc")
@pytest.mark.parametrize("prepared", [False, True])
def test_memory_does_not_grow(prepared):
    """Ten tiles of views take no more than two; kept, their maps would take 200 MB more."""
    lens = dw.PinholeCamera.from_fov((80, 60), (400, 400))
    a_tile = tiles.TILE_BYTES // (400 * 400 * tiles.MAP_BYTES)
    cloud = cloud_of(2, 2000)
    source = cloud.prepare(device="cpu") if prepared else cloud
    most = []
    for views in (2 * a_tile, 2 * a_tile, 10 * a_tile):  # the first warms the allocator up
        stream = dw.render_stream(source, turning(lens, views), device="cpu")
        most.append(max(resident() for _ in stream))
    assert 8 * a_tile * 400 * 400 * 9 > 200e6
    assert most[2] - most[1] < 30e6


def test_what_a_stream_refuses():
    """Settings at once; cameras and clouds when they are reached, by number."""
    cloud = cloud_of(1, 10)
    with pytest.raises(InputError, match="min_range"):
        dw.render_stream(cloud, [LENS], min_range=-1.0)
    with pytest.raises(InputError, match=r"got one PinholeCamera: \[camera\]"):
        dw.render_stream(cloud, LENS)
    with pytest.raises(InputError, match="got NoneType: dw.PointCloud"):
        dw.render_stream(None, [LENS])
    for clouds, cameras, message in [
        (cloud, [LENS, "camera"], r"cameras\[1\]: .*got str"),
        ([cloud], [LENS, LENS], "1 clouds and more cameras"),
        ([cloud] * 3, [LENS, LENS], "more clouds than the 2 cameras"),
        ([cloud, None], [LENS, LENS], r"clouds\[1\] must be a PointCloud, got NoneType"),
    ]:
        with pytest.raises(InputError, match=message):
            list(dw.render_stream(clouds, cameras, device="cpu"))
    assert list(dw.render_stream(cloud, [], device="cpu")) == []
