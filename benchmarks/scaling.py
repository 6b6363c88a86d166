"""How the time grows with points, views, pixels and threads.

Run `python -m benchmarks.scaling`. One table and one panel of the plot for each of the four; the
others stay as they are: 10^7 points of the empty room, one view of 724 x 662 pixels, all cores.
Views are of 10^6 points and 64 x 64 pixels. A curve ends where the next place would take too long.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from rich.console import Console

from benchmarks.harness import VIEWS_A_LOOP, Settings, measure_peers, this_machine
from benchmarks.own_peers import OneCall, Plan, Prepared
from benchmarks.peers import Peer, installed_peers
from benchmarks.report import append_json_lines, now, plain_table
from benchmarks.scaling_plot import Sample, draw_curves
from benchmarks.scenes import RoomScene
from benchmarks.splat import count
from depthwarp.cli.report import quiet_warp
from depthwarp.devices import free_memory, resolve_device, usable_cores
from depthwarp.errors import DepthwarpError

POINTS = tuple(m * 10**e for e in (5, 6, 7) for m in (1, 3)) + (10**8,)
VIEWS = (1, 10, 100, 1000, 10_000)
SIDES = (64, 128, 256, 512, 1024, 2048, 4096)

VIEWS_POINTS, VIEWS_SIDE = 1_000_000, 64
FIXED_POINTS = 10_000_000

PATIENCE_S = 20.0
"""A curve ends where a run of its next place is expected to take longer."""

POINT_BYTES, PIXEL_BYTES = 100, 128
"""What all peers together hold at most of a point and of a pixel of a view."""


@dataclass(frozen=True)
class Place:
    """What is drawn at one place of an axis."""

    axis: str
    amount: int
    scene: RoomScene
    views: int = 1
    threads: int | None = None

    @property
    def memory_bytes(self) -> int:
        """What all peers together may need."""
        width, height = self.scene.image_size
        pixels = self.views * width * height
        return POINT_BYTES * self.scene.point_count + PIXEL_BYTES * pixels


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = _parser()
    options = parser.parse_args(arguments)
    console = Console(highlight=False, markup=False)
    quiet_warp()
    try:
        device = resolve_device(options.device)
        here = this_machine()
        here.print_to(console)
        samples = []
        for axis, places in axes(options.most, options.device).items():
            measured = list(_curves(places, options.device, options.repeats, console))
            console.print(f"\ntime of a run [ms] by {axis}, median of {options.repeats}")
            _print_table(console, measured)
            samples += measured
        about = {
            "benchmark": "scaling",
            "date": now(),
            "machine": here.about,
            "read_bytes_per_s": here.read_bytes_per_s,
            "device": options.device,
        }
        if options.json is not None:
            append_json_lines(options.json, [about | asdict(sample) for sample in samples])
        if options.plot is not None:
            processor = here.about["processor"] if device.is_cpu else device.name
            machine = f"{processor}, {usable_cores()} cores"
            draw_curves(samples, labels(options.most), machine, options.plot)
    except DepthwarpError as error:
        parser.error(str(error))
    return 0


def axes(most: int, device: str) -> dict[str, list[Place]]:
    """The places of each axis, with at most so many points."""
    fixed = RoomScene(min(FIXED_POINTS, most))
    few = RoomScene(min(VIEWS_POINTS, most), image_size=(VIEWS_SIDE, VIEWS_SIDE))
    squares = [(side, replace(fixed, image_size=(side, side))) for side in SIDES]
    threads = range(1, usable_cores() + 1) if device == "cpu" else ()
    return {
        "points": [Place("points", n, RoomScene(n)) for n in POINTS if n <= most],
        "views": [Place("views", n, few, views=n) for n in VIEWS],
        "pixels": [Place("pixels", side * side, scene) for side, scene in squares],
        "threads": [Place("threads", n, fixed, threads=n) for n in threads],
    }


def labels(most: int) -> dict[str, str]:
    """What stays as it is while each axis grows."""
    points, few = f"{min(FIXED_POINTS, most):,} points", f"{min(VIEWS_POINTS, most):,} points"
    width, height = RoomScene(0).image_size
    size = f"{width} x {height} px"
    return {
        "points": f"one view of {size}",
        "views": f"{few}, {VIEWS_SIDE} x {VIEWS_SIDE} px",
        "pixels": f"one view of {points}",
        "threads": f"one view of {points}, {size}",
    }


def _curves(
    places: Sequence[Place], device: str, repeats: int, console: Console
) -> Iterator[Sample]:
    """Samples of all curves of one axis, place by place."""
    last: dict[str, Sample] = {}
    for place in places:
        if place.memory_bytes > free_memory(resolve_device("cpu")):
            console.print(f"{place.axis} end before {place.amount:,}: memory would not do")
            return
        points = place.scene.points_world()
        peers = _peers(place, device)
        going = [peer for peer in peers if _is_quick(peer, last.get(peer.name), place)]
        if not going:
            return
        settings = Settings([place.scene], place.views, repeats, device, with_memory=False)
        for result in measure_peers(going, place.scene, points, settings):
            run_s = 1 / result.timing.per_second(1)[1]
            all_views_s = run_s * place.views / result.views
            sample = Sample(place.axis, place.amount, result.peer.name, all_views_s, run_s)
            last[sample.peer] = sample
            yield sample


def _peers(place: Place, device: str) -> list[Peer]:
    """Who draws: all peers; where threads are counted, those that can be told how many."""
    if place.threads is not None:
        return [Plan(device, place.threads), Prepared(device, place.threads)]
    return [peer for peer in installed_peers(device)[0] if peer.name != OneCall.name]


def _is_quick(peer: Peer, last: Sample | None, place: Place) -> bool:
    """Whether a run at the place is expected to end in time, from the place before."""
    if last is None or place.threads is not None:
        return True
    only_a_few = place.axis == "views" and not peer.is_batch
    growth = VIEWS_A_LOOP if only_a_few else place.amount / last.amount
    return last.run_s * growth < PATIENCE_S


def _print_table(console: Console, samples: Sequence[Sample]) -> None:
    peers = list(dict.fromkeys(sample.peer for sample in samples))
    seconds = {(sample.amount, sample.peer): sample.seconds for sample in samples}
    axis = samples[0].axis
    table = plain_table(axis, *(f" {peer:>9}" for peer in peers))
    for amount in dict.fromkeys(sample.amount for sample in samples):
        times = [seconds.get((amount, peer)) for peer in peers]
        table.add_row(f"{amount:,}", *map(_milliseconds, times))
    console.print(table)


def _milliseconds(seconds: float | None) -> str:
    if seconds is None:
        return "-"
    return f"{1e3 * seconds:,.0f}" if seconds >= 0.1 else f"{1e3 * seconds:.3g}"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.scaling", description=__doc__)
    parser.add_argument(
        "--most", type=count, default=10**8, metavar="N", help="most points (default: 10^8)"
    )
    parser.add_argument(
        "--repeats", type=count, default=5, metavar="N", help="timed runs (default: %(default)s)"
    )
    parser.add_argument("--device", default="cpu", help="Warp device (default: %(default)s)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="append the results, JSON lines")
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw the curves, PNG")
    return parser


if __name__ == "__main__":
    sys.exit(main())
