"""Depth maps, pixel for pixel and as surfaces."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from depthwarp.errors import InputError
from depthwarp.plots.page import (
    DEPTH_MAP,
    DISTANCE,
    VIEW_COLOR,
    Array,
    PngPath,
    axes_3d,
    check_shape,
    color_bar,
    open_page,
)

__all__ = ["MOST_STEP", "plot_depth_map", "plot_depth_maps", "plot_surf", "surface_cells"]

MOST_CELLS = 240
"""Cells along the longer side of a surface."""

MOST_STEP = 0.5
"""Depth [m] that one cell of a surface may span: things farther apart do not touch."""

LARGE, TINT = 17, 0.4
"""Size of the letters beside maps that share a page, and opacity of what is marked in them."""

SURFACE_VIEW = (20.0, -70.0)
"""Elevation and azimuth [degrees] to look at a surface from."""


def _depth_or_nan(depth: Array) -> tuple[Array, float, float]:
    """The map with NaN where it is empty, its nearest and its farthest depth [m], not the same."""
    checked = check_shape(depth, "depth", "H", "W")
    if checked.size == 0:
        raise InputError(f"depth must have at least one pixel, got shape {checked.shape}")
    filled = (checked > 0) & np.isfinite(checked)
    near, far = np.quantile(checked[filled], (0, 1)) if filled.any() else (0.0, 1.0)
    return np.where(filled, checked, np.nan), float(near), max(float(far), float(near) + 1e-3)


def plot_depth_map(depth: Array, path: PngPath, title: str = "Depth map") -> None:
    """Draw a depth map pixel for pixel: darker is closer, empty is black (Figures 11 and 13)."""
    shown, near, far = _depth_or_nan(depth)
    rows, columns = shown.shape
    zoom = max(1, 400 // max(rows, columns))  # a small map's pixels become squares
    height, width = rows * zoom, columns * zoom
    page = max(width, 300) + 230, height + 140
    with open_page(path, f"{title}, {columns} x {rows} px, black: empty", page) as figure:
        axes = figure.add_axes((80 / page[0], 70 / page[1], width / page[0], height / page[1]))
        axes.set(ylabel="row [px]")
        image = _draw_grey(axes, shown, near, far)
        bar = axes.inset_axes((1 + 20 / width, 0, 16 / width, 1))
        figure.colorbar(image, cax=bar, label=DISTANCE)
        bar.set_ylim(near, far)


def plot_depth_maps(
    depths: Sequence[Array],
    marked: Sequence[Array],
    captions: Sequence[str],
    path: PngPath,
    title: str = "Depth maps",
    mark: str = "marked",
) -> None:
    """Draw depth maps of one size side by side on one scale, each as `plot_depth_map` does.

    The marked pixels are tinted, and `mark` says what they are. Letters are large, for a page that
    is shown small.
    """
    maps, masks = _same_size(depths, marked, captions)
    shown, near, far = _depth_or_nan(np.concatenate(maps))
    rows, columns = maps[0].shape
    zoom = max(1, 600 // max(rows, columns))
    height, width = rows * zoom, columns * zoom
    across, left, below = max(width, 600) + 30, 120, 95
    page = left + across * len(maps) + 150, height + below + 235
    text = f"{title}, {columns} x {rows} px, black: empty, pink: {mark}"
    with open_page(path, text, page) as figure:
        from matplotlib.colors import to_rgba

        figure.texts[0].set(fontsize=LARGE + 3, y=1 - 45 / page[1])
        for n, one in enumerate(np.split(shown, len(maps))):
            corner = (left + n * across) / page[0], below / page[1]
            axes = figure.add_axes((*corner, width / page[0], height / page[1]))
            _draw_grey(axes, one, near, far)
            tint = np.zeros((rows, columns, 4))
            tint[masks[n]] = to_rgba(VIEW_COLOR, TINT)
            axes.imshow(tint, interpolation="none")
            axes.set_title(captions[n], fontsize=LARGE, pad=12)
            axes.tick_params(labelsize=LARGE, labelleft=n == 0)
            axes.xaxis.label.set_size(LARGE)
        figure.axes[0].set_ylabel("row [px]", fontsize=LARGE)
        last = figure.axes[-1]
        bar = last.inset_axes((1 + 25 / width, 0, 20 / width, 1))
        figure.colorbar(last.images[0], cax=bar).set_label(DISTANCE, size=LARGE, labelpad=12)
        bar.tick_params(labelsize=LARGE)
        bar.set_ylim(near, far)


def _same_size(
    depths: Sequence[Array], marked: Sequence[Array], captions: Sequence[str]
) -> tuple[list[Array], list[Array]]:
    """The maps and their masks, after the checks."""
    counts = len(depths), len(marked), len(captions)
    if counts[0] == 0 or len(set(counts)) > 1:
        raise InputError(
            "depths must have at least one map, marked and captions one entry for each, "
            f"got {counts[0]}, {counts[1]} and {counts[2]}"
        )
    shape = check_shape(depths[0], "depths[0]", "H", "W").shape
    maps = [check_shape(one, f"depths[{n}]", *shape) for n, one in enumerate(depths)]
    masks = [check_shape(one, f"marked[{n}]", *shape) > 0 for n, one in enumerate(marked)]
    return maps, masks


def _draw_grey(axes: Any, shown: Array, near: float, far: float) -> Any:
    """A map in grey on black; its axes' row label is the caller's."""
    axes.set(xlabel="column [px]", facecolor="black")
    dark = near - (far - near) / 3  # keeps the nearest apart from the black of empty
    return axes.imshow(shown, "gray", vmin=dark, vmax=far, interpolation="none")


def plot_surf(depth: Array, path: PngPath, title: str = "Depth map as a surface") -> None:
    """Draw a depth map as a surface over (column, row) without empty cells (Figures 12 and 15)."""
    shown, near, far = _depth_or_nan(depth)
    with open_page(path, title) as figure:
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection

        extent = np.array([[0, near, 0], [shown.shape[1], far, shown.shape[0]]])
        labels = ("column [px]", "depth [m]", "row [px]")
        deep = 0.8 * max(shown.shape) / (far - near)
        axes = axes_3d(figure, extent, SURFACE_VIEW, labels, deep)
        axes.invert_zaxis()
        cells = surface_cells(shown)
        colors = ScalarMappable(Normalize(near, far), DEPTH_MAP)
        faces = np.asarray(colors.to_rgba(cells[:, :, 1].mean(axis=1)))
        slope = np.hypot(cells[:, 2, 1] - cells[:, 0, 1], cells[:, 3, 1] - cells[:, 1, 1])
        faces[:, :3] *= (0.55 + 0.45 / (1.0 + (slope / 0.1) ** 2))[:, None]
        axes.add_collection3d(Poly3DCollection(cells, facecolors=faces, edgecolors=faces, lw=0.3))
        color_bar(figure, colors, DISTANCE)


def surface_cells(shown: Array) -> Array:
    """The cells between the pixels of a map that a surface is drawn of.

    Args:
        shown: Depth [m], shape (H, W), NaN where it is empty.

    Returns:
        Corners (column, depth, row) of each cell, in order around it, shape (M, 4, 3): those with
        no empty corner that span at most `MOST_STEP`.
    """
    step = -(-max(shown.shape) // MOST_CELLS)
    sampled = shown[::step, ::step]
    row, column = np.meshgrid(*(step * np.arange(n) for n in sampled.shape), indexing="ij")
    corner = np.stack([column, sampled, row], axis=-1)
    around = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    cells = np.stack(around, axis=2).reshape(-1, 4, 3)
    touching = np.ptp(cells[:, :, 1], axis=1) <= MOST_STEP  # False where a corner is empty
    return np.asarray(cells[touching])
