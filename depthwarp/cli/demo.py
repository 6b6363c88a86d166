"""`depthwarp demo`: a simulated scan, its depth maps and the paper's figures; no hardware."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from depthwarp.cli.demo_figures import DemoView, draw_figures
from depthwarp.cli.demo_scan import FULL, QUARTER, scan_room
from depthwarp.cli.guard import run_command
from depthwarp.cli.options import JsonOption
from depthwarp.cli.report import Reporter, quiet_warp
from depthwarp.errors import InputError
from depthwarp.plots import require_matplotlib

if TYPE_CHECKING:
    from depthwarp.cli.demo_scores import MapScore
    from depthwarp.cloud import PointCloud
    from depthwarp.depth_map import DepthMap

__all__ = ["demo"]

POSITION = (1.79, 3.3, 1.2)
ORIENTATIONS = ((0.0, 0.0, 90.0), (0.0, 20.0, 50.0))

FOV = (60.0, 49.15)
"""C_FOV, which the paper does not print."""

DEPTH_PLANES = (6.27, None)
"""D_PD [m]: the first gives the paper's 724 x 662 pixels, the second follows from the cloud."""


def demo(
    out: Annotated[Path, typer.Option(help="Folder for the cloud, the depth map and figures.")] = (
        Path("demo")
    ),
    full: Annotated[
        bool,
        typer.Option(
            "--full", help="Use the full 1942 x 2590 sensor: some 20 minutes, 6 GB of disk."
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Scan a simulated room and draw the paper's figures.

    Needs no hardware and no GPU. The sensor has a quarter of its width and height unless --full
    is given.
    """
    reporter = Reporter(as_json)

    def command() -> None:
        quiet_warp()
        require_matplotlib()
        _make_folder(out)
        scan = scan_room(reporter, out, FULL if full else QUARTER)
        with reporter.stage("render", f"rendering {len(scan.cloud):,} points from two poses"):
            first, second = (
                _render(scan.cloud, orientation, depth_plane)
                for orientation, depth_plane in zip(ORIENTATIONS, DEPTH_PLANES, strict=True)
            )
        with reporter.stage("save", "writing the cloud and the depth map"):
            scan.cloud.save(out / "cloud.ply")
            first.depth_map.save(out / "depth.png")
            first.depth_map.save(out / "depth.npz")
        with reporter.stage("scores", "comparing the paper's filters and the best with the room"):
            scores = {"fig11": first.scores, "fig13": second.scores}
        data = [out / name for name in ("cloud.ply", "depth.png", "depth.png.json", "depth.npz")]
        figures = draw_figures(reporter, scan, first, second, out)
        _report(reporter, scan.cloud, first.depth_map, scores, [*data, *figures])

    run_command(reporter, command)


def _make_folder(out: Path) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"cannot write to {out}: {error.strerror}; choose another --out"
        ) from error


def _render(
    cloud: PointCloud, orientation: tuple[float, float, float], depth_plane: float | None
) -> DemoView:
    """One view with the paper's parameters, with its filters and with the best ones."""
    import depthwarp as dw

    view = dw.RangeView(
        POSITION, orientation, FOV, q_line=0.01, q_depth_map=0.01, depth_plane=depth_plane
    )
    depth_map, best = (
        dw.render(cloud, view, depth="range", filters=filters)
        for filters in (dw.filters.paper(), dw.filters.best())
    )
    return DemoView(view, view.line_count(cloud), depth_map, best)


def _report(
    reporter: Reporter,
    cloud: PointCloud,
    depth_map: DepthMap,
    scores: dict[str, dict[str, MapScore]],
    files: list[Path],
) -> None:
    height, width = depth_map.depth.shape
    if reporter.as_json:
        reporter.result(
            {
                "files": [str(file) for file in files],
                "points": len(cloud),
                "width": width,
                "height": height,
                "counts": dict(depth_map.stats),
                "filters": {
                    figure: {name: asdict(score) for name, score in maps.items()}
                    for figure, maps in scores.items()
                },
                "seconds": reporter.seconds,
            }
        )
        return
    reporter.say(f"{len(cloud):,} points, depth map {width} x {height} px, {len(files)} files:")
    for file in files:
        reporter.say(f"  {file}")
    for figure, maps in scores.items():
        for name, score in maps.items():
            reporter.say(f"{figure} with the filters {name}: {score}")
    shown = next(file for file in files if "fig11" in file.name)
    reporter.say(f"begin with {shown}")
