"""One frame of the scanner's camera with the points that were measured in it."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from depthwarp.errors import InputError
from depthwarp.plots.page import HEIGHT, VIEW_COLOR, WIDTH, Array, PngPath, check_shape, open_page

__all__ = ["plot_frame"]

MARKED = 80
"""Points marked in a frame: as many as the paper's has."""

BESIDE, ABOVE = 8, 6
"""Columns and rows to each side of the point that is shown from near."""

SHOWN_MEDIAN, WHITE_QUANTILE = 0.3, 0.999
"""What a frame's median is lifted to [share of white], and the quantile that becomes white."""

MARK, CHANNELS = "#ff3fa8", (("blue", "#1565c0"), ("green", "#159a3a"), ("red", "#c62828"))


def plot_frame(
    pixels_bgr: NDArray[np.uint8],
    rows: ArrayLike,
    columns: ArrayLike,
    path: PngPath,
    title: str = "One measurement frame",
) -> None:
    """Draw a frame, brightened, with some of its points, and one of them from near (Figure 2)."""
    image, points = _checked_frame(pixels_bgr, rows, columns)
    height, width = image.shape[:2]
    few = min(MARKED, len(points))
    marked = points[np.linspace(0, len(points) - 1, few).round().astype(int)]
    text = f"{title}: {len(points)} measured points, {few} of them marked"
    with open_page(path, text) as figure:
        size = np.array([width, height]) * min(600 / width, 745 / height)
        corner = 85 + (600 - size[0]) / 2, 75 + (745 - size[1]) / 2
        axes = _axes(figure, *corner, *size)
        axes.set(xlabel="column [px]", ylabel="row [px]")
        axes.imshow(_brightened(image, WHITE_QUANTILE), interpolation="antialiased")
        axes.scatter(*marked.T, s=20, facecolors="none", edgecolors=MARK, linewidths=0.7)
        if few:
            _draw_near(figure, axes, image, points, marked[few // 3])


def _checked_frame(pixels_bgr: Array, rows: ArrayLike, columns: ArrayLike) -> tuple[Array, Array]:
    """The frame as float64 and its points (column, row), shape (N, 2), after the checks."""
    if np.asarray(pixels_bgr).dtype != np.uint8:
        raise InputError(f"pixels_bgr must be uint8, got {np.asarray(pixels_bgr).dtype}")
    image = check_shape(pixels_bgr, "pixels_bgr", "H", "W", 3)
    if image.size == 0:
        raise InputError(f"pixels_bgr must have at least one pixel, got shape {image.shape}")
    row = check_shape(rows, "rows", "N")
    points = np.stack([check_shape(columns, "columns", len(row)), row], axis=1)
    height, width = image.shape[:2]
    if not ((points > -0.5) & (points < np.array([width, height]) - 0.5)).all():
        raise InputError(f"rows and columns must lie in the frame of {width} x {height} px")
    return image, points


def _axes(figure: Any, x: float, y: float, width: float, height: float) -> Any:
    """Axes at a place of the page [px]."""
    return figure.add_axes((x / WIDTH, y / HEIGHT, width / WIDTH, height / HEIGHT))


def _brightened(image: Array, quantile: float) -> Array:
    """Red, green, blue from 0 to 1 of a BGR image whose quantile becomes white; hues are kept."""
    level, white = np.maximum(np.quantile(image, (0.5, quantile)), (1.0, 2.0))
    power = math.log(SHOWN_MEDIAN) / math.log(level / white) if level < white else 1.0
    brightest = np.maximum(image.max(axis=2, keepdims=True), white)
    return np.asarray((image[:, :, ::-1] / brightest) ** min(power, 1.0))


def _draw_near(figure: Any, axes: Any, image: Array, points: Array, middle: Array) -> None:
    """A point with its neighbours from near, joined to its place in the frame, and its profile."""
    from matplotlib.patches import Rectangle
    from matplotlib.ticker import MaxNLocator

    row = round(middle[1])
    columns = range(image.shape[1])[max(round(middle[0]) - BESIDE, 0) :][: 2 * BESIDE + 1]
    rows = range(image.shape[0])[max(row - ABOVE, 0) :][: 2 * ABOVE + 1]
    left, right, bottom, top = columns[0] - 0.5, columns[-1] + 0.5, rows[-1] + 0.5, rows[0] - 0.5
    near = _axes(figure, 760, 480, 400, 320)
    near.imshow(
        _brightened(image[np.ix_(rows, columns)], 1.0),
        extent=(left, right, bottom, top),
        interpolation="none",
        aspect="auto",
    )
    near.plot(*points.T, "o", ms=9, mfc="none", mec=MARK, mew=1)
    near.plot(*points.T, "+", ms=9, mec=MARK, mew=1)
    near.set(xlim=(left, right), ylim=(bottom, top), ylabel="row [px]")
    near.set_title("from near: a point in each row", fontsize=10)
    for edge in (row - 0.5, row + 0.5):
        near.axhline(edge, color="white", lw=1.2, ls="--")
    axes.add_patch(Rectangle((left, top), right - left, bottom - top, fill=False, ec="white"))
    for y, height in ((top, 800), (bottom, 480)):
        _join(figure, axes, (right, y), (760 / WIDTH, height / HEIGHT))

    seen = np.round(points).astype(int)
    channel = int(np.argmax(image[seen[:, 1], seen[:, 0]].sum(axis=0)))
    name, color = CHANNELS[channel]
    profile = _axes(figure, 760, 75, 400, 320)
    levels = image[row, columns, channel]
    profile.bar(columns, levels, width=1, color=color, alpha=0.35, ec=color)
    profile.axvline(middle[0], color=VIEW_COLOR, lw=1.6)
    for shown_axis in (near.xaxis, near.yaxis, profile.xaxis):
        shown_axis.set_major_locator(MaxNLocator(8, integer=True))
    profile.set(xlim=(left, right), xlabel="column [px]", ylabel=f"{name} [grey levels]")
    profile.set_title(f"profile of row {row}: the line is at column {middle[0]:.2f}", fontsize=10)


def _join(figure: Any, axes: Any, place: tuple[float, float], corner: tuple[float, float]) -> None:
    """A thin line from a place in the frame to a corner of the picture from near."""
    from matplotlib.patches import ConnectionPatch

    figure.add_artist(
        ConnectionPatch(place, corner, axes.transData, figure.transFigure, color="#9aa1a8", lw=0.8)
    )
