"""Pictures of what chains do: truth, splat, what is left, filled, and where the result is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.quality.chains import Chain, run
from benchmarks.quality.evaluate import Shot
from benchmarks.quality.scoring import Removal, errors, removal
from depthwarp import State

__all__ = ["PICTURED", "write_pictures"]

FloatImage = npt.NDArray[np.floating]
BoolImage = npt.NDArray[np.bool_]

PICTURED = ("paper", "IP-Basic", "best", "bound + best's fill")
"""Chains that are shown where none is asked for."""

VIEWS = (0, 2)
MOST_ERROR_CM = 20.0
EMPTY, UNSEEN = "#ffffff", "#c9c9c9"
BLOCK_PX = 2  # pixels are shown in blocks of 2 x 2, by their nearest one: a splat stays visible
PANEL_WIDTH, TITLE_INCHES = 3.7, 0.3

STATES = {
    State.MEASURED: "measured",
    State.FILLED: "filled inside",
    State.FILLED_BORDER: "filled at a border",
    State.ERASED: "erased, and still empty",
    State.EMPTY: "empty",
}
STATE_COLORS = np.full((256, 3), 255, np.uint8)
STATE_COLORS[State.MEASURED] = 0, 0, 0
STATE_COLORS[State.FILLED] = 120, 185, 230
STATE_COLORS[State.FILLED_BORDER] = 235, 150, 40
STATE_COLORS[State.ERASED] = 200, 30, 90


def write_pictures(
    folder: Path, case: str, taken: Sequence[Shot], chains: Sequence[Chain]
) -> list[Path]:
    """Write a picture of chosen views, one row a chain below the truth and the splat.

    Args:
        folder: Where to; made if it is not there.
        case: Name of the case.
        taken: Its views.
        chains: What to show, from top to bottom.

    Returns:
        The files.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for place in VIEWS:
        if place < len(taken):
            path = folder / f"{case.replace(',', '').replace(' ', '_')}_view{place}.png"
            _write(path, f"{case}, view {place}", taken[place], chains)
            paths.append(path)
    return paths


def _write(path: Path, title: str, shot: Shot, chains: Sequence[Chain]) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows, columns = 1 + len(chains), 4
    height = PANEL_WIDTH * shot.raw.depth.shape[0] / shot.raw.depth.shape[1] + TITLE_INCHES
    size = (columns * PANEL_WIDTH + 0.3, rows * height + 1.3)
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, columns, squeeze=False)
    depth_scale, error_scale = _depth_scale(shot), _error_scale()
    truth, raw, legend, unused = axes[0]
    _draw(truth, "truth; grey: not observed", _blocks(shot.view.depth), depth_scale)
    _shade(truth, shot.view.observed)
    _draw(raw, "raw splat", _blocks(shot.raw.depth), depth_scale)
    _draw_legend(legend)
    unused.axis("off")
    for row, chain in zip(axes[1:], chains, strict=True):
        made = run(chain, shot.raw, shot.cloud, shot.label)
        counts = removal(shot.raw, made.filtered, shot.label_observed)
        score = errors(made.filled.depth, shot.view.depth, shot.judged, shot.near)
        right = f"filled, {score.within:.1%} within {100 * shot.near:.0f} cm"
        _draw(row[0], f"kept, {_removed(counts)}", _blocks(made.filtered.depth), depth_scale)
        _draw(row[1], right, _blocks(made.filled.depth), depth_scale)
        row[2].imshow(STATE_COLORS[made.filled.state], interpolation="nearest")
        row[2].set_title("what the pixels are", fontsize=8)
        _draw_error(row[3], shot, made.filled.depth, error_scale)
        row[0].set_ylabel(chain.name, fontsize=10)
    for axis in axes.flat:
        axis.set_xticks([])
        axis.set_yticks([])
    _bar(figure, axes[:, :3], depth_scale, "depth [m], logarithmic; white: empty")
    _bar(figure, axes[:, 3], error_scale, "error [cm]; white: empty, green: more")
    figure.suptitle(title)
    figure.savefig(path, dpi=100)


def _draw_legend(axis: Any) -> None:
    """What the colours of the states mean."""
    from matplotlib.patches import Patch

    axis.axis("off")
    patches = [
        Patch(facecolor=STATE_COLORS[state] / 255, edgecolor="#888888", label=text)
        for state, text in STATES.items()
    ]
    axis.legend(handles=patches, loc="center", fontsize=9, title="what the pixels are")


def _bar(figure: Any, axes: Any, scale: tuple[Any, Any], label: str) -> None:
    """A colour bar below some panels."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.ticker import MaxNLocator, NullFormatter, StrMethodFormatter

    norm, colors = scale
    extend = "max" if norm.vmin == 0 else "neither"
    bar = figure.colorbar(
        ScalarMappable(norm, colors),
        ax=axes,
        label=label,
        location="bottom",
        extend=extend,
        aspect=30 if norm.vmin == 0 else 70,
        pad=0.01,
    )
    bar.ax.xaxis.set_major_locator(MaxNLocator(8))
    bar.ax.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    bar.ax.xaxis.set_minor_formatter(NullFormatter())


def _depth_scale(shot: Shot) -> tuple[Any, Any]:
    """One scale for all panels: that of the true depths; logarithmic, so that near things show."""
    import matplotlib
    from matplotlib.colors import LogNorm

    low, high = np.percentile(shot.view.depth[shot.view.observed], (0.5, 99.5))
    return LogNorm(low, high), matplotlib.colormaps["turbo_r"].with_extremes(bad=EMPTY)


def _error_scale() -> tuple[Any, Any]:
    import matplotlib
    from matplotlib.colors import Normalize

    colors = matplotlib.colormaps["inferno"].with_extremes(bad=EMPTY, over="#37ff8b")
    return Normalize(0.0, MOST_ERROR_CM), colors


def _draw(axis: Any, text: str, image: FloatImage, scale: tuple[Any, Any]) -> None:
    norm, colors = scale
    axis.imshow(image, norm=norm, cmap=colors, interpolation="nearest")
    axis.set_title(text, fontsize=8)


def _draw_error(axis: Any, shot: Shot, depth: FloatImage, scale: tuple[Any, Any]) -> None:
    error = np.where(depth > 0, 100 * np.abs(depth - shot.view.depth), np.nan)
    score = errors(depth, shot.view.depth, shot.judged, shot.near)
    error = np.where(shot.view.observed, error, np.nan)
    _draw(axis, f"error, mean {100 * score.mae:.1f} cm", error, scale)
    _shade(axis, shot.view.observed)


def _shade(axis: Any, observed: BoolImage) -> None:
    """Lay grey over what no scan position observed."""
    from matplotlib.colors import ListedColormap

    cover = np.where(observed, np.nan, 1.0)
    extent = axis.get_images()[0].get_extent()
    axis.imshow(cover, cmap=ListedColormap([UNSEEN]), interpolation="nearest", extent=extent)


def _blocks(depth: FloatImage) -> FloatImage:
    """The nearest depth of each block, NaN where it is empty."""
    rows, columns = (size // BLOCK_PX * BLOCK_PX for size in depth.shape)
    far = np.where(depth > 0, depth, np.inf)[:rows, :columns]
    least = far.reshape(rows // BLOCK_PX, BLOCK_PX, columns // BLOCK_PX, BLOCK_PX).min(axis=(1, 3))
    return np.where(np.isfinite(least), least, np.nan)


def _removed(counts: Removal) -> str:
    return f"leak {counts.leak:.1%}, lost {counts.lost:.1%}"
