"""What the scores say: a table for people, JSON lines for programs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.table import Table

from benchmarks.quality.evaluate import Score
from benchmarks.quality.scoring import Errors

__all__ = ["append_json_lines", "score_table"]

COLUMNS = (
    ("leak", "%"),
    ("leak,\nall", "%"),
    ("lost", "%"),
    ("bogus", "%"),
    ("cover", "%"),
    ("within", "%"),
    ("MAE", "cm"),
    ("RMSE", "cm"),
    ("edge\nwithin", "%"),
    ("edge\nMAE", "cm"),
    ("cost", "ms"),
)


def score_table(title: str, scores: Sequence[Score]) -> Table:
    """Scores of all chains on a case; 110 to 120 columns wide."""
    table = Table(title=title, title_justify="left", box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("chain", no_wrap=True)
    for name, unit in COLUMNS:
        table.add_column(f"{name}\n{unit}", justify="right")
    for score in scores:
        counts, everywhere = score.removal, score.everywhere
        table.add_row(
            score.chain,
            *_cells((counts.leak,), 2, counts.visible),
            *_cells((score.anywhere.leak,), 2, score.anywhere.visible),
            *_cells((counts.lost, counts.bogus), 2, counts.visible),
            *_cells((everywhere.coverage, everywhere.within), 1, everywhere.pixels),
            *_cells((everywhere.mae, everywhere.rmse), 1, everywhere.covered),
            *_cells((score.band.within, score.band.mae), 1, score.band.covered),
            f"{score.milliseconds:.1f}",
        )
    return table


def append_json_lines(
    path: Path,
    machine: dict[str, object],
    case: dict[str, object],
    scores: Sequence[Score],
) -> None:
    """Append one line a chain to a file.

    Args:
        path: The file.
        machine: What the costs depend on.
        case: What was scored, and the splat's own milliseconds.
        scores: Of each chain.
    """
    date = datetime.now(UTC).isoformat(timespec="seconds")
    with path.open("a", encoding="utf-8") as stream:
        for score in scores:
            counts = score.removal
            entry = {
                "benchmark": "quality",
                "date": date,
                "machine": machine,
                **case,
                "chain": score.chain,
                "leak": counts.leak,
                "leak_all_pixels": score.anywhere.leak,
                "lost": counts.lost,
                "bogus": counts.bogus,
                "removal_counts": asdict(counts),
                "observed": _entries(score.everywhere),
                "edge_band": _entries(score.band),
                "cost_ms": score.milliseconds,
            }
            stream.write(json.dumps(entry) + "\n")


def _cells(values: Sequence[float], digits: int, of: int) -> list[str]:
    """Hundredths of values that were taken over `of` pixels; a dash where there were none."""
    return [f"{100 * value:.{digits}f}" if of else "-" for value in values]


def _entries(errors: Errors) -> dict[str, float]:
    return {
        "pixels": errors.pixels,
        "coverage": errors.coverage,
        "within": errors.within,
        "mae_m": errors.mae,
        "rmse_m": errors.rmse,
    }
