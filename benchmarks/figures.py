"""The speeds that are to be reached, each measured beside its target.

All on the empty room, one view of 724 x 662 pixels unless it says more; Open3D runs in turn with
what it is compared with.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import warp as wp
from rich.console import Console

import depthwarp as dw
from benchmarks.harness import Settings, measure_peers, this_machine
from benchmarks.measure import alternate
from benchmarks.memory import memory_beside, small
from benchmarks.own_peers import OneCall, Prepared, PreparedDepths
from benchmarks.peers import Float32Array, Open3D, Peer
from benchmarks.report import Result, now, plain_table
from benchmarks.scenes import RoomScene
from depthwarp.devices import resolve_device, usable_cores
from depthwarp.rendering import RenderConfig, RenderPlan, ViewPlan

__all__ = ["Figure", "run_figures"]

VIEWS = 100
KEY_BYTES = 8
OUTPUT_BYTES = 4 + 4 + 1
"""A pixel of the Z-buffer, and of depth, index and state."""


@dataclass(frozen=True)
class Figure:
    """One figure.

    Attributes:
        name: What was measured.
        measured: None where it could not be.
        target: At least, or at most where `is_limit`.
        unit: Of both.
        is_limit: Whether less is better.
        note: What belongs to it.
    """

    name: str
    measured: float | None
    target: float
    unit: str
    is_limit: bool = False
    note: str = ""

    @property
    def verdict(self) -> str:
        """Whether the target is reached."""
        if self.measured is None:
            return "not measured"
        reached = self.measured <= self.target if self.is_limit else self.measured >= self.target
        return "reached" if reached else "MISSED"


def run_figures(
    points: Sequence[int] | None, repeats: int, device: str, console: Console
) -> list[dict[str, Any]]:
    """Measure all figures, print them, and return one record each.

    Args:
        points: Of the room, one table for each; 10^7 unless given, for which the targets hold.
        repeats: Timed runs.
        device: Where depthwarp renders.
        console: Where the table goes.

    Raises:
        DeviceError: The device is not on this machine.
    """
    resolve_device(device)
    here = this_machine()
    here.print_to(console)
    done = []
    for count in points or (10_000_000,):
        scene = RoomScene(count)
        cloud = scene.points_world()
        figures = [
            *_speeds(scene, cloud, repeats, device),
            *_unculled(scene, cloud, repeats, device),
            _index_cost(scene, cloud, repeats, device),
            _prepare_time(cloud, repeats, device),
            *_memory(scene, cloud, device),
        ]
        console.print(f"\n{scene.name}, {count:,} points, {device}, median of {repeats}")
        _print_figures(console, figures)
        done += [
            {
                "benchmark": "figures",
                "date": now(),
                "machine": here.about,
                "read_bytes_per_s": here.read_bytes_per_s,
                "device": device,
                "points": count,
                "repeats": repeats,
                **asdict(figure),
                "verdict": figure.verdict,
            }
            for figure in figures
        ]
    return done


def _speeds(scene: RoomScene, points: Float32Array, repeats: int, device: str) -> list[Figure]:
    """Prepared, one shot, and many views; each in turn with Open3D where it is installed."""

    def measured(peers: Sequence[Peer], views: int) -> list[Result]:
        settings = Settings([scene], views, repeats, device, with_memory=False)
        return measure_peers(peers, scene, points, settings)

    prepared, alone, open3d = Prepared(device), PreparedDepths(device), _open3d()
    one_view, one_depth, one_shot, *rival = measured([prepared, alone, OneCall(device), *open3d], 1)
    many_views, many_depths, *rival_of_many = measured([prepared, alone, *open3d], VIEWS)
    rate, rate_of_depth, rate_of_many, rate_of_depths = (
        result.points_per_s(len(points))[1] / 1e6
        for result in (one_view, one_depth, many_views, many_depths)
    )
    note = f"Open3D timed on a few of the {VIEWS} views" if open3d else "Open3D is not installed"
    return [
        Figure("prepared, one view", rate, 2000, "M points/s", note="with the index"),
        Figure("prepared, one view, depth alone", rate_of_depth, 2000, "M points/s"),
        Figure("one shot over Open3D", _times(one_shot, rival), 3, "times"),
        Figure(
            f"{VIEWS} views over Open3D",
            _times(many_views, rival_of_many),
            80,
            "times",
            note=f"{rate_of_many:.0f} M points/s, with the index; {note}",
        ),
        Figure(
            f"{VIEWS} views, depth alone",
            _times(many_depths, rival_of_many),
            80,
            "times",
            note=f"{rate_of_depths:.0f} M points/s; Open3D draws the depth alone, too",
        ),
    ]


def _unculled(scene: RoomScene, points: Float32Array, repeats: int, device: str) -> list[Figure]:
    """A prepared cloud of which every block is projected; the library has no such switch."""
    if device != "cpu":
        return []
    chunks = dw.PointCloud(points).prepare(device=device)
    for spheres in (chunks.source.spheres, chunks.source.groups):
        spheres.fill_(wp.vec4f(0.0, 0.0, 0.0, np.inf))  # any block may be anywhere
    config = RenderConfig(depth="z", max_range=scene.max_range_m)
    plan = RenderPlan([ViewPlan(scene.camera())], config, resolve_device(device))
    plan.render(chunks)  # warm-up
    seconds = float(np.median(alternate([lambda: plan.render(chunks)], repeats)[0].wall_s))
    return [Figure("the same, culling off", len(points) / seconds / 1e6, 700, "M points/s")]


def _open3d() -> list[Peer]:
    """Open3D, where it is installed."""
    try:
        return [Open3D()]
    except ImportError:
        return []


def _times(own: Result, rival: Sequence[Result]) -> float | None:
    return own.times_as_fast_as(rival[0]) if rival else None


def _index_cost(scene: RoomScene, points: Float32Array, repeats: int, device: str) -> Figure:
    """Depth and index over depth alone, of a prepared cloud."""
    chunks = dw.PointCloud(points).prepare(device=device)
    runs: list[Callable[[], None]] = []
    for outputs in (("depth", "index"), ("depth",)):
        renderer = dw.Renderer(
            scene.cameras(1),
            max_points=len(points),
            outputs=outputs,
            depth="z",
            max_range=scene.max_range_m,
            device=device,
        )

        def run(renderer: dw.Renderer = renderer) -> None:
            renderer.render(chunks)
            wp.synchronize_device(device)

        run()  # warm-up
        runs.append(run)
    both, alone = alternate(runs, repeats)
    cost = alone.times_as_fast_as(both)
    return Figure("depth and index over depth", cost, 1.5, "times", is_limit=True)


def _prepare_time(points: Float32Array, repeats: int, device: str) -> Figure:
    cloud = dw.PointCloud(points)

    def run() -> None:
        cloud.prepare(device=device)
        wp.synchronize_device(device)

    run()  # warm-up
    seconds = float(np.median(alternate([run], repeats)[0].wall_s))
    return Figure("preparing", seconds, 1.5, "s", is_limit=True)


def _memory(scene: RoomScene, points: Float32Array, device: str) -> list[Figure]:
    """Peak memory of one view, the cloud included; the tables of peers have a prepared one's."""
    if device != "cpu":
        return []
    width, height = scene.image_size
    buffers = width * height * (2 * KEY_BYTES * usable_cores() + OUTPUT_BYTES)
    target = (points.nbytes + buffers) / 1e6
    camera, max_range = scene.camera(), scene.max_range_m
    peak = points.nbytes + memory_beside(_one_shot, points, camera, max_range, device)
    return [Figure("peak memory, one shot", peak / 1e6, target, "MB", is_limit=True)]


def _one_shot(
    points: Float32Array, is_first: bool, camera: dw.PinholeCamera, max_range: float, device: str
) -> None:
    camera = small(camera) if is_first else camera
    dw.render(dw.PointCloud(points), camera, depth="z", max_range=max_range, device=device)


def _print_figures(console: Console, figures: Sequence[Figure]) -> None:
    table = plain_table("figure", " measured", "  target", " unit", "")
    table.columns[3].justify = "left"
    for figure in figures:
        measured = "-" if figure.measured is None else f"{figure.measured:.4g}"
        bound = "<=" if figure.is_limit else ">="
        target = f"  {bound} {figure.target:.4g}"
        table.add_row(figure.name, measured, target, f" {figure.unit}", f" {figure.verdict}")
    console.print(table)
    for figure in figures:
        if figure.note:
            console.print(f"{figure.name}: {figure.note}", soft_wrap=True)
