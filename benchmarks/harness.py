"""The harness: peers on scenes, checked pixel by pixel, then timed in turn."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import warp as wp
from rich.console import Console

from benchmarks.measure import alternate, machine, read_bandwidth, run_once
from benchmarks.memory import peak_memory
from benchmarks.peers import Float32Array, Peer, count_differing_pixels, installed_peers
from benchmarks.report import (
    Machine,
    Result,
    first_call_table,
    ratio_lines,
    records,
    result_table,
)
from benchmarks.scenes import RoomScene, Scene
from depthwarp.cli.report import quiet_warp
from depthwarp.devices import resolve_device, usable_cores

__all__ = [
    "VIEWS_A_LOOP",
    "DifferentImageError",
    "Settings",
    "empty_kernel_cache",
    "measure_peers",
    "run_scenes",
    "this_machine",
]

FIRST_CALL_POINTS = 1000
VIEWS_A_LOOP = 4
"""Views that are timed of a peer that draws one at a time."""

MAX_DIFFERING_SHARE = 2e-3
"""Of the pixels; rounding at pixel borders stays well below it, a wrong camera far above."""


class DifferentImageError(Exception):
    """A peer does not do the same work, so its time says nothing."""


@dataclass(frozen=True)
class Settings:
    """What is measured.

    Attributes:
        scenes: One table each.
        views: Of each scene.
        repeats: Timed runs of each peer.
        device: Where depthwarp renders.
        with_memory: Whether each peer also runs in a process of its own, for its peak memory.
    """

    scenes: Sequence[Scene]
    views: int = 1
    repeats: int = 7
    device: str = "cpu"
    with_memory: bool = True


@contextmanager
def empty_kernel_cache() -> Iterator[None]:
    """A kernel cache of its own, so that the first call of each kernel compiles it."""
    before = wp.config.kernel_cache_dir
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        wp.config.kernel_cache_dir = folder
        quiet_warp()
        try:
            yield
        finally:
            wp.config.kernel_cache_dir = before


def this_machine() -> Machine:
    """The machine, and how fast it reads memory."""
    return Machine(machine(), read_bandwidth(usable_cores()), read_bandwidth())


def run_scenes(settings: Settings, console: Console) -> list[dict[str, Any]]:
    """Measure all peers on all scenes.

    Args:
        settings: What to measure.
        console: Where the tables go.

    Returns:
        One record for each scene and peer, ready for JSON.

    Raises:
        DeviceError: The device is not on this machine.
        DifferentImageError: A peer draws another image.
    """
    resolve_device(settings.device)
    peers, left_out = installed_peers(settings.device)
    for line in left_out:
        console.print(line, soft_wrap=True)
    here = this_machine()
    here.print_to(console)

    console.print("\nFirst call, compiling included, no part of the figures below")
    first_call_s = [_first_call(peer) for peer in peers]
    console.print(first_call_table(peers, first_call_s))
    done = []
    for scene in settings.scenes:
        if scene.missing is not None:
            console.print(f"{scene.name} is left out: {scene.missing}\n", soft_wrap=True)
            continue
        points = scene.points_world()
        results = measure_peers(peers, scene, points, settings)
        _print_results(console, scene, len(points), results, settings, here)
        done += records(here, scene, settings.views, results, first_call_s, len(points))
    return done


def measure_peers(
    peers: Sequence[Peer], scene: Scene, points: Float32Array, settings: Settings
) -> list[Result]:
    """Peers on one scene: the same images first, then their times in turn, then their memory.

    Raises:
        DifferentImageError: A peer draws another image than the first.
    """
    cameras = scene.cameras(settings.views)
    shown = [_timed_views(peer, settings.views) for peer in peers]
    for peer, views in zip(peers, shown, strict=True):
        peer.prepare(points, [cameras[view] for view in views], scene.max_range_m)
        peer.run()  # warm-up, and the images that are compared
    differing = _differing_pixels(peers, shown)
    timings = alternate([peer.run for peer in peers], settings.repeats)
    memory: list[int | None] = [None] * len(peers)
    for number, peer in enumerate(peers):
        if settings.with_memory and peer.device == "cpu":
            few = [cameras[view] for view in shown[number]]
            memory[number] = peak_memory(peer.name, peer.device, points, few, scene.max_range_m)
    rows = zip(peers, map(len, shown), differing, timings, memory, strict=True)
    return [Result(*row) for row in rows]


def _timed_views(peer: Peer, views: int) -> range:
    """Which views a peer draws: all, or a few from all round where each is a call of its own."""
    return range(0, views, 1 if peer.is_batch else -(-views // VIEWS_A_LOOP))


def _differing_pixels(peers: Sequence[Peer], shown: Sequence[range]) -> list[int]:
    """Pixels in which each peer's images differ from the first peer's."""
    reference = peers[0].images()
    differing = []
    for peer, views in zip(peers, shown, strict=True):
        pairs = zip(peer.images(), [reference[view] for view in views], strict=True)
        pixels = [count_differing_pixels(image, other) for image, other in pairs]
        limit = MAX_DIFFERING_SHARE * reference[0].size
        if max(pixels) > limit:
            raise DifferentImageError(
                f"{peer.name} draws another image than {peers[0].name}: {max(pixels)} of "
                f"{reference[0].size} pixels differ, rounding explains at most {limit:.0f}"
            )
        differing.append(sum(pixels))
    return differing


def _first_call(peer: Peer) -> float:
    """Seconds of a first run on a small cloud: compiling and loading, with next to no work."""
    scene = RoomScene(FIRST_CALL_POINTS)
    peer.prepare(scene.points_world(), scene.cameras(1), scene.max_range_m)
    return run_once(peer.run)[0]


def _print_results(
    console: Console,
    scene: Scene,
    points: int,
    results: Sequence[Result],
    settings: Settings,
    here: Machine,
) -> None:
    width, height = scene.image_size
    order = scene.made_order if scene.order == "made" else scene.order
    console.print(
        f"{scene.name}: {points:,} points in {order} order, {settings.views} view"
        f"{'s' * (settings.views > 1)} of {width} x {height} pixels, median of {settings.repeats}",
        soft_wrap=True,
    )
    console.print(result_table(points, results, here.read_bytes_per_s))
    for line in ratio_lines(results):
        console.print(line, soft_wrap=True)
    console.print()
