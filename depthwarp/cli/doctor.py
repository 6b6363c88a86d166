"""`depthwarp doctor`: what works on this machine."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import platform
import sys
import time
from typing import Any

import numpy as np
import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

import depthwarp
from depthwarp.cli.guard import OUR_FAILURE, run_command
from depthwarp.cli.options import JsonOption
from depthwarp.cli.report import Reporter, quiet_warp

__all__ = ["doctor"]

CORE = ("warp-lang", "numpy", "opencv-python-headless", "pyserial", "typer", "rich")
EXTRAS = {"viz": "matplotlib", "exr": "OpenEXR", "zarr": "zarr"}


def doctor(as_json: JsonOption = False) -> None:
    """Say what works on this machine: versions, devices, extras, serial ports.

    Renders a small cloud on every device and compares the bits. Exits with 1 if a device fails.
    """
    reporter = Reporter(as_json)

    def command() -> None:
        quiet_warp()
        with reporter.stage("devices", "rendering a test cloud on every device"):
            devices = check_devices()
        report = {
            "depthwarp": depthwarp.__version__,
            "python": platform.python_version(),
            "platform": platform.platform(),
            "packages": {name: importlib.metadata.version(name) for name in CORE},
            "extras": {
                extra: importlib.util.find_spec(module) is not None
                for extra, module in EXTRAS.items()
            },
            "kernel_cache": _kernel_cache(),
            "devices": devices,
            "serial_ports": _serial_ports(),
        }
        if as_json:
            reporter.result(report)
        else:
            _print(report)
        if not all(device["ok"] for device in devices):
            raise typer.Exit(OUR_FAILURE)

    run_command(reporter, command)


def check_devices() -> list[dict[str, Any]]:
    """Render one small cloud on every device; `ok` where the bits are those of the CPU."""
    import warp as wp

    import depthwarp as dw
    from depthwarp.devices import free_memory

    points = np.random.default_rng(0).uniform(-4, 4, (20_000, 3)).astype(np.float32)
    camera = dw.PinholeCamera.from_fov(fov=(80, 60), size=(160, 120), orientation=(0, 10, 30))
    expected: dw.DepthMap | None = None
    found = []
    for device in wp.get_devices():  # the CPU is always the first
        about = {
            "name": device.alias,
            "description": device.name,
            "free_memory_gb": round(free_memory(device) / 1e9, 2),
        }
        try:
            start = time.perf_counter()
            depth_map = dw.render(
                dw.PointCloud(points), camera, filters=dw.filters.paper(), device=device.alias
            )
            about["first_render_s"] = round(time.perf_counter() - start, 3)
            expected = expected or depth_map
            about["ok"] = all(
                np.array_equal(getattr(depth_map, name), getattr(expected, name))
                for name in ("depth", "index", "state")
            )
            about["problem"] = None if about["ok"] else "the result differs from the CPU's"
        except Exception as error:  # the doctor reports whatever a device does
            about |= {"ok": False, "problem": f"{type(error).__name__}: {error}"}
        found.append(about)
    return found


def _kernel_cache() -> str:
    import warp as wp

    return str(wp.config.kernel_cache_dir)


def _serial_ports() -> list[str]:
    from serial.tools import list_ports

    return [port.device for port in list_ports.comports()]


def _print(report: dict[str, Any]) -> None:
    table = Table(show_header=False, box=None, pad_edge=False)
    table.add_row("depthwarp", f"{report['depthwarp']}, Python {report['python']}")
    table.add_row("platform", report["platform"])
    for name, version in report["packages"].items():
        table.add_row(name, version)
    for extra, present in report["extras"].items():
        remedy = escape(f'not installed: pip install "depthwarp[{extra}]"')
        table.add_row(f"extra {extra}", "installed" if present else remedy)
    table.add_row("kernel cache", report["kernel_cache"])
    for device in report["devices"]:
        verdict = f"FAILS: {device['problem']}"
        if device["ok"]:
            verdict = "works" if device["name"] == "cpu" else "works, same bits as the CPU"
        table.add_row(
            f"device {device['name']}",
            f"{escape(device['description'])}, {device['free_memory_gb']} GB free, "
            f"{escape(verdict)}",
        )
    table.add_row("serial ports", ", ".join(report["serial_ports"]) or "none")
    Console(file=sys.stdout, highlight=False).print(table)
