"""All cores: whatever the number of threads, the maps have the same bits and the same counts."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

import depthwarp as dw
from depthwarp import arrays
from depthwarp.devices import resolve_device
from depthwarp.rendering import RenderConfig, RenderPlan, ViewPlan, cpu_splatting
from depthwarp.rendering.cpu_splatting import LEAST_BLOCKS
from depthwarp_kernels.point_source import BLOCK
from tests.rendering.clumps import assert_same_map
from tests.rendering.test_prepared import room

CPU = resolve_device("cpu")
SHARED = LEAST_BLOCKS * BLOCK  # points from which one view is drawn by more than one thread
CONFIG = RenderConfig("range", 0.2, 6.0)


def with_ties(count: int) -> np.ndarray:
    """A room with points that are not finite, and each third point a copy of another one."""
    points = room(count, seed=count)
    rng = np.random.default_rng(count)
    points[::3] = points[rng.integers(0, max(count, 1), len(points[::3]))]
    points[rng.random(count) < 0.01, 2] = np.nan
    return points


def cameras(model: str, count: int) -> list[dw.Camera]:
    """Views of one size from inside the room."""
    poses = [
        dw.Pose.from_orientation((0.5 * np.cos(n), 0.4, 0.1 * n), (2, 5 * n, 110 * n))
        for n in range(count)
    ]
    if model == "pinhole":
        return [dw.PinholeCamera(40.0, 40.0, 30.0, 23.0, 61, 47, pose) for pose in poses]
    return [dw.EquirectangularCamera(64, 32, pose) for pose in poses]


def maps_of(source, views: list[dw.Camera], threads: int | None) -> list[dw.DepthMap]:
    """What a plan with so many threads draws."""
    plan = RenderPlan([ViewPlan(view) for view in views], CONFIG, CPU, threads=threads)
    plan.render(source)
    return plan.depth_maps()


def source_of(points: np.ndarray, prepared: bool):
    """A cloud as a plan takes it."""
    if prepared:
        return dw.PointCloud(points).prepare(device="cpu")
    return arrays.share_points(points, CPU)


@pytest.mark.parametrize("size", [0, 700, SHARED - 1, SHARED, SHARED + 1, 2 * SHARED + 300])
@pytest.mark.parametrize("prepared", [False, True], ids=["plain", "prepared"])
@pytest.mark.parametrize("count", [1, 2, 5])
def test_threads_do_not_change_a_bit(size, prepared, count):
    """1, 2, 3 and 7 threads, a view or several, below and above the size that is shared."""
    source = source_of(with_ties(size), prepared)
    views = cameras("pinhole", count)
    expected = maps_of(source, views, 1)
    assert size == 0 or sum(depth_map.stats.drawn for depth_map in expected) > 100
    for threads in (2, 3, 7):
        for ours, theirs in zip(maps_of(source, views, threads), expected, strict=True):
            assert_same_map(ours, theirs)


@pytest.mark.parametrize("prepared", [False, True], ids=["plain", "prepared"])
def test_threads_draw_what_single_points_give(prepared):
    """All threads together against the cloud drawn in pieces that no thread shares."""
    points = with_ties(SHARED + 1000)
    (view,) = cameras("panorama", 1)
    (ours,) = maps_of(source_of(points, prepared), [view], 3)
    small = BLOCK - 1  # never a whole block: all of it goes through the kernel for single points
    pieces = [points[first : first + small] for first in range(0, len(points), small)]
    plan = RenderPlan([ViewPlan(view)], CONFIG, CPU, threads=1)
    depth = np.full((32, 64), np.inf, np.float32)
    index = np.full((32, 64), -1, np.int32)
    for number, piece in enumerate(pieces):
        plan.render(arrays.share_points(np.ascontiguousarray(piece), CPU))
        (one,) = plan.depth_maps()
        nearer = (one.index >= 0) & (one.depth < depth)
        depth[nearer], index[nearer] = one.depth[nearer], one.index[nearer] + number * small
    np.testing.assert_array_equal(ours.index, index)
    np.testing.assert_array_equal(ours.depth, np.where(index >= 0, depth, 0))


def test_a_plan_is_used_again_and_again():
    """Large, small, empty and prepared clouds one after the other leave nothing behind."""
    views = cameras("pinhole", 2)
    plan = RenderPlan([ViewPlan(view) for view in views], CONFIG, CPU, threads=3)
    for size in (2 * SHARED, 40, 0, SHARED, 3 * BLOCK):
        for prepared in (True, False):
            source = source_of(with_ties(size), prepared)
            plan.render(source)
            for ours, theirs in zip(plan.depth_maps(), maps_of(source, views, 1), strict=True):
                assert_same_map(ours, theirs)


def test_plans_may_be_used_at_the_same_time():
    """Two plans in two threads of Python, with the same pool behind them, many times."""
    points = with_ties(SHARED + 5000)
    sources = [source_of(points, prepared) for prepared in (False, True)]
    views = cameras("pinhole", 1), cameras("panorama", 2)
    expected = [maps_of(source, view, 1) for source, view in zip(sources, views, strict=True)]

    def draw(job: int) -> list[dw.DepthMap]:
        return maps_of(sources[job % 2], views[job % 2], 3)

    with ThreadPoolExecutor(4) as pool:
        for job, maps in enumerate(pool.map(draw, range(16))):
            for ours, theirs in zip(maps, expected[job % 2], strict=True):
                assert_same_map(ours, theirs)


def test_a_cloud_may_be_prepared_in_many_threads():
    """Several calls of `prepare` at the same time give what one gives."""
    points = with_ties(30_000)
    alone = dw.PointCloud(points).prepare(device="cpu")

    with ThreadPoolExecutor(4) as pool:
        jobs = [pool.submit(dw.PointCloud(points).prepare, device="cpu") for _ in range(8)]
        for job in jobs:
            together = job.result()
            for name in ("x", "y", "z", "original"):
                np.testing.assert_array_equal(
                    getattr(together.source, name).numpy()[: alone.finite],
                    getattr(alone.source, name).numpy()[: alone.finite],
                )


def drawn_in(cloud: dw.PointCloud) -> int:
    """Points that a view of all threads shows."""
    (depth_map,) = maps_of(source_of(cloud.points_world, False), cameras("pinhole", 1), 3)
    return depth_map.stats.drawn


def exit_alike(cloud: dw.PointCloud, drawn: int) -> None:
    """End this process with 0 if it draws as many points."""
    os._exit(0 if drawn_in(cloud) == drawn else 1)


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork here")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_process_has_threads_of_its_own():
    """After a render a fork, as loaders of training data make it, can render too."""
    cloud = dw.PointCloud(with_ties(SHARED + 10))
    drawn = drawn_in(cloud)
    child = multiprocessing.get_context("fork").Process(target=exit_alike, args=(cloud, drawn))
    child.start()
    child.join(30)
    ended = child.exitcode
    child.kill()
    assert ended == 0, "None: it waits for threads that it does not have"


Z_BUFFER_BYTES = 8  # a pixel
OUTPUT_BYTES = 4 + 4 + 1  # depth, index, state


@pytest.mark.skipif(
    not os.access("/proc/self/clear_refs", os.W_OK), reason="the system tells no peak of memory"
)
@pytest.mark.parametrize("kind", ["plain", "prepared"])
def test_memory_beside_the_cloud_is_two_z_buffers_a_thread_and_the_outputs(kind):
    """Measured by the system in a process of its own: Warp's memory, NumPy's and all else."""
    side, threads, points = 1500, 2, 100_000
    folder = Path(__file__).resolve().parents[2]
    command = [sys.executable, "-m", "tests.rendering.peak_memory", kind]
    done = subprocess.run(
        [*command, *map(str, (side, threads, points))],
        cwd=folder,
        capture_output=True,
        text=True,
        check=True,
        timeout=120,
    )
    bytes_a_pixel = int(done.stdout) / side**2
    assert bytes_a_pixel < 2 * threads * Z_BUFFER_BYTES + OUTPUT_BYTES
    assert bytes_a_pixel > threads * Z_BUFFER_BYTES  # it does measure


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize("with_index", [True, False])
def test_nothing_is_left_of_the_drawing_before(count, with_index):
    """A plan draws a large cloud, a small one, none, a large one: as plans that draw one each."""
    views = [ViewPlan(view) for view in cameras("pinhole", count)]
    plan = RenderPlan(views, CONFIG, CPU, with_index=with_index, threads=2)
    for size in (2 * SHARED, 700, 0, 2 * SHARED + 1):
        source = source_of(with_ties(size), prepared=True)
        alone = RenderPlan(views, CONFIG, CPU, with_index=with_index, threads=1)
        for drawing in (plan, alone):
            drawing.render(source)
        np.testing.assert_array_equal(plan.maps.depth.numpy(), alone.maps.depth.numpy())
        assert plan.stats() == alone.stats()


def test_few_blocks_are_drawn_into_the_buffer_that_is_read(monkeypatch):
    """Few but dense enough to ask what is hidden, whichever thread is the first to take a part."""
    small = source_of(with_ties(100_000), prepared=True)
    assert small.blocks < LEAST_BLOCKS
    views = [ViewPlan(view) for view in cameras("pinhole", 2)]
    plan = RenderPlan(views, CONFIG, CPU, threads=3)
    alone = RenderPlan(views, CONFIG, CPU, threads=1)

    def last_first(work, threads: int) -> None:
        for thread in reversed(range(threads)):
            work(thread)

    monkeypatch.setattr(cpu_splatting, "share", last_first)
    plan.render(small)
    alone.render(small)
    for ours, theirs in zip(plan.depth_maps(), alone.depth_maps(), strict=True):
        assert theirs.stats.drawn > 100
        assert_same_map(ours, theirs)


@pytest.mark.parametrize("broken", ["_cull", "_draw_blocks", "_resolve"])
@pytest.mark.parametrize("count", [1, 5])
def test_a_failure_reaches_the_caller_and_leaves_nothing(monkeypatch, broken, count):
    """Of one thread among three: no wait without end, and the next map is as of a new plan."""
    source = source_of(with_ties(2 * SHARED), prepared=True)
    pose = dw.Pose.from_orientation((0.5, 0.4, 0), (2, 0, 110))
    views = [dw.PinholeCamera(200.0, 200.0, 159.5, 119.5, 320, 240, pose)] * count
    plan = RenderPlan([ViewPlan(view) for view in views], CONFIG, CPU, threads=3)
    plan.render(source)
    right = getattr(cpu_splatting.CpuSplatter, broken)
    calls = iter(range(10**6))

    def once(self, *arguments):
        if next(calls) == 1:
            raise OSError("broken")
        return right(self, *arguments)

    with monkeypatch.context() as patched:
        patched.setattr(cpu_splatting.CpuSplatter, broken, once)
        with pytest.raises(OSError, match="broken"):
            plan.render(source)
    smaller = source_of(with_ties(SHARED + 10), prepared=True)
    plan.render(smaller)
    for ours, theirs in zip(plan.depth_maps(), maps_of(smaller, views, 1), strict=True):
        assert_same_map(ours, theirs)
