"""What a measurement says: a table for people, JSON lines for programs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.table import Table

from benchmarks.measure import Timing
from benchmarks.peers import Peer
from benchmarks.scenes import RoomScene

__all__ = ["BYTES_A_POINT", "Result", "append_json_lines", "first_call_table", "result_table"]

BYTES_A_POINT = 12
"""Three float32, read once: the least that a peer has to read."""


@dataclass(frozen=True)
class Result:
    """One peer on one scene."""

    peer: Peer
    differing_pixels: int
    timing: Timing


def first_call_table(peers: Sequence[Peer], first_call_s: Sequence[float]) -> Table:
    """Peers, their versions, and their first calls."""
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("peer")
    table.add_column("version")
    table.add_column("device")
    table.add_column("first call [s]", justify="right")
    for peer, seconds in zip(peers, first_call_s, strict=True):
        table.add_row(peer.name, peer.version, peer.device, f"{seconds:.3f}")
    return table


def result_table(scene: RoomScene, results: Sequence[Result], bandwidth: float) -> Table:
    """Speeds of all peers on a scene, with the first peer's as the unit; 80 columns wide."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("peer")
    for title in (
        "million\npoints/s",
        "\nquartiles",
        "\nGB/s",
        "of read\nbandwidth",
        f"ratio to\n{results[0].peer.name}",
        "cores\nbusy",
        "pixels\ndiffer",
    ):
        table.add_column(title, justify="right")
    unit = results[0].timing.per_second(scene.point_count)[1]
    for result in results:
        low, median, high = result.timing.per_second(scene.point_count)
        on_cpu = result.peer.device == "cpu"
        table.add_row(
            result.peer.name,
            _millions(median),
            f"{_millions(low)} - {_millions(high)}",
            f"{BYTES_A_POINT * median / 1e9:.2f}",
            f"{BYTES_A_POINT * median / bandwidth:.1%}" if on_cpu else "-",
            f"{median / unit:.2f}",
            f"{result.timing.busy_cores:.1f}",
            f"{result.differing_pixels}",
        )
    return table


def _millions(rate: float) -> str:
    return f"{rate / 1e6:.1f}" if rate < 1e8 else f"{rate / 1e6:.0f}"


def append_json_lines(
    path: Path,
    machine: dict[str, object],
    bandwidth: float,
    scene: RoomScene,
    results: Sequence[Result],
    first_call_s: Sequence[float],
) -> None:
    """Append one line a peer to a file; rates are quartiles: lower, median, upper."""
    date = datetime.now(UTC).isoformat(timespec="seconds")
    with path.open("a", encoding="utf-8") as file:
        for result, seconds in zip(results, first_call_s, strict=True):
            record = {
                "benchmark": "splat",
                "date": date,
                "machine": machine,
                "read_bytes_per_s_one_thread": bandwidth,
                "scene": asdict(scene),
                "peer": result.peer.name,
                "version": result.peer.version,
                "device": result.peer.device,
                "first_call_s": seconds,
                "bytes_a_point": BYTES_A_POINT,
                "points_per_s": result.timing.per_second(scene.point_count),
                **asdict(result.timing),
                "differing_pixels": result.differing_pixels,
            }
            file.write(json.dumps(record) + "\n")
