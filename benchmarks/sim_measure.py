"""Measuring a scene of many worlds: the same images first, then times in turn, then memory."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import numpy as np
import warp as wp
from rich.console import Console

from benchmarks.harness import MAX_DIFFERING_SHARE, DifferentImageError
from benchmarks.measure import PAUSE_S, Timing, alternate, run_once
from benchmarks.peers import count_differing_pixels
from benchmarks.report import plain_table
from benchmarks.sim_memory import SteadyLoop, buffer_bytes, watch_steady_loop
from benchmarks.sim_peers import MAKERS, Float32Array, LeftOutError, Sensor, SimPeer
from benchmarks.sim_scene import SimScene

__all__ = ["Drawn", "FirstCall", "Measured", "first_calls", "measure_scene"]

RUN_S = 0.02
"""A timed run is so many steps that it lasts about so long."""

MOST_STEPS, LEAST_REPEATS, MOST_REPEATS = 500, 3, 31
WATCHED_STEPS = 100
FIRST_SCENE = SimScene(2, 16, 100)

LEAST_DRAWN = 0.05
"""Share of the pixels that points are in; the room's fill more."""

OFF_SURFACE = 0.01
"""Share by which a point's depth may leave those of the mesh in its pixel and the ones around."""


@dataclass(frozen=True)
class FirstCall:
    """A peer's construction and first step on a tiny scene: compiling and loading."""

    peer: str
    seconds: float


@dataclass(frozen=True)
class Drawn:
    """One peer on a scene.

    Attributes:
        differing_pixels: Of all worlds, compared with the sensor's images. Of a mesh: pixels whose
            point is not on its surface.
        steps: In a timed run.
        timing: Of one step.
    """

    name: str
    version: str
    differing_pixels: int
    steps: int
    timing: Timing


@dataclass(frozen=True)
class Measured:
    """All peers on a scene.

    Attributes:
        load: Programs that ran or waited on the machine meanwhile, over a minute.
        bytes_a_world: Of the sensor's buffers.
    """

    scene: SimScene
    drawn: Sequence[Drawn]
    repeats: int
    load: float
    bytes_a_world: float
    steady: SteadyLoop

    def slow_in(self, scene: SimScene, seconds: float) -> set[str]:
        """Names of other peers of which a step in another scene would take longer."""
        growth = scene.work / self.scene.work
        return {
            drawn.name
            for drawn in self.drawn
            if not drawn.name.startswith("depthwarp")
            and growth / drawn.timing.per_second(1)[1] > seconds
        }


def first_calls(device: str, console: Console) -> list[FirstCall]:
    """Compile and load every peer, say how long it took, and which are left out."""
    table = plain_table("peer", "version", "first call [s]")
    calls = []
    for name, make in MAKERS.items():
        begin = time.perf_counter()
        try:
            peer = make(FIRST_SCENE, device)
            peer.step()
            peer.images()  # waits
        except (ImportError, LeftOutError) as error:
            console.print(f"{name} is left out: {error}")
            continue
        calls.append(FirstCall(name, time.perf_counter() - begin))
        table.add_row(name, peer.version, f"{calls[-1].seconds:.3f}")
    console.print("\nFirst call, compiling included, no part of the figures below")
    console.print(table)
    return calls


