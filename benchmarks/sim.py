"""Depth images of many worlds a second: the sensor next to torch's scatter and to ray casting.

Run `python -m benchmarks.sim`; docs/simulation.md says the method. Worlds, pixels and points grow
one at a time from 64 worlds of 64 x 64 pixels and 4096 points, on a GPU from 4096 worlds.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import warp as wp
from rich.console import Console

from benchmarks.harness import DifferentImageError, empty_kernel_cache, this_machine
from benchmarks.report import append_json_lines
from benchmarks.sim_measure import Measured, first_calls, measure_scene
from benchmarks.sim_report import print_growth, print_published, print_scene, print_wanted, records
from benchmarks.sim_scene import SimScene
from benchmarks.splat import count
from depthwarp.devices import free_memory, resolve_device
from depthwarp.errors import DepthwarpError

BASE = SimScene(64, 64, 4096)
BASE_CUDA = SimScene(4096, 64, 4096)
WORLDS = (1, 4, 16, 64, 256, 1024, 4096)
SIDES = (32, 64, 128)
POINTS = (1024, 4096, 16384)

SHARE = 10
"""A peer is left out where one step of it takes this part of the time for a scene."""


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; 1 where a peer draws another image, or a figure is missed."""
    parser = build_parser()
    options = parser.parse_args(arguments)
    console = Console(highlight=False, markup=False, soft_wrap=True)
    try:
        device = resolve_device(options.device)
        with empty_kernel_cache():
            here = this_machine()
            here.print_to(console)
            if device.is_cuda:
                console.print(f"{device.alias}: {device.name}")
            first = first_calls(options.device, console)
            axes = scenes_of(device.is_cuda, options.worlds, options.side, options.points)
            done = _measure_axes(axes, options, console)
            print_growth(console, done)
            base = BASE_CUDA if device.is_cuda else BASE
            missed = print_wanted(console, [m for m in done if m.scene == base], device.is_cuda)
            print_published(console)
    except DepthwarpError as error:
        parser.error(str(error))
    except DifferentImageError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    if options.json is not None:
        place = str(device.name) if device.is_cuda else "cpu"
        append_json_lines(options.json, records(here, place, done, first))
    return int(missed)


def scenes_of(
    on_cuda: bool,
    worlds: Sequence[int] | None,
    sides: Sequence[int] | None,
    points: Sequence[int] | None,
) -> list[list[SimScene]]:
    """Scenes that grow along one axis each; or all combinations of what is asked for."""
    base = BASE_CUDA if on_cuda else BASE
    if worlds or sides or points:
        return [
            [replace(base, worlds=w, side=s, points=p)]
            for w in worlds or (base.worlds,)
            for s in sides or (base.side,)
            for p in points or (base.points,)
        ]
    return [
        [replace(base, worlds=n) for n in WORLDS],
        [replace(base, side=n) for n in SIDES],
        [replace(base, points=n) for n in POINTS],
    ]


def _measure_axes(
    axes: Sequence[Sequence[SimScene]], options: argparse.Namespace, console: Console
) -> list[Measured]:
    """Each scene once, without peers that are expected to take too long from the scene before."""
    done: dict[SimScene, Measured] = {}
    for axis in axes:
        last: Measured | None = None
        slow: set[str] = set()  # what is slow in a scene is slow in those that grow from it
        for scene in axis:
            if scene.memory_bytes > free_memory(wp.get_device("cpu")) / 2:
                console.print(f"\n{scene} is left out: memory would not do")
                break
            if last is not None:
                slow = slow | last.slow_in(scene, options.seconds / SHARE)
            if scene not in done:
                done[scene] = measure_scene(scene, options.device, options.seconds, slow)
                print_scene(console, done[scene])
                if slow:
                    console.print(f"left out, they would take too long: {'; '.join(sorted(slow))}")
            last = done[scene]
    return list(done.values())


def build_parser() -> argparse.ArgumentParser:
    """The command's options."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.sim", description=__doc__)
    for name, what in (
        ("worlds", "numbers of worlds"),
        ("side", "widths and heights of an image [px]"),
        ("points", "points of a world"),
    ):
        parser.add_argument(
            f"--{name}",
            type=count,
            nargs="+",
            metavar="N",
            help=f"{what}; any of the three: all combinations instead of one axis at a time",
        )
    parser.add_argument(
        "--seconds",
        type=float,
        default=15.0,
        metavar="S",
        help="time for the timed runs of a scene, at least 3 of each peer (default: %(default)s)",
    )
    parser.add_argument(
        "--device", default="cpu", help="Warp device, e.g. cuda:0 (default: %(default)s)"
    )
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help="append the results to FILE, one JSON line each"
    )
    return parser


if __name__ == "__main__":
    sys.exit(main())
