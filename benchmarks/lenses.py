"""What a lens costs: the splat through every camera model, next to the ideal pinhole.

Run `python -m benchmarks.lenses`. All cameras stand at one place, look the same way and have the
same number of pixels; a wider lens draws more of the points, which is part of its time and is
printed beside it. Models are timed in turn, so that a slow spell of the machine meets them all.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import warp as wp
from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table

import depthwarp as dw
from benchmarks.measure import Timing, alternate, machine, run_once
from benchmarks.scenes import RoomScene
from depthwarp.arrays import share_points
from depthwarp.cli.report import quiet_warp
from depthwarp.devices import resolve_device
from depthwarp.rendering import RenderConfig, RenderPlan, ViewPlan

MOST_COST = 1.5
"""What a distorted lens may cost, in times of the ideal pinhole."""

BROWN = (-0.18, 0.06, 4e-4, -3e-4, -0.008)
RATIONAL = (0.25, 0.06, 4e-4, -3e-4, 0.004, 0.43, 0.11, 0.008)
FULL = (*RATIONAL, 3e-4, -1e-4, 2e-4, 1e-4, 0.004, -0.003)


@dataclass(frozen=True)
class Row:
    """One model's figures."""

    model: str
    drawn: int
    first_call_s: float
    timing: Timing


def cameras(scene: RoomScene) -> dict[str, dw.Camera]:
    """One camera of each model at the scene's place."""
    ideal = scene.camera()
    pose, (width, height) = ideal.pose, ideal.size
    inner = (ideal.fx, ideal.fy, ideal.cx, ideal.cy, width, height, pose)
    beams = tuple(50 - 100 * row / (height - 1) for row in range(height))
    return {
        "pinhole": ideal,
        "Brown-Conrady": dw.PinholeCamera(*inner, BROWN),
        "rational": dw.PinholeCamera(*inner, RATIONAL),
        "rational, prism, tilt": dw.PinholeCamera(*inner, FULL),
        "fisheye": dw.FisheyeCamera(*inner, (-0.01, 0.002, 0.0, 0.0)),
        "double sphere": dw.DoubleSphereCamera(
            *(0.6 * f for f in inner[:2]), *inner[2:4], -0.2, 0.55, width, height, pose
        ),
        "orthographic": dw.OrthographicCamera(0.01, width, height, pose),
        "cylindrical": dw.CylindricalCamera(width, height, pose),
        "equirectangular": dw.EquirectangularCamera(width, height, pose),
        "spinning LiDAR": dw.SpinningLidar(width, beams, pose),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """The command; 1 where a distorted pinhole costs too much."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--points", type=int, default=10_000_000, help="default: 10^7")
    parser.add_argument("--repeats", type=int, default=7, help="runs of each (default: 7)")
    parser.add_argument("--device", default="cpu", help="Warp device (default: %(default)s)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="append the results, JSON lines")
    options = parser.parse_args(arguments)
    quiet_warp()
    here, scene = machine(), RoomScene(options.points)
    console = Console(highlight=False)
    console.print(f"{here['processor']}, {here['system']}, Warp {here['warp']}, {options.device}")
    rows = _measure(scene, options.device, options.repeats)
    console.print(_table(rows, options.points))
    if options.json is not None:
        _append(options.json, rows, {"machine": here, "device": options.device}, options.points)
    return 1 if any(_cost(row, rows) > MOST_COST for row in rows[:4]) else 0


def _measure(scene: RoomScene, device_name: str, repeats: int) -> list[Row]:
    device = resolve_device(device_name)
    points = share_points(scene.points_world(), device)
    config = RenderConfig(max_range=scene.max_range_m)
    plans, first, models = [], [], cameras(scene)
    for camera in models.values():
        plan = RenderPlan([ViewPlan(camera)], config, device)
        first.append(run_once(lambda plan=plan: _run(plan, points, device))[0])
        plans.append(plan)
    timings = alternate([lambda plan=plan: _run(plan, points, device) for plan in plans], repeats)
    drawn = [plan.depth_maps()[0].stats.drawn for plan in plans]
    return [Row(*row) for row in zip(models, drawn, first, timings, strict=True)]


def _run(plan: RenderPlan, points: object, device: object) -> None:
    plan.render(points)
    wp.synchronize_device(device)


def _cost(row: Row, rows: Sequence[Row]) -> float:
    return rows[0].timing.per_second(1)[1] / row.timing.per_second(1)[1]


def _table(rows: Sequence[Row], points: int) -> Table:
    table = Table(box=SIMPLE_HEAD, pad_edge=False)
    table.add_column("model")
    for title in ("million points/s", "quartiles", "times pinhole", "pixels drawn", "first [s]"):
        table.add_column(title, justify="right")
    for row in rows:
        low, middle, high = (value / 1e6 for value in row.timing.per_second(points))
        table.add_row(
            row.model,
            f"{middle:.1f}",
            f"{low:.1f} - {high:.1f}",
            f"{_cost(row, rows):.2f}",
            f"{row.drawn:,}",
            f"{row.first_call_s:.2f}",
        )
    return table


def _append(file: Path, rows: Sequence[Row], about: dict[str, object], points: int) -> None:
    date = datetime.now(UTC).isoformat(timespec="seconds")
    with file.open("a", encoding="utf-8") as stream:
        for row in rows:
            entry = {
                "benchmark": "lenses",
                "date": date,
                **about,
                "points": points,
                "model": row.model,
                "points_per_s": row.timing.per_second(points),
                "times_pinhole": _cost(row, rows),
                "pixels_drawn": row.drawn,
                "first_call_s": row.first_call_s,
                "wall_s": row.timing.wall_s,
            }
            stream.write(json.dumps(entry) + "\n")


if __name__ == "__main__":
    raise SystemExit(main())
