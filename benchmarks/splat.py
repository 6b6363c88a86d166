"""How many points a second become a depth image: depthwarp next to its peers.

Run `python -m benchmarks.splat`; README.md says the method.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.padding import Padding

from benchmarks.figures import run_figures
from benchmarks.harness import DifferentImageError, Settings, empty_kernel_cache, run_scenes
from benchmarks.report import append_json_lines, plain_table
from benchmarks.scene_catalogue import SCENES, chosen_scenes
from benchmarks.scenes import ORDERS
from depthwarp.errors import DepthwarpError


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; 1 where a peer draws another image, or a figure is missed."""
    parser = _parser()
    options = parser.parse_args(arguments)
    console = Console(highlight=False, markup=False)
    if options.list:
        _print_scenes(console)
        return 0
    if options.json is not None and not options.json.parent.is_dir():
        parser.error(f"--json {options.json}: there is no folder {options.json.parent}")
    try:
        with empty_kernel_cache():
            if options.figures:
                lines = run_figures(options.points, options.repeats, options.device, console)
            else:
                scenes = chosen_scenes(options.scene, options.points or (), options.order)
                settings = Settings(
                    scenes, options.views, options.repeats, options.device, options.memory
                )
                lines = run_scenes(settings, console)
    except DepthwarpError as error:
        parser.error(str(error))
    except DifferentImageError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    if options.json is not None:
        append_json_lines(options.json, lines)
    return int(any(line.get("verdict") == "MISSED" for line in lines))


def _print_scenes(console: Console) -> None:
    table = plain_table("scene", "points")
    table.add_column(" what it is")
    for name, kind in SCENES.items():
        counts = ", ".join(f"{count:.0e}" for count in kind.usual_counts if count)
        about = (kind.__doc__ or "").splitlines()[0]
        table.add_row(name, counts.replace("e+0", "e"), Padding(about, (0, 0, 0, 1)))
    console.print(table)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.splat", description=__doc__)
    parser.add_argument(
        "--scene",
        nargs="+",
        default=["room"],
        metavar="NAME",
        help="one measurement each (default: room)",
    )
    parser.add_argument("--list", action="store_true", help="name the scenes and stop")
    parser.add_argument(
        "--figures",
        action="store_true",
        help="measure the speeds that are to be reached, each beside its target",
    )
    parser.add_argument(
        "--points",
        type=count,
        nargs="+",
        metavar="N",
        help="points of the clouds, one measurement each (default: the scene's own numbers)",
    )
    parser.add_argument(
        "--order",
        choices=ORDERS,
        default="made",
        help="of the points: as the scene makes them, shuffled, or sorted in space by the caller",
    )
    parser.add_argument(
        "--views", type=count, default=1, metavar="N", help="views all round (default: 1)"
    )
    parser.add_argument(
        "--repeats",
        type=count,
        default=7,
        metavar="N",
        help="timed runs of each peer (default: %(default)s)",
    )
    parser.add_argument(
        "--no-memory",
        dest="memory",
        action="store_false",
        help="leave out the peak memory, for which each peer runs once more",
    )
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help="append the results to FILE, one JSON line each"
    )
    parser.add_argument(
        "--device",
        default="cpu",
        help="where depthwarp renders, e.g. cuda:0 (default: %(default)s)",
    )
    return parser


def count(text: str) -> int:
    """A whole number above 0."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number above 0, got {text}")
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
