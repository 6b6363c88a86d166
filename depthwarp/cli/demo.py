"""`depthwarp demo`: a simulated scan, its depth maps and the paper's figures; no hardware."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from depthwarp.cli.guard import run_command
from depthwarp.cli.options import JsonOption
from depthwarp.cli.report import Reporter, quiet_warp
from depthwarp.errors import InputError
from depthwarp.plots import require_matplotlib

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from depthwarp.cloud import PointCloud
    from depthwarp.depth_map import DepthMap
    from depthwarp.range_view import RangeView

__all__ = ["demo"]

POSITION = (1.79, 3.3, 1.2)
ORIENTATIONS = ((0.0, 0.0, 90.0), (0.0, 20.0, 50.0))
FOV = (60.0, 49.15)
"""C_FOV, which the paper does not print: with it the room gives the paper's 724 x 662 pixels."""

HEAD = (1.8, 5.15, 1.25)
"""Where the scanner's head stands in the room [m]: in front of the camera, not at it."""

CEILING = 2.6
"""Height [m] above which the clouds of the figures are cut, so that one looks into the room."""

SEED = 2015
EDGE_RECTANGLES = 12
"""Rectangles of a range view that a figure shows: the last one and some before it."""


@dataclass(frozen=True)
class View:
    """One of the paper's two views of the cloud: what the figures of it need."""

    range_view: RangeView
    line_count: int
    depth_map: DepthMap


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the cloud, the depth map and figures.")] = (
        Path("demo")
    ),
    as_json: JsonOption = False,
) -> None:
    """Scan a simulated room and draw the paper's figures.

    Needs no hardware and no GPU.
    """
    reporter = Reporter(as_json)

    def command() -> None:
        quiet_warp()
        require_matplotlib()
        _make_folder(out)
        with reporter.stage("scan", "scanning a simulated room, one turn of the head"):
            cloud = _scan()
        with reporter.stage("render", f"rendering {len(cloud):,} points from two poses"):
            views = _render(cloud, ORIENTATIONS[0]), _render(cloud, ORIENTATIONS[1])
        with reporter.stage("save", "writing the cloud and the depth map"):
            cloud.save(out / "cloud.ply")
            views[0].depth_map.save(out / "depth.png")
            views[0].depth_map.save(out / "depth.npz")
        data = [out / name for name in ("cloud.ply", "depth.png", "depth.png.json", "depth.npz")]
        figures = _draw_figures(reporter, cloud, views, out)
        _report(reporter, cloud, views[0].depth_map, [*data, *figures])

    run_command(reporter, command)


def _make_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"cannot write to {out}: {error.strerror}; choose another --out"
        ) from error


def _scan() -> PointCloud:
    """One turn of the paper's head (Section 2) in the furnished room."""
    from depthwarp.scanner.head import RotatingHead
    from depthwarp.scanner.room import furnished_room

    return RotatingHead(position=HEAD).scan(furnished_room(), seed=SEED)


def _render(cloud: PointCloud, orientation: tuple[float, float, float]) -> View:
    """One view with the paper's parameters and filters."""
    import depthwarp as dw

    view = dw.RangeView(POSITION, orientation, FOV, q_line=0.01, q_depth_map=0.01)
    depth_map = dw.render(cloud, view, depth="range", filters=dw.filters.paper())
    return View(view, view.line_count(cloud), depth_map)


def _draw_figures(
    reporter: Reporter, cloud: PointCloud, views: tuple[View, View], out: Path
) -> list[Path]:
    """The paper's Figures 3 to 15, but its sketches 7, 9 and 10."""
    from depthwarp import plots

    first, second = views
    below_ceiling = cloud.points_world[:, 2] < CEILING
    points, rotation = cloud.points_world[below_ceiling], first.range_view.pose.rotation
    edges = [_shown_rectangles(view) for view in views]
    selected = [view.range_view.segment(cloud)[below_ceiling] for view in views]
    first_pose, second_pose = (
        f"C_O = {orientation}" for orientation in ("(0, 0, 90)", "(0, 20, 50)")
    )
    figures: dict[str, Callable[[Path], None]] = {
        "fig03_point_cloud.png": partial(
            plots.plot_point_cloud, points, title="3D point cloud, the ceiling left out"
        ),
        "fig04_rotated_cloud.png": partial(plots.plot_rotated_cloud, points, rotation),
        "fig05_range_view_angles.png": partial(
            plots.plot_range_view_angles, POSITION, edges[0], rotation, ORIENTATIONS[0]
        ),
        "fig06_range_view.png": partial(
            plots.plot_range_view,
            points,
            POSITION,
            edges[0],
            title="Constructed range view at P_C = (1.79, 3.3, 1.2)",
        ),
        "fig08_segmented_points.png": partial(
            plots.plot_segmented_points,
            points,
            selected[0],
            POSITION,
            edges[0],
            title=f"Segmented points, {first_pose}",
        ),
        "fig11_depth_map.png": partial(
            plots.plot_depth_map, first.depth_map.depth, title=f"Depth map, {first_pose}"
        ),
        "fig12_surf.png": partial(
            plots.plot_surf, first.depth_map.depth, title=f"Depth map as a surface, {first_pose}"
        ),
        "fig13_depth_map_2.png": partial(
            plots.plot_depth_map, second.depth_map.depth, title=f"Depth map, {second_pose}"
        ),
        "fig14_segmented_points_2.png": partial(
            plots.plot_segmented_points,
            points,
            selected[1],
            POSITION,
            edges[1],
            title=f"Segmented points, {second_pose}",
        ),
        "fig15_surf_2.png": partial(
            plots.plot_surf, second.depth_map.depth, title=f"Depth map as a surface, {second_pose}"
        ),
    }
    for name, draw in figures.items():
        with reporter.stage("figures", f"drawing {out / name}"):
            draw(out / name)
    return [out / name for name in figures]


def _shown_rectangles(view: View) -> NDArray[np.float64]:
    """Some rectangles of a view, evenly spaced, the depth plane last, shape (K, 4, 3)."""
    corners = view.range_view.corners_world(view.line_count)
    step = max(1, view.line_count // EDGE_RECTANGLES)
    return corners[::-step][::-1]


def _report(reporter: Reporter, cloud: PointCloud, depth_map: DepthMap, files: list[Path]) -> None:
    height, width = depth_map.depth.shape
    if reporter.as_json:
        reporter.result(
            {
                "files": [str(file) for file in files],
                "points": len(cloud),
                "width": width,
                "height": height,
                "counts": dict(depth_map.stats),
                "seconds": reporter.seconds,
            }
        )
        return
    reporter.say(f"{len(cloud):,} points, depth map {width} x {height} px, {len(files)} files:")
    for file in files:
        reporter.say(f"  {file}")
    reporter.say(f"begin with {files[-5]}")
