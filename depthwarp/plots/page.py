"""The page that a figure is drawn on, and what the figures share: checks, 3D axes, colours."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from depthwarp.errors import InputError, MissingExtraError
from depthwarp.io.atomic import atomic_path

__all__ = ["axes_3d", "check_shape", "color_bar", "open_page", "require_matplotlib"]

Array = NDArray[Any]
PngPath = str | os.PathLike[str]

DPI, WIDTH, HEIGHT = 120, 1200, 900
"""Resolution [pixels an inch] and size [px] of every figure but the depth map."""

VIEW_COLOR, GREY, DEPTH_MAP = "#d6006e", "#bcc1c7", "turbo"
DISTANCE = "distance from the camera [m]"
METRES = ("X [m]", "Y [m]", "Z [m]")


def require_matplotlib() -> None:
    """Raise `MissingExtraError` where matplotlib is not installed."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("drawing figures", "matplotlib", "viz") from error


@contextmanager
def open_page(path: PngPath, title: str, size: tuple[int, int] = (WIDTH, HEIGHT)) -> Iterator[Any]:
    """Give an empty figure of a size [px], saved to `path` when the block ends without an error."""
    require_matplotlib()
    from matplotlib.figure import Figure

    if not os.fspath(path).lower().endswith(".png"):
        raise InputError(f"cannot draw {path}: figures are PNG files; end its name in .png")
    with atomic_path(path) as temporary:
        figure = Figure(figsize=(size[0] / DPI, size[1] / DPI), dpi=DPI)
        figure.text(0.5, 1 - 36 / size[1], title, ha="center", va="center", fontsize=14)
        yield figure
        figure.savefig(temporary, dpi=DPI)


def check_shape(array: ArrayLike, name: str, *shape: int | str) -> Array:
    """The array as float64, after a check of its shape, in which a letter is any length."""
    checked = np.asarray(array, dtype=np.float64)
    same = [isinstance(n, str) or n == got for got, n in zip(checked.shape, shape, strict=False)]
    if checked.ndim != len(shape) or not all(same):
        raise InputError(f"{name} must have shape {shape}, got {checked.shape}")
    return checked


def axes_3d(figure: Any, extent: Array, view: Any, labels: Any = METRES, deep: float = 1.0) -> Any:
    """3D axes around every row of `extent`, (N, 3), of equal scale but for a factor along Y."""
    from matplotlib.ticker import MaxNLocator

    axes: Any = figure.add_axes((0, 0, 1, 1), projection="3d", computed_zorder=False)
    low, high = (extent.min(axis=0), extent.max(axis=0)) if len(extent) else np.zeros((2, 3))
    stretch = np.array([1.0, deep, 1.0])
    margin = 0.005 * (float(np.max((high - low) * stretch)) or 1.0) / stretch
    low, high = low - margin, high + margin
    sides = (high - low) * stretch
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), zlim=(low[2], high[2]))
    axes.set(xlabel=labels[0], ylabel=labels[1], zlabel=labels[2])
    for axis, side in zip((axes.xaxis, axes.yaxis, axes.zaxis), sides, strict=True):
        axis.set_pane_color("#f6f7f8")
        ticks = max(2, round(8 * side / sides.max()))
        axis.set_major_locator(MaxNLocator(ticks, steps=[1, 2, 5, 10]))
    axes.xaxis.labelpad = axes.yaxis.labelpad = 9  # off the numbers of a slanted axis
    axes.view_init(elev=view[0], azim=view[1])
    _fill_page(axes, np.stack(np.meshgrid(*np.stack([low, high], axis=1))).reshape(3, 8), sides)
    return axes


def _fill_page(axes: Any, corners: Array, sides: Array) -> None:
    """Enlarge and move 3D axes so that the corners of their box, (3, 8), just fit the page."""
    from mpl_toolkits.mplot3d.proj3d import proj_transform

    axes.set_box_aspect(sides)
    axes.apply_aspect()
    x, y, _ = proj_transform(corners[0], corners[1], corners[2], axes.get_proj())
    shown = axes.transData.transform(np.stack([x, y], axis=1)) / (WIDTH, HEIGHT)
    zoom = float(min((0.78, 0.80) / np.ptp(shown, axis=0)))
    x, y = (0.47, 0.48) - zoom * ((shown.min(axis=0) + shown.max(axis=0)) / 2 - 0.5) - 0.5
    axes.set_box_aspect(sides, zoom=zoom)
    axes.set_position((x, y, 1, 1))


def color_bar(figure: Any, colored: Any, label: str) -> None:
    """A slim colour bar at the right edge."""
    figure.colorbar(colored, cax=figure.add_axes((0.915, 0.25, 0.012, 0.45)), label=label)
