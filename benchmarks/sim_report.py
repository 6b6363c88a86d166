"""What a measurement of many worlds says: tables for people, records for programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from rich.console import Console

from benchmarks.figures import Figure
from benchmarks.report import Machine, now, plain_table
from benchmarks.sim_measure import Drawn, FirstCall, Measured

__all__ = ["print_growth", "print_published", "print_scene", "print_wanted", "records"]

WANTED_TIMES_TORCH = 4.0
WANTED_IMAGES_PER_S_CUDA = 10e6

PUBLISHED = """\
Published ray tracers of simulators name 0.5 to 2 million images a second on a GPU. That is other
work: they trace meshes and shapes, a ray a pixel, with trees that follow what moves; here points
are projected, as many as a world has, and a pixel without a point stays empty. Their images,
scenes and GPUs are others, too, and their figures may hold physics and colours. The rays above are
Warp's own on this machine: one mesh that all worlds share and that never moves, depth alone."""


def print_scene(console: Console, measured: Measured) -> None:
    """All peers of a scene."""
    console.print(
        f"\n{measured.scene}, median of {measured.repeats}, load {measured.load:.1f} meanwhile"
    )
    table = plain_table(
        "\npeer",
        "thousand\nimages/s",
        "\nquartiles",
        "million\npoints/s",
        "\nratio",
        "cores\nbusy",
        "pixels\ndiffer",
    )
    scene, own = measured.scene, measured.drawn[0]
    for drawn in measured.drawn:
        low, median, high = drawn.timing.per_second(scene.worlds)
        is_points = not drawn.name.startswith("rays")
        table.add_row(
            drawn.name,
            _thousands(median),
            f"{_thousands(low)} - {_thousands(high)}",
            f"{median * scene.points / 1e6:,.0f}" if is_points else "-",
            f"{drawn.timing.times_as_fast_as(own.timing):.3g}",
            f"{drawn.timing.busy_cores:.1f}",
            str(drawn.differing_pixels),
        )
    console.print(table)
    console.print(f"memory a world: {measured.bytes_a_world:,.0f} bytes of buffers")
    console.print(str(measured.steady))


def print_growth(console: Console, done: Sequence[Measured]) -> None:
    """One line a scene: how many times as fast as each peer the sensor is."""
    others = list(dict.fromkeys(drawn.name for m in done for drawn in m.drawn[1:]))
    console.print("\nThousand images a second of depthwarp, and how many times those of the others")
    short = [name.removeprefix("depthwarp, ").replace(" triangles", "") for name in others]
    table = plain_table("worlds x side x points", "images/s", *short)
    for measured in done:
        scene, own = measured.scene, measured.drawn[0]
        times = [times_of(measured, name) for name in others]
        table.add_row(
            f"{scene.worlds:,} x {scene.side} x {scene.points:,}",
            _thousands(own.timing.per_second(scene.worlds)[1]),
            *("-" if ratio is None else f"{ratio:.2f}" for ratio in times),
        )
    console.print(table)


def print_wanted(console: Console, base: Sequence[Measured], on_cuda: bool) -> bool:
    """What is to be reached, where it was measured; whether it was missed."""
    missed = False
    for measured in base:
        if on_cuda:
            graph = _named(measured, "depthwarp, graph")
            rate = None if graph is None else graph.timing.per_second(measured.scene.worlds)[1]
            figure = Figure("images/s, replayed", rate, WANTED_IMAGES_PER_S_CUDA, "images/s")
        else:
            times = times_of(measured, "torch")
            figure = Figure("over torch's scatter_reduce", times, WANTED_TIMES_TORCH, "times")
            console.print(_fastest_runs(measured))
        held = measured.steady.warp_bytes
        loop = Figure("the steady loop allocates", float(held), 0.0, "bytes", is_limit=True)
        for wanted in (figure, loop):
            value = "-" if wanted.measured is None else f"{wanted.measured:.4g}"
            console.print(
                f"{measured.scene}: {wanted.name}: {value} {wanted.unit}, wanted "
                f"{wanted.target:.4g}: {wanted.verdict}"
            )
            missed = missed or wanted.verdict == "MISSED"
    return missed


def _fastest_runs(measured: Measured) -> str:
    """The same of the fastest run of each, which other programs hinder least."""
    torch = _named(measured, "torch")
    if torch is None:
        return "torch's scatter_reduce was not measured"
    times = min(torch.timing.wall_s) / min(measured.drawn[0].timing.wall_s)
    return f"\nfastest run over torch's fastest run: {times:.2f} times, load {measured.load:.1f}"


def print_published(console: Console) -> None:
    """What the figures of ray tracers are, and why they are not compared."""
    console.print("\n" + PUBLISHED)


def times_of(measured: Measured, name: str) -> float | None:
    """How many times as fast as another peer the sensor is; None without it."""
    other = _named(measured, name)
    return None if other is None else measured.drawn[0].timing.times_as_fast_as(other.timing)


def records(
    machine: Machine, device: str, done: Sequence[Measured], first: Sequence[FirstCall]
) -> list[dict[str, Any]]:
    """One record for each scene and peer; rates are quartiles: lower, median, upper."""
    about = {
        "benchmark": "sim",
        "date": now(),
        "machine": machine.about,
        "device": device,
        "first_call_s": {call.peer: call.seconds for call in first},
    }
    return [
        about
        | {
            "worlds": measured.scene.worlds,
            "side": measured.scene.side,
            "points": measured.scene.points,
            "load": measured.load,
            "peer": drawn.name,
            "version": drawn.version,
            "images_per_s": drawn.timing.per_second(measured.scene.worlds),
            "points_per_s": drawn.timing.per_second(measured.scene.worlds * measured.scene.points),
            "times_as_fast_as": {
                other.name: drawn.timing.times_as_fast_as(other.timing) for other in measured.drawn
            },
            "steps_a_run": drawn.steps,
            **asdict(drawn.timing),
            "differing_pixels": drawn.differing_pixels,
            "sensor_bytes_a_world": measured.bytes_a_world,
            "steady_loop": asdict(measured.steady),
        }
        for measured in done
        for drawn in measured.drawn
    ]


def _named(measured: Measured, name: str) -> Drawn | None:
    return next((drawn for drawn in measured.drawn if drawn.name == name), None)


def _thousands(rate: float) -> str:
    return f"{rate / 1e3:,.0f}" if rate >= 1e5 else f"{rate / 1e3:.3g}"
