"""Clouds in 3D, alone and with the range view of a camera in them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from depthwarp.errors import InputError
from depthwarp.plots.page import (
    DEPTH_MAP,
    DISTANCE,
    GREY,
    VIEW_COLOR,
    Array,
    PngPath,
    axes_3d,
    check_shape,
    color_bar,
    open_page,
)

__all__ = [
    "plot_point_cloud",
    "plot_range_view",
    "plot_range_view_angles",
    "plot_rotated_cloud",
    "plot_segmented_points",
]

MOST_POINTS = 150_000
"""Points drawn of a larger cloud."""

CLOUD_VIEW, RANGE_VIEW = (38.0, -118.0), (32.0, -45.0)
"""Elevation and azimuth [degrees] to look at a cloud and a range view from."""

AXIS_COLORS, HEIGHT_MAP = ("#c62828", "#2e7d32", "#1565c0"), "viridis"


def plot_point_cloud(points: Array, path: PngPath, title: str = "3D point cloud") -> None:
    """Draw a cloud in 3D, coloured by height (Figure 3)."""
    drawn = _finite(check_shape(points, "points", "N", 3))
    with open_page(path, title) as figure:
        axes = axes_3d(figure, drawn, CLOUD_VIEW)
        color_bar(figure, _dots(axes, drawn, c=drawn[:, 2], cmap=HEIGHT_MAP), "Z [m]")


def plot_rotated_cloud(points: Array, rotation: Array, path: PngPath) -> None:
    """Draw a cloud before (grey) and after it is turned by R, a point p to R p (Figure 4)."""
    before = _finite(check_shape(points, "points", "N", 3))
    turn = check_shape(rotation, "rotation", 3, 3)
    after = before @ turn.T
    yaw = float(np.arctan2(turn[1, 0], turn[0, 0]))
    turned = f"{abs(np.degrees(yaw)):.0f}° {'counter-' if yaw > 0 else ''}clockwise about Z"
    with open_page(
        path, f"Point cloud (grey) and rotated into the camera's axes: {turned}"
    ) as figure:
        axes = axes_3d(figure, np.concatenate([before, after]), CLOUD_VIEW)
        _dots(axes, before, color=GREY)
        color_bar(figure, _dots(axes, after, c=after[:, 2], cmap=HEIGHT_MAP), "Z [m]")
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
    (apex, view), turn = (
        _checked_view(position, rectangles),
        check_shape(rotation, "rotation", 3, 3),
    )
    angles = check_shape(orientation, "orientation", 3)
    length = 0.4 * (float(np.linalg.norm(view - apex, axis=-1).max(initial=0.0)) or 1.0)
    tips = apex + length * np.concatenate([turn, -0.3 * turn])
    with open_page(path, "Constructed range view with rotation angles") as figure:
        axes = axes_3d(figure, np.concatenate([*view, tips]), RANGE_VIEW)
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
    drawn = _finite(check_shape(points, "points", "N", 3))
    apex, view = _checked_view(position, rectangles)
    with open_page(path, title) as figure:
        axes = axes_3d(figure, np.concatenate([drawn, *view]), RANGE_VIEW)
        color_bar(figure, _dots(axes, drawn, c=drawn[:, 2], cmap=HEIGHT_MAP), "Z [m]")
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
    cloud, (apex, view) = check_shape(points, "points", "N", 3), _checked_view(position, rectangles)
    kept = check_shape(selected, "selected", len(cloud)) > 0
    inside, outside = _finite(cloud[kept]), _finite(cloud[~kept], MOST_POINTS // 3)
    with open_page(path, title) as figure:
        axes = axes_3d(figure, np.concatenate([inside, outside, *view]), RANGE_VIEW)
        _dots(axes, outside, color=GREY)
        distance = np.linalg.norm(inside - apex, axis=1)
        color_bar(figure, _dots(axes, inside, c=distance, cmap=DEPTH_MAP), DISTANCE)
        _draw_view(axes, apex, view)


def _finite(points: Array, most: int = MOST_POINTS) -> Array:
    """At most `most` finite rows. Random: every k-th point of a scan would stripe its frames."""
    points = points[np.isfinite(points).all(axis=1)]
    few = min(most, len(points))
    return points[np.sort(np.random.default_rng(0).choice(len(points), few, replace=False))]


def _checked_view(position: ArrayLike, rectangles: Array) -> tuple[Array, Array]:
    """Camera position, (3,), and rectangles, (K, 4, 3), after the checks."""
    apex, view = (
        check_shape(position, "position", 3),
        check_shape(rectangles, "rectangles", "K", 4, 3),
    )
    if not (np.isfinite(apex).all() and np.isfinite(view).all()):
        raise InputError("position and rectangles must be finite, got NaN or infinity")
    return apex, view


def _dots(axes: Any, points: Array, **style: Any) -> Any:
    """Small dots at points, (N, 3)."""
    return axes.scatter(*points.T, s=0.7, linewidths=0, depthshade=False, zorder=1, **style)


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
