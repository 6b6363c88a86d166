"""`--filters`: chains by name."""

from __future__ import annotations

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from depthwarp.filters import Filter

__all__ = ["FilterChoice", "FiltersOption", "chain_of"]


class FilterChoice(StrEnum):
    """Filter chains by name."""

    paper = "paper"
    best = "best"
    none = "none"


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
