"""`depthwarp bench`: the benchmark harness of the source tree."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

import depthwarp
from depthwarp.cli.guard import run_command
from depthwarp.cli.options import DeviceOption, JsonOption
from depthwarp.cli.report import Reporter, quiet_warp
from depthwarp.errors import InputError

__all__ = ["bench"]


def bench(
    scene: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Scene; may be given again. The room unless given; a wrong name lists all.",
        ),
    ] = None,
    points: Annotated[
        list[int] | None,
        typer.Option(
            metavar="N", min=1, help="Points; may be given again. The scene's own unless given."
        ),
    ] = None,
    views: Annotated[int, typer.Option(metavar="N", min=1, help="Views all round.")] = 1,
    repeats: Annotated[int, typer.Option(metavar="N", min=1, help="Timed runs of each.")] = 7,
    device: DeviceOption = None,
    as_json: JsonOption = False,
) -> None:
    """Measure how fast depth images are drawn, next to other libraries that are installed.

    Needs the source tree, whose benchmarks/README.md says the method; `python -m benchmarks.splat`
    there knows more.
    """
    reporter = Reporter(as_json)

    def command() -> None:
        find_benchmarks()
        quiet_warp()
        from depthwarp.devices import resolve_device

        harness: Any = importlib.import_module("benchmarks.harness")
        catalogue: Any = importlib.import_module("benchmarks.scene_catalogue")
        settings = harness.Settings(
            catalogue.chosen_scenes(scene or ["room"], points or [], "made"),
            views,
            repeats,
            resolve_device(device).alias,
        )
        console = Console(stderr=as_json, highlight=False, markup=False)
        with harness.empty_kernel_cache():
            results = harness.run_scenes(settings, console)
        if as_json:
            reporter.result({"results": results})

    run_command(reporter, command)


def find_benchmarks() -> None:
    """See to it that the package `benchmarks` can be imported.

    Raises:
        InputError: The source tree is neither round the package nor the current folder.
    """
    for root in (Path(depthwarp.__file__).resolve().parents[1], Path.cwd()):
        if (root / "benchmarks" / "harness.py").is_file() and str(root) not in sys.path:
            sys.path.append(str(root))
    importlib.invalidate_caches()
    found = importlib.util.find_spec("benchmarks")
    if found is None or importlib.util.find_spec("benchmarks.harness") is None:
        raise InputError(
            "benchmarks are in depthwarp's source tree, which is not here: "
            "run `depthwarp bench` in the folder of a clone"
        )
