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

MOST_VIEWS = 8
QUICK = {"points": [200_000], "views": 2, "dirty": "no"}


def main(arguments: Sequence[str] | None = None) -> int:
    """The command."""
    options = _options(arguments)
    quiet_warp()
    console = Console(highlight=False, width=120)
    here = machine()
    console.print(f"{here['processor']}, {here['cores']} cores, Warp {here['warp']}")
    found, missing = chains(options.device)
    for line in missing:
        console.print(line)
    chosen = [chain for chain in found if _is_chosen(chain, options.chain)]
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
    if options.pictures is not None:
        from benchmarks.quality.pictures import PICTURED, write_pictures

        shown = [chain for chain in chosen if options.chain or chain.name in PICTURED]
        for path in write_pictures(options.pictures, case.name, taken, shown):
            console.print(f"written: {path}")


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


def _is_chosen(chain: Chain, names: Sequence[str] | None) -> bool:
    return not names or any(name in chain.name for name in names)


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.quality", description=__doc__)
    add = parser.add_argument
    add("--scene", nargs="*", choices=list(SCENES), default=list(SCENES), help="none, or some")
    add("--points", type=int, nargs="+", default=list(RAYS), metavar="RAYS", help="default: all")
    add("--dirty", choices=("no", "yes", "both"), default="both", help="default: both")
    add("--views", type=int, default=MOST_VIEWS, help="views of each scene, at most 8")
    add("--chain", nargs="+", metavar="TEXT", help="only chains with one of these in their name")
    add("--quick", action="store_true", help="a trial in seconds: two views, 0.2 million, clean")
    add("--real", action="store_true", help="the real recordings of ../shared/data, too")
    add("--device", default="cpu", help="Warp device (default: %(default)s)")
    add("--pictures", type=Path, metavar="DIR", help="write a picture of two views of each case")
    add("--json", type=Path, metavar="FILE", help="append the scores, JSON lines")
    options = parser.parse_args(arguments)
    if options.quick:
        for name, value in QUICK.items():
            setattr(options, name, value)
    if not 1 <= options.views <= MOST_VIEWS:
        parser.error(f"--views must be from 1 to {MOST_VIEWS}, got {options.views}")
    if min(options.points) < 1000:
        parser.error(f"--points must be at least 1000, got {min(options.points)}")
    return options


if __name__ == "__main__":
    raise SystemExit(main())
