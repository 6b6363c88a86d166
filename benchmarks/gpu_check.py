"""The day a GPU is at hand: are its bits those of a CPU, and how far is it from its limits?

`python -m benchmarks.gpu_check --json FILE` first compares every lens model, prepared clouds,
filters, z depth, range views and a replayed graph with the CPU, then times what batch rendering and
simulation do. Every result is a JSON line, written at once, so that a run that breaks off leaves
what it found; with machine and versions. Sizes shrink to the memory that is free, and what does not
fit the time is left out and said so. Exit 1 where a bit differs.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp

import depthwarp as dw
from benchmarks.measure import machine, run_once
from benchmarks.same_bits import compare, poses_inside
from benchmarks.scenes import RoomScene
from depthwarp.cli.report import quiet_warp
from depthwarp.devices import free_memory, resolve_device
from depthwarp.errors import DeviceError

REPEATS = 7
LEAST_RUN_S = 0.02
"""A timed run repeats its work until it lasts about as long."""

BYTES_A_POINT = 12
DEVICE_BYTES_A_POINT = 80  # a prepared cloud while it is made, and a plain one beside it
HOST_BYTES_A_POINT = 120  # random numbers, the cloud, and its copies in other orders
TARGETS = {
    "sorted": "at least 0.6 of the copy bandwidth",
    "prepared": "at least 3e11 points/s on an H200, with quantized points",
    "shuffled": "at least 2e10 points/s",
    "worlds": "at most 0.25 ms a step",
}


@dataclass(frozen=True)
class Sizes:
    """How much is done.

    Attributes:
        points: Points of the large cloud, at most.
        checked_points: Points of the cloud in which bits are compared.
        worlds: Small views of one step.
        copy_bytes: Size of the array whose copy measures the bandwidth, at most.
        limit_s: Seconds after which no new measurement is begun.
        models: Names of the lens models that are compared; None for all.
    """

    points: int = 100_000_000
    checked_points: int = 200_000
    worlds: int = 4096
    copy_bytes: int = 2 << 30
    limit_s: float = 400.0
    models: tuple[str, ...] | None = None


class Log:
    """JSON lines, one a result, on stdout and in a file."""

    def __init__(self, device: Any, file: Path | None) -> None:
        self._file, self._start = file, time.perf_counter()
        self.differences = 0
        self._about = {"benchmark": "gpu_check", "machine": machine() | _card(device)}

    def write(self, **result: Any) -> None:
        """Write a result."""
        date = datetime.now(UTC).isoformat(timespec="seconds")
        print(json.dumps(result), flush=True)
        if self._file is not None:
            with self._file.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps({**self._about, "date": date, **result}) + "\n")

    def spent_s(self) -> float:
        """Seconds since the start."""
        return time.perf_counter() - self._start


def _card(device: Any) -> dict[str, object]:
    if not device.is_cuda:
        return {"device": device.alias}
    return {
        "device": device.name,
        "architecture": device.arch,
        "multiprocessors": device.sm_count,
        "device_bytes": device.total_memory,
        "cuda_driver": wp.get_cuda_driver_version(),
        "cuda_toolkit": wp.get_cuda_toolkit_version(),
    }


def seconds(device: Any, run: Callable[[], Any]) -> tuple[float, float, float]:
    """Lower quartile, median and upper quartile of what one run takes, warm."""

    def several(times: int) -> float:
        def work() -> None:
            for _ in range(times):
                run()
            wp.synchronize_device(device)

        return run_once(work)[0]

    several(1)
    times = max(1, round(LEAST_RUN_S / max(several(1), 1e-6)))
    taken = np.percentile([several(times) / times for _ in range(REPEATS)], (25, 50, 75))
    return float(taken[0]), float(taken[1]), float(taken[2])


def replayed(device: Any, run: Callable[[], Any]) -> Callable[[], Any]:
    """A call that was run once, as a graph; on a CPU the call itself."""
    run()
    if not device.is_cuda:
        return run
    with wp.ScopedCapture(device=device) as capture:
        run()
    return lambda: wp.capture_launch(capture.graph)


def launches(device: Any, run: Callable[[], Any]) -> dict[str, float]:
    """Milliseconds of each kernel and memory operation of one call; none on a CPU."""
    if not device.is_cuda:
        return {}
    wp.timing_begin()
    run()
    spent: dict[str, float] = {}
    for result in wp.timing_end():
        spent[result.name] = spent.get(result.name, 0.0) + result.elapsed
    return spent


def first_call(log: Log, device: Any) -> None:
    """A first image of few points: with an empty kernel cache, what compiling and loading take."""
    scene = RoomScene(1000)
    renderer = dw.Renderer([scene.camera()], max_points=1000, device=device.alias)
    cloud = wp.array(scene.points_world(), dtype=wp.vec3f, device=device)
    log.write(figure="first call", seconds=run_once(lambda: renderer.render(cloud))[0])


def copy_bandwidth(log: Log, device: Any, sizes: Sizes) -> float:
    """Bytes a second that a copy on the device reads and writes."""
    size = min(sizes.copy_bytes, free_memory(device) // 8)
    source = wp.zeros(size // 4, dtype=wp.float32, device=device)
    target = wp.zeros_like(source)
    taken = seconds(device, lambda: wp.copy(target, source))
    log.write(figure="copy", bytes=size, seconds=taken, bytes_per_s=2 * size / taken[1])
    return 2 * size / taken[1]


def time_view(log: Log, device: Any, name: str, cloud: Any, count: int, bandwidth: float) -> None:
    """One view of a large cloud."""
    scene = RoomScene(count)
    renderer = dw.Renderer(
        [scene.camera()], max_points=count, max_range=scene.max_range_m, device=device.alias
    )
    taken = seconds(device, replayed(device, lambda: renderer.render(cloud)))
    log.write(
        figure=name,
        points=count,
        seconds=taken,
        points_per_s=count / taken[1],
        share_of_copy_bandwidth=BYTES_A_POINT * count / taken[1] / bandwidth,
        launches_ms=launches(device, lambda: renderer.render(cloud)),
        stats=dict(renderer.depth_maps()[0].stats),
        target=TARGETS[name],
    )


def time_large_cloud(log: Log, device: Any, sizes: Sizes, bandwidth: float) -> None:
    """A cloud in random order, prepared, and in the prepared order but as a plain array."""
    host = free_memory(wp.get_device("cpu")) // HOST_BYTES_A_POINT
    count = min(sizes.points, free_memory(device) // DEVICE_BYTES_A_POINT, host)
    points = RoomScene(count).points_world()
    shuffled = wp.array(points, dtype=wp.vec3f, device=device)
    time_view(log, device, "shuffled", shuffled, count, bandwidth)
    del shuffled
    start = time.perf_counter()
    prepared = dw.PointCloud(points).prepare(device=device.alias)
    wp.synchronize_device(device)
    log.write(figure="prepare", points=count, seconds=time.perf_counter() - start)
    time_view(log, device, "prepared", prepared, count, bandwidth)
    order = prepared.source.original.numpy()[:count]
    del prepared
    in_order = wp.array(points[order], dtype=wp.vec3f, device=device)
    time_view(log, device, "sorted", in_order, count, bandwidth)


def time_worlds(log: Log, device: Any, sizes: Sizes) -> None:
    """Many small views with new poses each step."""
    scene, side = RoomScene(4096), 64
    views = [dw.PinholeCamera.from_fov((90, 90), (side, side))] * sizes.worlds
    renderer = dw.Renderer(views, max_points=scene.point_count, device=device.alias)
    points = wp.array(scene.points_world(), dtype=wp.vec3f, device=device)
    poses = wp.array(poses_inside(sizes.worlds, 3), dtype=wp.mat44f, device=device)

    def step() -> None:
        renderer.render(points, poses)

    log.write(
        figure="worlds",
        views=sizes.worlds,
        pixels=side * side,
        points=scene.point_count,
        seconds=seconds(device, replayed(device, step)),
        not_replayed_s=seconds(device, step),
        launches_ms=launches(device, step),
        target=TARGETS["worlds"],
    )


def check(device: Any, sizes: Sizes, file: Path | None) -> int:
    """All of it; the number of bits, pixels and counts that differ."""
    log = Log(device, file)
    first_call(log, device)
    for name, differing in compare(device, sizes.checked_points, sizes.models):
        log.differences += differing
        log.write(check=name, differing=differing)
    bandwidth = copy_bandwidth(log, device, sizes)
    for name, measure in (
        ("worlds", lambda: time_worlds(log, device, sizes)),
        ("large cloud", lambda: time_large_cloud(log, device, sizes, bandwidth)),
    ):
        if log.spent_s() < sizes.limit_s:
            measure()
        else:
            log.write(figure=name, left_out=f"{log.spent_s():.0f} s are over")
    log.write(figure="whole run", seconds=log.spent_s(), differing=log.differences)
    return log.differences


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; 1 where a bit differs."""
    usual = Sizes()
    parser = argparse.ArgumentParser(prog="python -m benchmarks.gpu_check", description=__doc__)
    parser.add_argument("--device", default="cuda:0", help="default: %(default)s")
    parser.add_argument("--points", type=int, default=usual.points, help="default: %(default)s")
    parser.add_argument("--worlds", type=int, default=usual.worlds, help="default: %(default)s")
    parser.add_argument("--json", type=Path, metavar="FILE", help="append the results to FILE")
    options = parser.parse_args(arguments)
    sizes = Sizes(points=options.points, worlds=options.worlds)
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as kernel_cache:
        wp.config.kernel_cache_dir = kernel_cache  # empty: first calls compile
        quiet_warp()
        try:
            device = resolve_device(options.device)
        except DeviceError as error:
            parser.error(str(error))
        return 1 if check(device, sizes, options.json) else 0


if __name__ == "__main__":
    sys.exit(main())
