"""The program `depthwarp`: its commands, and what every one of them does about errors."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

import depthwarp
from depthwarp.cli.batch import batch
from depthwarp.cli.bench import bench
from depthwarp.cli.calibrate import calibrate
from depthwarp.cli.demo import demo
from depthwarp.cli.doctor import doctor
from depthwarp.cli.info import info
from depthwarp.cli.render import render
from depthwarp.cli.replay import replay
from depthwarp.cli.scan import scan

__all__ = ["app", "main"]

app = typer.Typer(
    name="depthwarp",
    help="Depth maps from 3D point clouds, from any pose, on CPU and GPU.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.command()(demo)
app.command()(render)
app.command()(batch)
app.command()(info)
app.command()(scan)
app.command()(replay)
app.command()(calibrate)
app.command()(doctor)
app.command()(bench)


def _print_version(wanted: bool) -> None:
    if wanted:
        sys.stdout.write(f"depthwarp {depthwarp.__version__}\n")
        raise typer.Exit


@app.callback()
def _program(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    """Depth maps from 3D point clouds, from any pose, on CPU and GPU."""


def main() -> None:
    """Run the program."""
    app()
