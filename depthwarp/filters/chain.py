"""Chains of filters, their checks, and the steps that they are."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

from depthwarp.checks import is_number
from depthwarp.errors import InputError
from depthwarp.filters.blind import sparing_blind
from depthwarp.filters.dilation import dilate
from depthwarp.filters.filling import fill
from depthwarp.filters.hidden import remove_hidden
from depthwarp.filters.maps import DeviceMaps, Filter
from depthwarp.filters.plane_fill import PlaneFill
from depthwarp.filters.surround_erase import SurroundStep

__all__ = ["best", "build_steps", "check_filters", "paper"]


def paper() -> tuple[Filter, ...]:
    """The paper's chain: erase in a window of 10 px at 0.5 m, then dilation by 10 px."""
    return remove_hidden("paper", side=10, threshold=0.5), dilate("paper", side=10)


def best() -> tuple[Filter, ...]:
    """The most accurate chain: erase hidden pixels and strays, then fill with planes, by layers."""
    return remove_hidden("surround"), fill("plane")


def check_filters(filters: Sequence[Filter] | None) -> tuple[Filter, ...]:
    """A chain as a tuple; None is the empty one.

    Raises:
        InputError: Not a sequence, or one of something else than filters.
    """
    if filters is None:
        return ()
    if not isinstance(filters, list | tuple):
        raise InputError(
            "filters must be a list of filters such as dw.filters.best(), dw.filters.paper() "
            f"or [dw.filters.fill()], got {filters!r}"
        )
    for number, one in enumerate(filters):
        _check_filter(number, one)
    return tuple(filters)


def _check_filter(number: int, one: Any) -> None:
    if isinstance(one, type):
        raise InputError(
            f"filters[{number}] must be a filter, got the class {one.__name__}: make one of it, "
            f"{one.__name__}()"
        )
    if not hasattr(one, "build") and callable(one):
        name = getattr(one, "__name__", repr(one))
        raise InputError(
            f"filters[{number}] must be a filter, got the function {name}: call it, {name}()"
        )
    scratch: Any = getattr(one, "scratch_bytes", None)
    has_number = is_number(scratch)
    if not has_number or not callable(getattr(one, "build", None)):
        raise InputError(
            f"filters[{number}] must be a filter such as dw.filters.fill(), got {one!r}, which has "
            f"no {'method build' if has_number else 'number scratch_bytes'}: a filter has both, "
            "see dw.filters.Filter; dw.filters.best() and dw.filters.paper() are whole lists"
        )
    if not 0 <= scratch < math.inf:
        raise InputError(
            f"filters[{number}] must have scratch_bytes from 0 on, its working memory a pixel "
            f"[bytes], got {scratch}"
        )


def build_steps(filters: Sequence[Filter], maps: DeviceMaps) -> list[Callable[[], None]]:
    """The steps of a chain, in order; each allocates its working memory now, see `Filter.build`.

    A plane fill right after a surround erase goes on with what that found, to the same result. What
    a filter fills where the lens has no ray is taken back.
    """
    steps: list[Callable[[], None]] = []
    for one in filters:
        before = steps[-1] if steps else None
        if isinstance(one, PlaneFill) and isinstance(before, SurroundStep):
            steps.append(one.build_after(before))
        else:
            steps.append(one.build(maps))
    return steps if maps.blind is None else sparing_blind(steps, maps)