def measure_scene(
    scene: SimScene, device: str, seconds: float, without: Collection[str] = ()
) -> Measured:
    """All peers that this machine has, on one scene.

    Args:
        scene: What is drawn.
        device: Warp device.
        seconds: Time for all timed runs.
        without: Names of peers that are left out.

    Raises:
        DifferentImageError: A peer draws another image.
    """
    peers = [peer for peer in _made(scene, device) if peer.name not in without]
    step_s = [_warm_step(peer, device) for peer in peers]
    differing = _differing_pixels(peers)
    steps = [max(1, min(MOST_STEPS, math.ceil(RUN_S / s))) for s in step_s]
    pairs = list(zip(peers, steps, strict=True))
    runs = [_run(peer, count, device) for peer, count in pairs]
    round_s = sum(s * count + PAUSE_S for s, count in zip(step_s, steps, strict=True))
    repeats = max(LEAST_REPEATS, min(MOST_REPEATS, int(seconds / round_s)))
    timed = zip(alternate(runs, repeats), steps, strict=True)
    timings = [_of_one(timing, count) for timing, count in timed]
    drawn = [
        Drawn(peer.name, peer.version, pixels, count, timing)
        for (peer, count), pixels, timing in zip(pairs, differing, timings, strict=True)
    ]
    sensor = next(peer for peer in peers if isinstance(peer, Sensor))
    watched = max(3, min(WATCHED_STEPS, int(seconds / 4 / step_s[0])))
    return Measured(
        scene,
        drawn,
        repeats,
        os.getloadavg()[0],
        buffer_bytes(sensor.make) / scene.worlds,
        watch_steady_loop(sensor.step, watched),
    )


def _made(scene: SimScene, device: str) -> list[SimPeer]:
    peers = []
    for make in MAKERS.values():
        try:
            peers.append(make(scene, device))
        except (ImportError, LeftOutError):  # said already, by `first_calls`
            continue
    return peers


def _run(peer: SimPeer, steps: int, device: str) -> Callable[[], None]:
    """So many steps, done when it returns."""

    def run() -> None:
        for _ in range(steps):
            peer.step()
        _wait(device)

    return run


def _wait(device: str) -> None:
    """Until the device has done what all streams asked for: torch's too."""
    if device != "cpu":
        wp.synchronize_device(device)


def _warm_step(peer: SimPeer, device: str) -> float:
    """Seconds of a step that is not the first: the shortest of three."""
    run = _run(peer, 1, device)
    run()
    return min(run_once(run)[0] for _ in range(3))


def _of_one(timing: Timing, steps: int) -> Timing:
    """Times of one step."""
    return Timing(
        tuple(s / steps for s in timing.wall_s), tuple(s / steps for s in timing.processor_s)
    )


def _differing_pixels(peers: Sequence[SimPeer]) -> list[int]:
    """Pixels that are not as the sensor's, the first peer's."""
    reference = peers[0].images()
    drawn = np.count_nonzero(reference)
    if drawn < LEAST_DRAWN * reference.size:
        raise DifferentImageError(
            f"{peers[0].name} drew {drawn} of {reference.size} pixels, too few to compare with: "
            f"the scene fills at least {LEAST_DRAWN:.0%}"
        )
    differing = []
    for peer in peers:
        images = peer.images()
        if peer.draws_points:
            pixels, limit = count_differing_pixels(images, reference), MAX_DIFFERING_SHARE
        else:
            pixels, limit = count_off_surface(reference, images), OFF_SURFACE
        if pixels > limit * reference.size:
            raise DifferentImageError(
                f"{peer.name} draws another image than {peers[0].name}: {pixels} of "
                f"{reference.size} pixels differ, rounding explains at most {limit:.1%}"
            )
        differing.append(pixels)
    return differing


def count_off_surface(points: Float32Array, surface: Float32Array) -> int:
    """Pixels whose point is nearer or farther than the surface anywhere in and around its pixel.

    A point may lie anywhere in its pixel while a ray goes through the middle, so the depths of a
    pixel and of the eight around it say between which depths a point of that surface may be.
    """
    padded = np.pad(surface, ((0, 0), (1, 1), (1, 1)), mode="edge")
    around = np.lib.stride_tricks.sliding_window_view(padded, (3, 3), axis=(1, 2))
    nearest, farthest = around.min(axis=(3, 4)), around.max(axis=(3, 4))
    off = (points < (1 - OFF_SURFACE) * nearest) | (points > (1 + OFF_SURFACE) * farthest)
    return int(np.count_nonzero(off & (points > 0)))
