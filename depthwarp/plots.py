"""The paper's figures as PNG pictures: clouds, range views and depth maps, drawn with matplotlib.

Every function draws on a canvas of its own (no display, no global state) and writes one file whole
or not at all. Matplotlib is imported when a function is called. The arguments, in one frame:

- `points`, (N, 3): a cloud [m], Z up, its not finite rows left out; `selected`, (N,) bool: those
  that the segmentation keeps;
- `position`, (3,): the camera position P_C [m];
- `rectangles`, (K, 4, 3): rectangles of the range view [m], corners in order around each, nearest
  rectangle first; the last one is the depth plane;
- `rotation`, (3, 3): the matrix R of equations (4) to (6); its rows are the camera's X, Y, Z axes;
- `orientation`, (3,): the angles alpha, beta, gamma about X, Y and Z [degrees];
- `depth`, (H, W): a depth map [m], 0 where it is empty; `path`: the PNG file to write; `title`:
  what stands above the picture.

Each function raises `InputError` for an array that it cannot draw and a file that it cannot write,
and `MissingExtraError` where matplotlib is not installed.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from depthwarp.errors import InputError, MissingExtraError
from depthwarp.io.atomic import atomic_path

__all__ = [
    "plot_depth_map",
    "plot_point_cloud",
    "plot_range_view",
    "plot_range_view_angles",
    "plot_rotated_cloud",
    "plot_segmented_points",
    "plot_surf",
    "require_matplotlib",
]

Array = NDArray[Any]
PngPath = str | os.PathLike[str]

DPI, WIDTH, HEIGHT = 120, 1200, 900
"""Resolution [pixels an inch] and size [px] of every figure but the depth map."""

MOST_POINTS, MOST_CELLS, MOST_STEP = 150_000, 240, 0.5
"""Points drawn of a larger cloud, cells along the longer side of a surface, and depth [m] that one
cell of it may span: things farther apart do not touch."""

CLOUD_VIEW, RANGE_VIEW, SURFACE_VIEW = (38.0, -118.0), (32.0, -45.0), (20.0, -70.0)
"""Elevation and azimuth [degrees] to look at a cloud, a range view and a surface from."""

AXIS_COLORS, VIEW_COLOR, GREY = ("#c62828", "#2e7d32", "#1565c0"), "#d6006e", "#bcc1c7"
HEIGHT_MAP, DEPTH_MAP, DISTANCE = "viridis", "turbo", "distance from the camera [m]"
METRES = ("X [m]", "Y [m]", "Z [m]")


def require_matplotlib() -> None:
    """Raise `MissingExtraError` where matplotlib is not installed."""
    try:
        import matplotlib.figure  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("drawing figures", "matplotlib", "viz") from error


@contextmanager
def _page(path: PngPath, title: str, size: tuple[int, int] = (WIDTH, HEIGHT)) -> Iterator[Any]:
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


def _checked(array: ArrayLike, name: str, *shape: int | str) -> Array:
    """The array as float64, after a check of its shape, in which a letter is any length."""
    checked = np.asarray(array, dtype=np.float64)
    same = [isinstance(n, str) or n == got for got, n in zip(checked.shape, shape, strict=False)]
    if checked.ndim != len(shape) or not all(same):
        raise InputError(f"{name} must have shape {shape}, got {checked.shape}")
    return checked


def _finite(points: Array, most: int = MOST_POINTS) -> Array:
    """At most `most` finite rows. Random: every k-th point of a scan would stripe its frames."""
    points = points[np.isfinite(points).all(axis=1)]
    few = min(most, len(points))
    return points[np.sort(np.random.default_rng(0).choice(len(points), few, replace=False))]


def _checked_view(position: ArrayLike, rectangles: Array) -> tuple[Array, Array]:
    """Camera position, (3,), and rectangles, (K, 4, 3), after the checks."""
    apex, view = _checked(position, "position", 3), _checked(rectangles, "rectangles", "K", 4, 3)
    if not (np.isfinite(apex).all() and np.isfinite(view).all()):
        raise InputError("position and rectangles must be finite, got NaN or infinity")
    return apex, view


def _axes_3d(figure: Any, extent: Array, view: Any, labels: Any = METRES, deep: float = 1.0) -> Any:
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


def _dots(axes: Any, points: Array, **style: Any) -> Any:
    """Small dots at points, (N, 3)."""
    return axes.scatter(*points.T, s=0.7, linewidths=0, depthshade=False, zorder=1, **style)


def _bar(figure: Any, colored: Any, label: str) -> None:
    """A slim colour bar at the right edge."""
    figure.colorbar(colored, cax=figure.add_axes((0.915, 0.25, 0.012, 0.45)), label=label)


def _draw_view(axes: Any, position: Array, rectangles: Array) -> None:
    """The range view: its four edges, nested rectangles and the depth plane, the last of them."""
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    if len(rectangles) == 0:
        return
    closed = np.concatenate([rectangles, rectangles[:, :1]], axis=1)
    nested = Line3DCollection(closed[:-1], colors=VIEW_COLOR, linewidths=0.7, alpha=0.6, zorder=3)
    edges = [np.stack([position, corner]) for corner in rectangles[-1]]
    outline = Line3DCollection([*edges, closed[-1]], colors=VIEW_COLOR, linewidths=1.6, zorder=4)
    plane = Poly3DCollection(rectangles[-1:], facecolors=VIEW_COLOR, alpha=0.08, zorder=2)
    for part in (plane, nested, outline):
        axes.add_collection3d(part)
    axes.scatter(*position, s=30, color=VIEW_COLOR, depthshade=False, zorder=5)


def plot_point_cloud(points: Array, path: PngPath, title: str = "3D point cloud") -> None:
    """Draw a cloud in 3D, coloured by height (Figure 3)."""
    drawn = _finite(_checked(points, "points", "N", 3))
    with _page(path, title) as figure:
        axes = _axes_3d(figure, drawn, CLOUD_VIEW)
        _bar(figure, _dots(axes, drawn, c=drawn[:, 2], cmap=HEIGHT_MAP), "Z [m]")


def plot_rotated_cloud(points: Array, rotation: Array, path: PngPath) -> None:
    """Draw a cloud before (grey) and after it is turned by R, a point p to R p (Figure 4)."""
    before = _finite(_checked(points, "points", "N", 3))
    turn = _checked(rotation, "rotation", 3, 3)
    after = before @ turn.T
    yaw = float(np.arctan2(turn[1, 0], turn[0, 0]))
    turned = f"{abs(np.degrees(yaw)):.0f}° {'counter-' if yaw > 0 else ''}clockwise about Z"
    with _page(path, f"Point cloud (grey) and rotated into the camera's axes: {turned}") as figure:
        axes = _axes_3d(figure, np.concatenate([before, after]), CLOUD_VIEW)
        _dots(axes, before, color=GREY)
        _bar(figure, _dots(axes, after, c=after[:, 2], cmap=HEIGHT_MAP), "Z [m]")
        if len(before):
            x, y, z = before.mean(axis=0)
            height, arm, across = np.array([[0, 0, z], [x, y, 0], [-y, x, 0]])
            _draw_turn(axes, height, arm, across, yaw, VIEW_COLOR)


def _draw_turn(axes: Any, hub: Array, arm: Array, across: Array, angle: float, color: str) -> None:
    """An arrow about a hub, (3,), that turns an arm by an angle [rad] to a vector across it."""
    turn = np.linspace(0.0, angle, 60)[:, None]
    curve = hub + np.cos(turn) * arm + np.sin(turn) * across
    back, tip = curve[-6], curve[-1]
    side = 0.5 * np.linalg.norm(tip - back) * (tip - hub) / np.linalg.norm(tip - hub)
    for line in (curve, np.stack([back + side, tip, back - side])):
        axes.plot(*line.T, color=color, lw=2.5, zorder=6)


def plot_range_view_angles(
    position: ArrayLike, rectangles: Array, rotation: Array, orientation: ArrayLike, path: PngPath
) -> None:
    """Draw the range view alone, with the orientation angles about the camera's axes (Figure 5)."""
    (apex, view), turn = _checked_view(position, rectangles), _checked(rotation, "rotation", 3, 3)
    angles = _checked(orientation, "orientation", 3)
    length = 0.4 * (float(np.linalg.norm(view - apex, axis=-1).max(initial=0.0)) or 1.0)
    tips = apex + length * np.concatenate([turn, -0.3 * turn])
    with _page(path, "Constructed range view with rotation angles") as figure:
        axes = _axes_3d(figure, np.concatenate([*view, tips]), RANGE_VIEW)
        _draw_view(axes, apex, view)
        for number, color in enumerate(AXIS_COLORS):
            axis, first, second = np.roll(turn, -number, axis=0)
            axes.plot(*np.stack([apex, apex + length * axis], axis=1), color=color, lw=2, zorder=6)
            middle, arm, across = length * np.array([0.65 * axis, 0.2 * first, 0.2 * second])
            _draw_turn(axes, apex + middle, arm, across, 1.7 * np.pi, color)
            text = f"{'XYZ'[number]}: {'αβγ'[number]} = {angles[number]:g}°"
            style: Any = {"color": color, "fontsize": 14, "zorder": 7, "ha": "center"}
            style["bbox"] = {"facecolor": "white", "alpha": 0.8, "linewidth": 0, "pad": 1}
            axes.text(*(apex + 1.15 * length * axis), text, **style)


