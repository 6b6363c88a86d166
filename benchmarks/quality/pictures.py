"""Pictures of what chains do: truth, splat, filtered, filled, and where the result is wrong."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.quality.chains import Chain, run
from benchmarks.quality.evaluate import Shot
from benchmarks.quality.scoring import Removal, errors, removal

__all__ = ["PICTURED", "write_pictures"]

FloatImage = npt.NDArray[np.floating]
BoolImage = npt.NDArray[np.bool_]

PICTURED = ("paper", "IP-Basic", "best", "bound + nearest")
"""Chains that are shown where none is asked for."""

VIEWS = (0, 2)
MOST_ERROR_CM = 20.0
EMPTY, UNSEEN = "#ffffff", "#c9c9c9"
BLOCK_PX = 2  # pixels are shown in blocks of 2 x 2, by their nearest one: a splat stays visible
PANEL_INCHES = (3.0, 2.85)


def write_pictures(
    folder: Path, case: str, taken: Sequence[Shot], chains: Sequence[Chain]
) -> list[Path]:
    """Write a picture of chosen views, one row a chain.

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
            path = folder / f"{case.replace(' ', '_')}_view{place}.png"
            _write(path, f"{case}, view {place}", taken[place], chains)
            paths.append(path)
    return paths


def _write(path: Path, title: str, shot: Shot, chains: Sequence[Chain]) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    rows = len(chains)
    width, height = PANEL_INCHES
    figure = Figure(figsize=(5 * width + 0.3, rows * height + 1.2), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(rows, 5, squeeze=False)
    depth_scale, error_scale = _depth_scale(shot), _error_scale()
    for row, chain in zip(axes, chains, strict=True):
        made = run(chain, shot.raw, shot.cloud, shot.label)
        counts = removal(shot.raw, made.filtered, shot.label_observed)
        score = errors(made.filled.depth, shot.view.depth, shot.judged, shot.near)
        panels: tuple[tuple[str, FloatImage, BoolImage | None], ...] = (
            ("truth, grey: not observed", shot.view.depth, shot.view.observed),
            ("raw splat", shot.raw.depth, None),
            (f"filtered, {_removed(counts)}", made.filtered.depth, None),
            (
                f"filled, {score.within:.1%} within {100 * shot.near:.0f} cm",
                made.filled.depth,
                None,
            ),
        )
        for axis, (text, depth, observed) in zip(row[:4], panels, strict=True):
            _draw(axis, text, _blocks(depth), depth_scale)
            if observed is not None:
                _shade(axis, observed)
        _draw_error(row[4], shot, made.filled.depth, error_scale)
    for axis, chain in zip(axes[:, 0], chains, strict=True):
        axis.set_ylabel(chain.name, fontsize=10)
    for axis in axes.flat:
        axis.set_xticks([])
        axis.set_yticks([])
    _bar(figure, axes[:, :4], depth_scale, "z depth [m], logarithmic; white: empty")
    _bar(figure, axes[:, 4], error_scale, "error [cm]; white: empty, green: more")
    figure.suptitle(title)
    figure.savefig(path, dpi=100)


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
