"""Scores of every chain on every case, as tables; see README.md beside this file."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from benchmarks.measure import machine
from benchmarks.quality.cases import RAYS, Case, cases
from benchmarks.quality.chains import Chain, chains
from benchmarks.quality.evaluate import Shot, evaluate, plan_seconds, shots
from benchmarks.quality.real import DATA, real_cases
from benchmarks.quality.report import append_json_lines, score_table
from benchmarks.quality.scenes import SCENES
from depthwarp.cli.report import quiet_warp
from depthwarp.devices import resolve_device
from depthwarp.errors import DepthwarpError

MOST_VIEWS = 8
QUICK = {"points": [200_000], "views": 2, "dirty": "no"}


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    parser = _parser()
    options = _options(parser, arguments)
    quiet_warp()
    console = Console(highlight=False, width=120)
    here = machine()
    console.print(f"{here['processor']}, {here['cores']} cores, Warp {here['warp']}")
    found, missing = chains(options.device)
    for line in missing:
        console.print(line)
    chosen = _chosen(found, options.chain, parser)
    dirty = {"no": (False,), "yes": (True,), "both": (False, True)}[options.dirty]
    for case in cases(options.scene, options.points, dirty):
        _run_case(case, chosen, options, here, console)
    if options.real:
        for name, taken in real_cases(DATA, console.print, options.device):
            _score(name, taken, chosen, options, here, console)
    return 0


def _run_case(
    case: Case,
    chosen: Sequence[Chain],
    options: argparse.Namespace,
    here: dict[str, object],
    console: Console,
) -> None:
    taken = shots(case, options.views, options.device)
    _score(case.name, taken, chosen, options, here, console)


def _score(
    name: str,
    taken: Sequence[Shot],
    chosen: Sequence[Chain],
    options: argparse.Namespace,
    here: dict[str, object],
    console: Console,
) -> None:
    splat = 1000 * plan_seconds(taken[0], None, options.device)
    scores = list(evaluate(taken, chosen, options.device))
    title = (
        f"{name}: {len(taken)} views, {len(taken[0].cloud):,} points, within "
        f"{100 * taken[0].near:g} cm, splat {splat:.1f} ms"
    )
    console.print(score_table(title, scores))
    if options.json is not None:
        case = {"case": name, "views": len(taken), "splat_ms": splat, "device": options.device}
        append_json_lines(options.json, here, case, scores)
    if options.pictures is not None:
        from benchmarks.quality.pictures import PICTURED, write_pictures

        shown = [chain for chain in chosen if options.chain or chain.name in PICTURED]
        for path in write_pictures(options.pictures, name, taken, shown):
            console.print(f"written: {path}")


def _chosen(
    found: Sequence[Chain], texts: Sequence[str] | None, parser: argparse.ArgumentParser
) -> list[Chain]:
    for text in texts or ():
        if not any(text in chain.name for chain in found):
            names = "; ".join(chain.name for chain in found)
            parser.error(f"no chain has {text!r} in its name; there are: {names}")
    return [chain for chain in found if not texts or any(text in chain.name for text in texts)]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.quality", description=__doc__)
    add = parser.add_argument
    add("--scene", nargs="*", choices=list(SCENES), default=list(SCENES), help="none, or some")
    every = ", ".join(map(str, RAYS))
    add("--points", type=int, nargs="+", default=list(RAYS), metavar="RAYS", help=f"of {every}")
    add("--dirty", choices=("no", "yes", "both"), default="both", help="default: both")
    add("--views", type=int, default=MOST_VIEWS, help="views of each scene, at most 8")
    add("--chain", nargs="+", metavar="TEXT", help="only chains with one of these in their name")
    add("--quick", action="store_true", help="a trial in a minute: two views, 0.2 million, clean")
    add("--real", action="store_true", help="the real recordings of ../shared/data, too")
    add("--device", default="cpu", help="Warp device (default: %(default)s)")
    add("--pictures", type=Path, metavar="DIR", help="write pictures of views 0 and 2 of each case")
    add("--json", type=Path, metavar="FILE", help="append the scores, JSON lines")
    return parser


def _options(
    parser: argparse.ArgumentParser, arguments: Sequence[str] | None
) -> argparse.Namespace:
    options = parser.parse_args(arguments)
    if options.quick:
        for name, value in QUICK.items():
            setattr(options, name, value)
    if not 1 <= options.views <= MOST_VIEWS:
        parser.error(f"--views must be from 1 to {MOST_VIEWS}, got {options.views}")
    if min(options.points) < 1000:
        parser.error(f"--points must be at least 1000, got {min(options.points)}")
    try:
        resolve_device(options.device)
        _check_writable(options)
    except (DepthwarpError, OSError) as error:
        parser.error(str(error))
    return options


def _check_writable(options: argparse.Namespace) -> None:
    """Find out before hours of computing, not after."""
    if options.pictures is not None:
        options.pictures.mkdir(parents=True, exist_ok=True)
    if options.json is not None:
        options.json.open("a").close()


if __name__ == "__main__":
    raise SystemExit(main())