def plot_range_view(
    points: Array,
    position: ArrayLike,
    rectangles: Array,
    path: PngPath,
    title: str = "Constructed range view",
) -> None:
    """Draw the range view in its cloud, which is coloured by height (Figure 6)."""
    drawn = _finite(_checked(points, "points", "N", 3))
    apex, view = _checked_view(position, rectangles)
    with _page(path, title) as figure:
        axes = _axes_3d(figure, np.concatenate([drawn, *view]), RANGE_VIEW)
        _bar(figure, _dots(axes, drawn, c=drawn[:, 2], cmap=HEIGHT_MAP), "Z [m]")
        _draw_view(axes, apex, view)


def plot_segmented_points(
    points: Array,
    selected: Array,
    position: ArrayLike,
    rectangles: Array,
    path: PngPath,
    title: str = "Segmented points",
) -> None:
    """Draw the points in the range view coloured by distance, others grey (Figures 8 and 14)."""
    cloud, (apex, view) = _checked(points, "points", "N", 3), _checked_view(position, rectangles)
    kept = _checked(selected, "selected", len(cloud)) > 0
    inside, outside = _finite(cloud[kept]), _finite(cloud[~kept], MOST_POINTS // 3)
    with _page(path, title) as figure:
        axes = _axes_3d(figure, np.concatenate([inside, outside, *view]), RANGE_VIEW)
        _dots(axes, outside, color=GREY)
        distance = np.linalg.norm(inside - apex, axis=1)
        _bar(figure, _dots(axes, inside, c=distance, cmap=DEPTH_MAP), DISTANCE)
        _draw_view(axes, apex, view)


def _depth_or_nan(depth: Array) -> tuple[Array, float, float]:
    """The map with NaN where it is empty, its nearest and its farthest depth [m], not the same."""
    checked = _checked(depth, "depth", "H", "W")
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
    with _page(path, f"{title}, {columns} x {rows} px, black: empty", page) as figure:
        axes = figure.add_axes((80 / page[0], 70 / page[1], width / page[0], height / page[1]))
        axes.set(xlabel="column [px]", ylabel="row [px]", facecolor="black")
        dark = near - (far - near) / 3  # keeps the nearest apart from the black of empty
        image = axes.imshow(shown, "gray", vmin=dark, vmax=far, interpolation="none")
        bar = axes.inset_axes((1 + 20 / width, 0, 16 / width, 1))
        figure.colorbar(image, cax=bar, label=DISTANCE)
        bar.set_ylim(near, far)


def plot_surf(depth: Array, path: PngPath, title: str = "Depth map as a surface") -> None:
    """Draw a depth map as a surface over (column, row) without empty cells (Figures 12 and 15)."""
    shown, near, far = _depth_or_nan(depth)
    with _page(path, title) as figure:
        from matplotlib.cm import ScalarMappable
        from matplotlib.colors import Normalize
        from mpl_toolkits.mplot3d.art3d import Poly3DCollection

        extent = np.array([[0, near, 0], [shown.shape[1], far, shown.shape[0]]])
        labels = ("column [px]", "depth [m]", "row [px]")
        deep = 0.8 * max(shown.shape) / (far - near)
        axes = _axes_3d(figure, extent, SURFACE_VIEW, labels, deep)
        axes.invert_zaxis()
        cells = _surface_cells(shown)
        colors = ScalarMappable(Normalize(near, far), DEPTH_MAP)
        faces = np.asarray(colors.to_rgba(cells[:, :, 1].mean(axis=1)))
        slope = np.hypot(cells[:, 2, 1] - cells[:, 0, 1], cells[:, 3, 1] - cells[:, 1, 1])
        faces[:, :3] *= (0.55 + 0.45 / (1.0 + (slope / 0.1) ** 2))[:, None]
        axes.add_collection3d(Poly3DCollection(cells, facecolors=faces, edgecolors=faces, lw=0.3))
        _bar(figure, colors, DISTANCE)


def _surface_cells(shown: Array) -> Array:
    """Quads (column, depth, row), shape (M, 4, 3), between pixels, all drawn and near in depth."""
    step = -(-max(shown.shape) // MOST_CELLS)
    sampled = shown[::step, ::step]
    row, column = np.meshgrid(*(step * np.arange(n) for n in sampled.shape), indexing="ij")
    corner = np.stack([column, sampled, row], axis=-1)
    around = corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]
    cells = np.stack(around, axis=2).reshape(-1, 4, 3)
    touching = np.ptp(cells[:, :, 1], axis=1) <= MOST_STEP  # False where a corner is empty
    return np.asarray(cells[touching])
