"""What a measurement says: tables for people, records for programs."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from benchmarks.measure import Timing
from benchmarks.peers import Peer
from benchmarks.scenes import Scene

__all__ = [
    "Machine",
    "Result",
    "append_json_lines",
    "first_call_table",
    "now",
    "plain_table",
    "ratio_lines",
    "records",
    "result_table",
]


@dataclass(frozen=True)
class Machine:
    """Where it was measured.

    Attributes:
        about: Processor, cores, versions.
        read_bytes_per_s: What all cores together read from memory.
        read_bytes_per_s_one_thread: What one thread reads.
    """

    about: Mapping[str, object]
    read_bytes_per_s: float
    read_bytes_per_s_one_thread: float

    def print_to(self, console: Console) -> None:
        """Say it in two lines."""
        about = self.about
        console.print(
            f"{about['processor']}, {about['cores']} cores, {about['system']}, "
            f"Python {about['python']}, Warp {about['warp']}"
        )
        console.print(
            f"memory is read at {self.read_bytes_per_s / 1e9:.1f} GB/s by all cores, "
            f"{self.read_bytes_per_s_one_thread / 1e9:.1f} by one thread"
        )


@dataclass(frozen=True)
class Result:
    """One peer on one scene.

    Attributes:
        views: Views of a timed run: all, or a few of a peer that has no batch.
        memory_bytes: Its peak beyond the loaded points; None where it was not measured.
    """

    peer: Peer
    views: int
    differing_pixels: int
    timing: Timing
    memory_bytes: int | None

    def points_per_s(self, points: int) -> tuple[float, float, float]:
        """Lower quartile, median and upper quartile; a point counts once a view."""
        return self.timing.per_second(points * self.views)

    def times_as_fast_as(self, other: Result) -> float:
        """How many times the other's time a view takes, median over the rounds."""
        return self.timing.times_as_fast_as(other.timing) * self.views / other.views


def plain_table(*titles: str) -> Table:
    """A table that fits 80 columns: text first, then numbers."""
    table = Table(box=SIMPLE_HEAD, padding=0, pad_edge=False)
    for number, title in enumerate(titles):
        table.add_column(title, justify="right" if number else "left", no_wrap=True)
    return table


def first_call_table(peers: Sequence[Peer], first_call_s: Sequence[float]) -> Table:
    """Peers, their versions, and their first calls."""
    table = plain_table("peer", "version", "device", "first call [s]")
    for peer, seconds in zip(peers, first_call_s, strict=True):
        table.add_row(peer.name, peer.version, peer.device, f"{seconds:.3f}")
    return table


def result_table(points: int, results: Sequence[Result], bandwidth: float) -> Table:
    """Speeds of all peers on a scene, with the first peer's as the unit; 80 columns wide."""
    on_gpu = any(result.peer.atomics_a_point is not None for result in results)
    table = plain_table(
        "\npeer",
        "million\npoints/s",
        "\nquartiles",
        "bytes\n/point",
        "of read\nspeed",
        "\nratio",
        "cores\nbusy",
        "memory\n[MB]",
        "pixels\ndiffer",
        *(["atomics\n/point"] if on_gpu else []),
    )
    for result in results:
        peer = result.peer
        low, median, high = result.points_per_s(points)
        share = f"{peer.bytes_a_point * median / bandwidth:.1%}"
        atomics = "-" if peer.atomics_a_point is None else f"< {peer.atomics_a_point:.2f}"
        table.add_row(
            peer.name,
            _millions(median),
            f"{_millions(low)} - {_millions(high)}",
            f"{peer.bytes_a_point:.0f}",
            share if peer.device == "cpu" else "-",
            f"{result.times_as_fast_as(results[0]):.2f}",
            f"{result.timing.busy_cores:.1f}",
            "-" if result.memory_bytes is None else f"{result.memory_bytes / 1e6:.0f}",
            f"{result.differing_pixels}",
            *([atomics] if on_gpu else []),
        )
    return table


def ratio_lines(results: Sequence[Result]) -> Iterable[str]:
    """For each way of depthwarp, how many times as fast as each peer it is."""
    own = [result for result in results if result.peer.is_batch]
    others = [result for result in results if not result.peer.is_batch]
    for result in own if others else []:
        times = (f"{result.times_as_fast_as(peer):.3g} x {peer.peer.name}" for peer in others)
        yield f"{result.peer.name}: {', '.join(times)}"


def records(
    machine: Machine,
    scene: Scene,
    views: int,
    results: Sequence[Result],
    first_call_s: Sequence[float],
    points: int,
) -> list[dict[str, Any]]:
    """One record a peer; rates are quartiles: lower, median, upper."""
    return [
        {
            "benchmark": "splat",
            "date": now(),
            "machine": machine.about,
            "read_bytes_per_s": machine.read_bytes_per_s,
            "read_bytes_per_s_one_thread": machine.read_bytes_per_s_one_thread,
            "scene": asdict(scene) | {"point_count": points},
            "views": views,
            "views_timed": result.views,
            "peer": result.peer.name,
            "version": result.peer.version,
            "device": result.peer.device,
            "first_call_s": seconds,
            "bytes_a_point": result.peer.bytes_a_point,
            "atomics_a_point_at_most": result.peer.atomics_a_point,
            "points_per_s": result.points_per_s(points),
            "times_as_fast_as": {
                other.peer.name: result.times_as_fast_as(other) for other in results
            },
            **asdict(result.timing),
            "peak_memory_bytes": result.memory_bytes,
            "differing_pixels": result.differing_pixels,
        }
        for result, seconds in zip(results, first_call_s, strict=True)
    ]


def now() -> str:
    """The date and time of a record."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def append_json_lines(path: Path, lines: Iterable[Mapping[str, Any]]) -> None:
    """Append one line a record to a file."""
    with path.open("a", encoding="utf-8") as file:
        file.writelines(json.dumps(line) + "\n" for line in lines)


def _millions(rate: float) -> str:
    return f"{rate / 1e6:.1f}" if rate < 1e8 else f"{rate / 1e6:.0f}"
