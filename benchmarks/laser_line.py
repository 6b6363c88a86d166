"""How long one full frame takes from raw numbers to the points of the laser line.

Run `python -m benchmarks.laser_line`. The frames are synthetic: a line from weak to saturated on a
wall of coloured patches, with noise of 2.5 grey levels. Beside the table stands the exact posterior
of the same colour model in NumPy, with the share of pixels on which the two agree.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

from benchmarks.measure import Timing, alternate, machine
from depthwarp.cli.report import quiet_warp
from depthwarp.scanner.frames import Frame, PixelFormat
from depthwarp.scanner.laser import (
    ColorKind,
    ColorTable,
    LineFinder,
    LinePoints,
    fit_pairs,
    frame_colors,
)
from depthwarp.scanner.laser.colors import channel_sites

HEIGHT, WIDTH = 2590, 1942
PATCH = 74  # pixels
NOISE = 2.5  # grey levels
LASER = np.array([0.25, 1.0, 0.12])  # blue, green, red
LINE_SIGMA = 1.5  # pixels
WEAKEST, STRONGEST = 40.0, 1000.0  # grey levels
TARGET_MS = 40.0
TARGET_AGREEMENT = 0.999


@dataclass(frozen=True)
class Case:
    """A frame, and what finds its line."""

    name: str
    frame: Frame
    off: Frame | None
    finder: LineFinder
    table: ColorTable

    def find(self) -> LinePoints:
        """The line's points."""
        return self.finder.find(self.frame, self.off)


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; 1 where a figure is missed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cpu", help="Warp device (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=15, help="runs of each (default: 15)")
    options = parser.parse_args(arguments)
    quiet_warp()
    here = machine()
    console = Console(highlight=False)
    console.print(f"{here['processor']}, {here['system']}, Warp {here['warp']}, {options.device}")
    cases = _cases(options.device)
    finds: list[Callable[[], object]] = [case.find for case in cases]
    for find in finds:  # compiles
        find()
    timings = alternate([lambda find=find: _discard(find) for find in finds], options.repeats)
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    for title in ("frame", "median [ms]", "quartiles", "cores busy", "found", "RMS [px]"):
        table.add_column(title, justify="right" if title != "frame" else "left")
    for case, timing in zip(cases, timings, strict=True):
        table.add_row(case.name, *_figures(case, timing))
    console.print(f"\n{WIDTH} x {HEIGHT}, raw numbers to points, median of {options.repeats}")
    console.print(table)
    worst = _compare_with_posterior(cases, console)
    slowest = max(1e3 * float(np.median(timing.wall_s)) for timing in timings[:2])
    console.print(
        f"raw Bayer to points {slowest:.1f} ms (target {TARGET_MS:.0f}), agreement at least "
        f"{worst:.4%} (target {TARGET_AGREEMENT:.1%})"
    )
    return 0 if slowest <= TARGET_MS and worst >= TARGET_AGREEMENT else 1


def _discard(find: Callable[[], object]) -> None:
    find()


def _cases(device: str) -> list[Case]:
    cases = []
    for pixel_format, kind in (
        (PixelFormat.BAYER_RGGB, ColorKind.LIT),
        (PixelFormat.BAYER_RGGB, ColorKind.DIFFERENCE),
        (PixelFormat.BGR, ColorKind.LIT),
        (PixelFormat.BGR, ColorKind.DIFFERENCE),
    ):
        rng = np.random.default_rng(3)
        lit, dark = _light()
        on, off = _frame(lit, pixel_format, rng), _frame(dark, pixel_format, rng)
        table = ColorTable(fit_pairs([(on, off)], kind=kind))
        finder = LineFinder(table, (WIDTH, HEIGHT), pixel_format, device=device)
        is_pair = kind is ColorKind.DIFFERENCE
        name = f"{'Bayer' if pixel_format.is_bayer else 'BGR'}{', on/off pair' if is_pair else ''}"
        cases.append(Case(name, on, off if is_pair else None, finder, table))
    return cases


def _true_columns() -> npt.NDArray[np.float64]:
    rows = np.arange(HEIGHT)
    return WIDTH / 2 + 500.0 * np.sin(rows / 700.0)


def _light() -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Grey levels with the laser on and off, shape (H, W, 3)."""
    rng = np.random.default_rng(2)
    patches = rng.uniform(10.0, 140.0, (HEIGHT // PATCH + 1, WIDTH // PATCH + 1, 1))
    patches = patches * rng.uniform(0.7, 1.0, (*patches.shape[:2], 3))
    dark = np.repeat(np.repeat(patches, PATCH, 0), PATCH, 1)[:HEIGHT, :WIDTH]
    distance = (np.arange(WIDTH) - _true_columns()[:, None]) / LINE_SIGMA
    amplitude = np.geomspace(WEAKEST, STRONGEST, HEIGHT)[:, None]
    return dark + (amplitude * np.exp(-0.5 * distance**2))[..., None] * LASER, dark


def _frame(
    light: npt.NDArray[np.float64], pixel_format: PixelFormat, rng: np.random.Generator
) -> Frame:
    values = light
    if pixel_format.is_bayer:
        values = np.empty(light.shape[:2])
        for channel, sites in enumerate(channel_sites(pixel_format)):
            for row, column in sites:
                values[row::2, column::2] = light[row::2, column::2, channel]
    noisy = np.rint(values + rng.normal(0.0, NOISE, values.shape))
    pixels = np.clip(noisy, 0, 255).astype(np.uint8)
    return Frame(pixels, pixel_format, 8, 1000.0, 0.0, 0, None, 0)


def _figures(case: Case, timing: Timing) -> list[str]:
    low, middle, high = np.percentile(np.array(timing.wall_s) * 1e3, (25, 50, 75))
    points = case.find()
    errors = points.columns - _true_columns()[points.rows]
    near = np.abs(errors) < 3.0
    return [
        f"{middle:.1f}",
        f"{low:.1f} - {high:.1f}",
        f"{timing.busy_cores:.1f}",
        f"{near.sum() / HEIGHT:.2%}, {(~near).sum()} false",
        f"{np.sqrt(np.mean(errors[near] ** 2)):.3f}",
    ]


def _compare_with_posterior(cases: Sequence[Case], console: Console) -> float:
    """Print time and agreement of the exact posterior; the lowest agreement."""
    agreements = []
    for case in cases:
        colors = frame_colors(case.frame, case.off)
        exact: list[npt.NDArray[np.bool_]] = []
        model = case.table.model
        timing = alternate(
            [lambda m=model, c=colors, e=exact: e.append(m.posterior(c) >= 0.5)], repeats=1
        )[0]
        case.find()
        agreements.append(float((case.finder.mask() == exact[0]).mean()))
        console.print(
            f"{case.name}: exact posterior {timing.wall_s[0]:.1f} s in NumPy, the same answer on "
            f"{agreements[-1]:.4%} of {exact[0].size:,} colours"
        )
    return min(agreements)


if __name__ == "__main__":
    raise SystemExit(main())
