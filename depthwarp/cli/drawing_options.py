"""Options of the commands that draw: image, depth, filters, range."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from depthwarp.filters import Filter

__all__ = [
    "CameraNameOption",
    "DepthChoice",
    "DepthOption",
    "EncodingChoice",
    "FilterChoice",
    "FiltersOption",
    "FovOption",
    "MaxRangeOption",
    "MinRangeOption",
    "SizeOption",
    "chain_of",
]


class DepthChoice(StrEnum):
    """Depth kinds by name."""

    range = "range"
    z = "z"


class EncodingChoice(StrEnum):
    """16-bit encodings by name."""

    range16 = "range16"
    millimetres = "millimetres"
    kitti = "kitti"


class FilterChoice(StrEnum):
    """Filter chains by name."""

    paper = "paper"
    best = "best"
    none = "none"


CameraNameOption = Annotated[
    str | None, typer.Option(metavar="NAME", help="Which camera of a file with several.")
]
FovOption = Annotated[
    tuple[float, float] | None,
    typer.Option(metavar="H V", help="Field of view, horizontal and vertical [degrees]."),
]
SizeOption = Annotated[
    tuple[int, int] | None,
    typer.Option(
        metavar="W H",
        help="Image size [px]: a camera with the field of view, or of a file without one.",
    ),
]
DepthOption = Annotated[
    DepthChoice, typer.Option(help="Euclidean range, or z along the optical axis.")
]
MinRangeOption = Annotated[float, typer.Option(help="Nearest depth that is drawn [m].")]
MaxRangeOption = Annotated[float, typer.Option(help="Farthest depth that is drawn [m].")]
FiltersOption = Annotated[
    FilterChoice,
    typer.Option(
        help="The paper's erase and dilation; the best hidden-point removal and filling; or none."
    ),
]


def chain_of(choice: FilterChoice) -> tuple[Filter, ...]:
    """The filters of a choice."""
    from depthwarp.filters import best, paper

    return {FilterChoice.paper: paper, FilterChoice.best: best, FilterChoice.none: tuple}[choice]()
