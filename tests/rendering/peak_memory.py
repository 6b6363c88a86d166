"""Prints by how many bytes a render raises the peak of its process's memory: run on its own."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

import depthwarp as dw
from depthwarp.devices import resolve_device
from depthwarp.rendering import RenderConfig, RenderPlan, ViewPlan
from depthwarp.rendering.inputs import device_points

CPU = resolve_device("cpu")


def kilobytes(name: str) -> int:
    """A line of this process's memory in /proc."""
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(name + ":"):
            return int(line.split()[1])
    raise LookupError(name)


def draw(source: dw.PointCloud | dw.PreparedCloud, side: int, threads: int) -> None:
    """A view of a cloud, from the plan to the map."""
    camera = dw.PinholeCamera.from_fov((90, 90), (side, side))
    plan = RenderPlan([ViewPlan(camera)], RenderConfig(), CPU, threads=threads)
    plan.render(device_points(source, CPU))
    plan.depth_maps()


def main(kind: str, side: int, threads: int, points: int) -> None:
    """Draw a view of so many pixels a side twice: small for the kernels, large for the peak."""
    rng = np.random.default_rng(1)
    cloud = dw.PointCloud(rng.random((points, 3), dtype=np.float32) * 6 - 3)
    source = cloud.prepare(device="cpu") if kind == "prepared" else cloud
    draw(source, 8, threads)
    before = kilobytes("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    draw(source, side, threads)
    print((kilobytes("VmHWM") - before) * 1024)


if __name__ == "__main__":
    main(sys.argv[1], *map(int, sys.argv[2:]))
