"""The demo's figures: which of the paper's is drawn from what."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from depthwarp import plots
from depthwarp.cli.demo_scan import DemoScan
from depthwarp.cli.demo_scores import RIGHT_WITHIN, MapScore, room_depth, score_map, wrong_pixels
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
    """One of the paper's two views of the cloud.

    Attributes:
        range_view: The view.
        line_count: Its rectangles.
        depth_map: What it shows, with the paper's filters.
        best: The same with `dw.filters.best()`.
    """

    range_view: RangeView
    line_count: int
    depth_map: DepthMap
    best: DepthMap

    @cached_property
    def exact(self) -> NDArray[np.float64]:
        """The room's range [m] in every pixel, shape (H, W)."""
        return room_depth(self.depth_map.camera)

    @property
    def maps(self) -> dict[str, DepthMap]:
        """The two maps by the names that `--filters` knows them by."""
        return {"paper": self.depth_map, "best": self.best}

    @property
    def scores(self) -> dict[str, MapScore]:
        """How good the two maps are, by the same names."""
        return {name: score_map(depth_map, self.exact) for name, depth_map in self.maps.items()}

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
    """Draw the paper's Figures 1 to 15, but its sketches 7, 9 and 10; returns the files.

    Figures 11 and 13 are also drawn with the best filters, alone and beside the paper's.
    """
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

    def best(view: DemoView) -> Callable[[Path], None]:
        title = f"Depth map, {view.pose}, best filters"
        return partial(plots.plot_depth_map, view.best.depth, title=title)

    def both(view: DemoView) -> Callable[[Path], None]:
        return partial(
            plots.plot_depth_maps,
            [depth_map.depth for depth_map in view.maps.values()],
            [wrong_pixels(depth_map, view.exact) for depth_map in view.maps.values()],
            [_caption(name, score) for name, score in view.scores.items()],
            title=f"Depth map, {view.pose}",
            mark=f"more than {100 * RIGHT_WITHIN:g} cm off",
        )

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
        "fig11_depth_map_best.png": best(first),
        "fig11_paper_and_best.png": both(first),
        "fig12_surf.png": surf(first),
        "fig13_depth_map_2.png": depth_map(second),
        "fig13_depth_map_2_best.png": best(second),
        "fig13_paper_and_best_2.png": both(second),
        "fig14_segmented_points_2.png": segmented(second),
        "fig15_surf_2.png": surf(second),
    }


def _caption(name: str, score: MapScore) -> str:
    """A map's filters and its shares, in lines as long as the map is wide."""
    which = {"paper": "the paper's filters", "best": "the best filters"}[name]
    return (
        f"{which} (--filters {name})\n"
        f"{score.covered:.0%} of the pixels hold a depth\n"
        f"({score.measured:.1%} measured, {score.filled:.1%} filled)\n"
        f"{score.right:.0%} are right within {100 * RIGHT_WITHIN:g} cm, {score.wrong:.0%} are not"
    )
