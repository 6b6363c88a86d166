"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

__all__ = ["CloudArgument", "DeviceOption", "JsonOption", "OffsetOption", "TWIN"]

TWIN = "twin"
"""The axis, and the camera, of the scanner that needs no hardware."""

CloudArgument = Annotated[
    Path,
    typer.Argument(metavar="CLOUD", help="Point cloud: ply, pcd, xyz, txt, csv, pts, npz, bin."),
]
DeviceOption = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="cpu or cuda:N; the first GPU if there is one."),
]
JsonOption = Annotated[
    bool, typer.Option("--json", help="Print one JSON object on stdout and nothing else there.")
]
OffsetOption = Annotated[
    tuple[float, float, float] | None,
    typer.Option(metavar="X Y Z", help="Subtracted from every point [m], for map coordinates."),
]
