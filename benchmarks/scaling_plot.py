"""The plot of scaling curves: four panels, one line a peer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from depthwarp.plots.page import PngPath, open_page

__all__ = ["Sample", "draw_curves"]

SIZE = (1200, 940)  # px
AXES = ("points", "views", "pixels", "threads")
LOOKS = {
    "prepared": ("#d6006e", "o"),
    "depthwarp": ("#1565c0", "s"),
    "NumPy": ("#159a3a", "^"),
    "numba": ("#8e44ad", "D"),
    "torch": ("#8d6e63", "v"),
    "PyTorch3D": ("#5c6670", "P"),
    "Open3D": ("#ef7d00", "X"),
}
OWN_WIDTH, WIDTH = 2.4, 1.4


@dataclass(frozen=True)
class Sample:
    """One place of a curve.

    Attributes:
        axis: What grows: points, views, pixels or threads.
        amount: How many.
        peer: Whose curve.
        seconds: Median time of all views.
        run_s: Median time of a run, which is of a few views where a peer has no batch.
    """

    axis: str
    amount: int
    peer: str
    seconds: float
    run_s: float


def draw_curves(
    samples: Sequence[Sample], labels: Mapping[str, str], machine: str, path: PngPath
) -> None:
    """Draw time against what grows, both logarithmic.

    Args:
        samples: Of all axes.
        labels: What stays as it is on each axis.
        machine: Named in the title.
        path: PNG file that is written.

    Raises:
        MissingExtraError: matplotlib is not installed.
    """
    with open_page(path, f"Time of a depth image: {machine}", SIZE) as figure:
        lines: dict[str, Any] = {}
        for number, axis in enumerate(AXES):
            column, row = number % 2, number // 2
            panel = figure.add_axes((0.07 + 0.5 * column, 0.525 - 0.45 * row, 0.415, 0.345))
            own = [sample for sample in samples if sample.axis == axis]
            lines |= _draw_panel(panel, own, f"{axis} ({labels[axis]})")
        shown = [name for name in LOOKS if name in lines]
        figure.legend(
            [lines[name] for name in shown],
            shown,
            loc="upper center",
            bbox_to_anchor=(0.5, 0.945),
            ncols=len(shown),
            frameon=False,
        )


def _draw_panel(panel: Any, samples: Sequence[Sample], label: str) -> dict[str, Any]:
    """One panel; its lines by the names of the peers."""
    from matplotlib.ticker import LogLocator, NullFormatter

    lines = {}
    for peer in dict.fromkeys(sample.peer for sample in samples):
        own = [sample for sample in samples if sample.peer == peer]
        color, marker = LOOKS[peer]
        (lines[peer],) = panel.plot(
            [sample.amount for sample in own],
            [1e3 * sample.seconds for sample in own],
            color=color,
            marker=marker,
            markersize=5,
            linewidth=OWN_WIDTH if peer in ("prepared", "depthwarp") else WIDTH,
        )
    panel.set(xscale="log", yscale="log", xlabel=label, ylabel="time [ms]")
    if samples and samples[0].axis == "threads":
        amounts = sorted({sample.amount for sample in samples})
        panel.set_xticks(amounts, map(str, amounts))
        panel.minorticks_off()
    low, high = panel.get_ylim()
    if high < 100 * low:  # less than two decades: with numbers between them, in few digits
        panel.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        panel.yaxis.set_major_formatter("{x:g}")
        panel.yaxis.set_minor_formatter(NullFormatter())
    panel.grid(True, which="major", color="#e3e6e9")
    panel.set_axisbelow(True)
    panel.spines[["top", "right"]].set_visible(False)
    return lines
