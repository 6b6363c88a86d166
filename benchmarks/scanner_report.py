"""Figures of the scanner's accuracy: which are to be reached, a table, JSON lines."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from pathlib import Path

from rich.box import SIMPLE_HEAD
from rich.table import Table

__all__ = [
    "LEAST_FOUND",
    "MOST_FALSE",
    "MOST_RMS_PX",
    "MOST_RMS_SATURATED_PX",
    "PULL_DEVIATIONS",
    "Figures",
    "append_json_lines",
    "figure_table",
    "misses",
]

MOST_RMS_PX, MOST_RMS_SATURATED_PX = 0.10, 0.15
LEAST_FOUND, MOST_FALSE = 0.99, 0.001
PULL_DEVIATIONS = (0.5, 2.0)


@dataclass(frozen=True)
class Figures:
    """What the cloud of one scan is worth.

    Attributes:
        case: What was scanned.
        scale: Size of the sensor relative to the full one.
        speckle: Contrast of the laser's speckle.
        visible: Rows in which the line is visible, 0.5 to 15 m from the camera.
        found: Of those, rows with a point that is not false.
        points: Points of the cloud.
        false_points: Of those, points that lie off every visible place of the line.
        rms_px: RMS error of the column, of all other points in rows with one true crossing [px].
        bias_px: Mean error of the column, of the same points [px].
        median_range_error_m: Median of the absolute error of the range, of the same points [m].
        median_sigma_m: Median of the error budget's standard deviation [m].
        median_pull: Median of the absolute range error over its own standard deviation.
        pull_deviation: Standard deviation of range error over its own standard deviation.
    """

    case: str
    scale: float
    speckle: float
    visible: int
    found: int
    points: int
    false_points: int
    rms_px: float
    bias_px: float
    median_range_error_m: float
    median_sigma_m: float
    median_pull: float
    pull_deviation: float

    @property
    def found_share(self) -> float:
        """Share of the visible line that was found; NaN where none is visible."""
        return self.found / self.visible if self.visible else float("nan")

    @property
    def false_share(self) -> float:
        """Share of the points that are false."""
        return self.false_points / self.points


def misses(figures: Figures) -> list[str]:
    """The figures that a scan without speckle does not reach, in words."""
    most_rms = MOST_RMS_SATURATED_PX if "saturated" in figures.case else MOST_RMS_PX
    least_pull, most_pull = PULL_DEVIATIONS
    f = figures
    checks = [
        (f.rms_px > most_rms, f"RMS of {f.rms_px:.3f} px, to reach {most_rms} px"),
        (f.found_share < LEAST_FOUND, f"{f.found_share:.2%} found, to reach {LEAST_FOUND:.0%}"),
        (f.false_share >= MOST_FALSE, f"{f.false_share:.3%} false, to stay below {MOST_FALSE:.1%}"),
        (f.median_pull > 1.0, f"median error of {f.median_pull:.2f} sigma, to stay within 1"),
        (
            not least_pull <= f.pull_deviation <= most_pull,
            f"pull of {f.pull_deviation:.2f}, to lie in {least_pull} to {most_pull}",
        ),
    ]
    return [f"{f.case}: {text}" for is_missed, text in checks if is_missed]


def figure_table(pairs: Sequence[tuple[Figures, Figures]]) -> Table:
    """Figures of scans without speckle, with the RMS with speckle beside."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("case")
    for title in (
        "RMS\n[px]",
        "speckled\n[px]",
        "\nfound",
        "\nfalse",
        "error\n[mm]",
        "sigma\n[mm]",
        "error /\nsigma",
        "pull\ndev.",
    ):
        table.add_column(title, justify="right")
    for plain, speckled in pairs:
        table.add_row(
            plain.case,
            f"{plain.rms_px:.3f}",
            f"{speckled.rms_px:.3f}",
            f"{plain.found_share:.2%}" if plain.visible else "-",
            f"{plain.false_share:.3%}",
            f"{plain.median_range_error_m * 1e3:.2f}",
            f"{plain.median_sigma_m * 1e3:.2f}",
            f"{plain.median_pull:.2f}",
            f"{plain.pull_deviation:.2f}",
        )
    return table


def append_json_lines(path: Path, machine: dict[str, object], scans: Sequence[Figures]) -> None:
    """Append one line a scan to a file."""
    date = datetime.now(UTC).isoformat(timespec="seconds")
    with path.open("a", encoding="utf-8") as file:
        for figures in scans:
            record = {"benchmark": "scanner", "date": date, "machine": machine, **asdict(figures)}
            file.write(json.dumps(record) + "\n")
