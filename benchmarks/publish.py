"""Measure everything that is published of the splat, keep it, and write the page of results.

Run `python -m benchmarks.publish` on a quiet machine; it takes half an hour or more. It appends to
`results/splat.jsonl`, `figures.jsonl` and `scaling.jsonl`, draws `results/scaling.png` and writes
`results/README.md`, whose tables come from the newest lines of these files.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from benchmarks import scaling, splat
from benchmarks.scene_catalogue import SCENES

RESULTS = Path(__file__).resolve().parent / "results"
RUNS = (
    ["--scene", *SCENES],
    ["--scene", "room", "--points", "10000000", "--order", "sorted"],
    ["--scene", "scan", "--points", "10000000", "--order", "shuffled"],
    ["--scene", "room", "--points", "10000000", "--views", "100", "--repeats", "3"],
)
"""What `benchmarks.splat` is run with, besides the figures."""

Record = dict[str, Any]


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; 1 where peers do not do the same work."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.publish", description=__doc__)
    parser.add_argument(
        "--only-page", action="store_true", help="write the page of what is kept, measure nothing"
    )
    if not parser.parse_args(arguments).only_page:
        kept = ["--json", str(RESULTS / "splat.jsonl")]
        for run in RUNS:
            if splat.main([*run, *kept]):
                return 1  # peers draw different images
        splat.main(["--figures", "--json", str(RESULTS / "figures.jsonl")])
        plot = str(RESULTS / "scaling.png")
        scaling.main(["--json", str(RESULTS / "scaling.jsonl"), "--plot", plot])
    page = page_of(*(_lines(RESULTS / f"{name}.jsonl") for name in ("figures", "splat")))
    temporary = RESULTS / "README.md.part"
    temporary.write_text(page, encoding="utf-8")
    os.replace(temporary, RESULTS / "README.md")
    return 0


def page_of(figures: Sequence[Record], speeds: Sequence[Record]) -> str:
    """The page of results, Markdown, of records of figures and of speeds, oldest first."""
    about = [record["machine"] for record in (*figures, *speeds)][-1:]
    versions = "".join(
        f"{m['processor']}, {m['cores']} cores, Python {m['python']}, Warp {m['warp']}.\n"
        for m in about
    )
    parts = [
        "# Results\n",
        f"Written by `python -m benchmarks.publish`; ../README.md says the method. {versions}",
        "## Speeds to be reached\n",
        _table(("figure", "measured", "target", ""), map(_figure_row, _newest_figures(figures))),
        "## Million points a second\n",
        "Medians; in brackets the peak memory beyond the points [MB]. A point counts once a view."
        "\n",
        _speed_table(_newest_speeds(speeds)),
        "## Scaling\n",
        "![Time against points, views, pixels and threads](scaling.png)\n",
    ]
    return "\n".join(parts)


def _lines(path: Path) -> list[Record]:
    if not path.exists():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()]


def _newest_figures(records: Iterable[Record]) -> Iterable[Record]:
    """The last record of each figure."""
    return {(record["device"], record["name"]): record for record in records}.values()


def _newest_speeds(records: Iterable[Record]) -> dict[tuple[Any, ...], dict[str, Record]]:
    """The last record of each peer on each scene; those from before scenes had views left out."""
    newest: dict[tuple[Any, ...], dict[str, Record]] = {}
    for record in records:
        if "views" in record:
            scene = record["scene"]
            key = scene["name"], scene["point_count"], scene["order"], record["views"]
            newest.setdefault(key, {})[record["peer"]] = record
    return newest


def _figure_row(record: Record) -> tuple[str, ...]:
    measured = "-" if record["measured"] is None else f"{record['measured']:.4g}"
    bound = "at most" if record["is_limit"] else "at least"
    note = f" ({record['note']})" if record["note"] else ""
    target = f"{bound} {record['target']:.4g} {record['unit']}"
    return record["name"] + note, measured, target, record["verdict"]


def _speed_table(speeds: dict[tuple[Any, ...], dict[str, Record]]) -> str:
    peers = list(dict.fromkeys(peer for of_scene in speeds.values() for peer in of_scene))
    rows = []
    for (name, points, order, views), of_scene in speeds.items():
        title = name if order == "made" else f"{name}, {order}"
        cells = (_speed(of_scene[peer]) if peer in of_scene else "" for peer in peers)
        rows.append((title, f"{points:,}", f"{views}", *cells))
    return _table(("scene", "points", "views", *peers), rows)


def _speed(record: Record) -> str:
    memory = record["peak_memory_bytes"]
    held = "" if memory is None else f" ({memory / 1e6:.0f})"
    return f"{record['points_per_s'][1] / 1e6:.3g}{held}"


def _table(titles: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [titles, ["---"] * len(titles), *rows]
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


if __name__ == "__main__":
    sys.exit(main())
