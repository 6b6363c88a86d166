"""`depthwarp info`: what is in a point cloud's file."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from depthwarp.cli.guard import run_command
from depthwarp.cli.options import CloudArgument, JsonOption, OffsetOption
from depthwarp.cli.report import Reporter, quiet_warp
from depthwarp.cloud import PointCloud

__all__ = ["info"]


def info(cloud: CloudArgument, offset: OffsetOption = None, as_json: JsonOption = False) -> None:
    """Say what is in a point cloud: points, extent, attributes."""
    reporter = Reporter(as_json)

    def command() -> None:
        quiet_warp()
        import depthwarp as dw

        with reporter.stage("read", f"reading {cloud}"):
            points = dw.read(cloud, offset=offset)
        summary = {"file": str(cloud), "bytes": cloud.stat().st_size} | summarize(points)
        if as_json:
            reporter.result(summary | {"seconds": reporter.seconds})
        else:
            _print(summary)

    run_command(reporter, command)


def summarize(cloud: PointCloud) -> dict[str, Any]:
    """Counts, bounds [m] of the finite points, distances from the origin [m], and attributes."""
    points = cloud.points_world
    finite = points[np.isfinite(points).all(axis=1)].astype(np.float64)
    summary: dict[str, Any] = {"points": len(cloud), "finite_points": len(finite)}
    if len(finite):
        low, high = finite.min(axis=0), finite.max(axis=0)
        distance = np.linalg.norm(finite, axis=1)
        summary |= {
            "min_m": low.tolist(),
            "max_m": high.tolist(),
            "extent_m": (high - low).tolist(),
            "farthest_from_origin_m": float(distance.max()),
            "median_from_origin_m": float(np.median(distance)),
        }
    summary["attributes"] = {
        name: {"dtype": str(values.dtype), "shape": list(values.shape)} | _extremes(values)
        for name, values in cloud.attributes.items()
    }
    return summary


def _extremes(values: np.ndarray[Any, np.dtype[Any]]) -> dict[str, float]:
    """Smallest and largest finite value of a numeric attribute."""
    if not np.issubdtype(values.dtype, np.number):
        return {}
    finite = values[np.isfinite(values)]
    return {"min": float(finite.min()), "max": float(finite.max())} if finite.size else {}


def _print(summary: dict[str, Any]) -> None:
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_row("file", f"{summary['file']} ({summary['bytes'] / 1e6:.2f} MB)")
    table.add_row("points", f"{summary['points']:,} ({summary['finite_points']:,} finite)")
    if "min_m" in summary:
        for axis, name in enumerate("xyz"):
            low, high = summary["min_m"][axis], summary["max_m"][axis]
            table.add_row(f"{name} [m]", f"{low:.3f} to {high:.3f} ({high - low:.3f})")
        table.add_row(
            "distance [m]",
            f"median {summary['median_from_origin_m']:.3f}, "
            f"largest {summary['farthest_from_origin_m']:.3f} from the origin",
        )
    for name, about in summary["attributes"].items():
        columns = "" if len(about["shape"]) == 1 else f" x {about['shape'][1]}"
        bounds = f", {about['min']:g} to {about['max']:g}" if "min" in about else ""
        table.add_row(name, f"{about['dtype']}{columns}{bounds}")
    Console(file=sys.stdout, highlight=False).print(table)
