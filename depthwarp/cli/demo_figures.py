"""The demo's figures: which of the paper's is drawn from what."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from depthwarp import plots
from depthwarp.cli.demo_scan import DemoScan
from depthwarp.cli.report import Reporter

if TYPE_CHECKING:
    from depthwarp.depth_map import DepthMap
    from depthwarp.range_view import RangeView

__all__ = ["DemoView", "draw_figures"]

CEILING = 2.6
"""Height [m] above which the clouds of the figures are cut, so that one looks into the room."""

SHOWN_RECTANGLES = 12
"""Rectangles of a range view that a figure shows: the last one and some before it."""


@dataclass(frozen=True)
class DemoView:
    """One of the paper's two views of the cloud."""

    range_view: RangeView
    line_count: int
    depth_map: DepthMap

    @property
    def rectangles(self) -> NDArray[np.float64]:
        """Some rectangles, evenly spaced, the depth plane last, shape (K, 4, 3)."""
        corners = self.range_view.corners_world(self.line_count)
        step = max(1, self.line_count // SHOWN_RECTANGLES)
        return corners[::-step][::-1]

    @property
    def pose(self) -> str:
        """C_O in words."""
        return "C_O = ({:g}, {:g}, {:g})".format(*self.range_view.orientation)


def draw_figures(
    reporter: Reporter, scan: DemoScan, first: DemoView, second: DemoView, out: Path
) -> list[Path]:
    """Draw the paper's Figures 1 to 15, but its sketches 7, 9 and 10; returns the files."""
    figures = {**_scanner_figures(scan), **_view_figures(scan, first, second)}
    for name, draw in figures.items():
        with reporter.stage("figures", f"drawing {out / name}"):
            draw(out / name)
    return [out / name for name in figures]


def _scanner_figures(scan: DemoScan) -> dict[str, Callable[[Path], None]]:
    """Section 2: the scanner, and one of its frames."""
    return {
        "fig01_scanner.png": partial(plots.plot_setup, scan.geometry),
        "fig02_frame.png": partial(
            plots.plot_frame, scan.picture, scan.line.rows, scan.line.columns
        ),
    }


def _view_figures(
    scan: DemoScan, first: DemoView, second: DemoView
) -> dict[str, Callable[[Path], None]]:
    """Sections 3 and 4: from the cloud to the two depth maps."""
    below_ceiling = scan.cloud.points_world[:, 2] < CEILING
    points = scan.cloud.points_world[below_ceiling]
    position, rotation = first.range_view.position, first.range_view.pose.rotation

    def segmented(view: DemoView) -> Callable[[Path], None]:
        return partial(
            plots.plot_segmented_points,
            points,
            view.range_view.segment(scan.cloud)[below_ceiling],
            position,
            view.rectangles,
            title=f"Segmented points, {view.pose}",
        )

    def depth_map(view: DemoView) -> Callable[[Path], None]:
        return partial(plots.plot_depth_map, view.depth_map.depth, title=f"Depth map, {view.pose}")

    def surf(view: DemoView) -> Callable[[Path], None]:
        title = f"Depth map as a surface, {view.pose}"
        return partial(plots.plot_surf, view.depth_map.depth, title=title)

    return {
        "fig03_point_cloud.png": partial(
            plots.plot_point_cloud, points, title="3D point cloud, the ceiling left out"
        ),
        "fig04_rotated_cloud.png": partial(plots.plot_rotated_cloud, points, rotation),
        "fig05_range_view_angles.png": partial(
            plots.plot_range_view_angles,
            position,
            first.rectangles,
            rotation,
            first.range_view.orientation,
        ),
        "fig06_range_view.png": partial(
            plots.plot_range_view,
            points,
            position,
            first.rectangles,
            title="Constructed range view at P_C = ({:g}, {:g}, {:g})".format(*position),
        ),
        "fig08_segmented_points.png": segmented(first),
        "fig11_depth_map.png": depth_map(first),
        "fig12_surf.png": surf(first),
        "fig13_depth_map_2.png": depth_map(second),
        "fig14_segmented_points_2.png": segmented(second),
        "fig15_surf_2.png": surf(second),
    }
