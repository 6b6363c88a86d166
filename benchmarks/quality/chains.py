"""What is compared: each chain removes hidden points, then fills; either may be left out."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

import depthwarp as dw
from benchmarks.quality import peers
from benchmarks.quality.maps import Step, erase_where
from benchmarks.quality.plain_surround import plain_surround
from benchmarks.quality.truth import Label
from depthwarp.errors import InputError
from depthwarp.filters import Filter

__all__ = ["Chain", "Outcome", "chains", "library_chain", "run"]


@dataclass(frozen=True)
class Chain:
    """A way from the splat to the filled map.

    Attributes:
        name: How it is called.
        hide: Removes hidden points; None leaves all.
        fill: Fills; None leaves the gaps.
        is_bound: Whether it is told the truth first: whatever is hidden or bogus is erased.
        filters: The whole chain where it is depthwarp's own, as a plan takes it.
    """

    name: str
    hide: Step | None = None
    fill: Step | None = None
    is_bound: bool = False
    filters: tuple[Filter, ...] = ()


@dataclass(frozen=True)
class Outcome:
    """What a chain made of a splat.

    Attributes:
        filtered: The map after the removal of hidden points.
        filled: The map after the filling.
        seconds: Of both steps, wall clock.
    """

    filtered: dw.DepthMap
    filled: dw.DepthMap
    seconds: float


def library_chain(
    name: str, hide: Sequence[Filter], fill: Sequence[Filter], device: str = "cpu"
) -> Chain:
    """A chain of depthwarp's own filters."""
    first, second = (_library(filters, device) if filters else None for filters in (hide, fill))
    return Chain(name, first, second, filters=(*hide, *fill))


def chains(device: str = "cpu") -> tuple[list[Chain], list[str]]:
    """All chains that this machine has, and why others are left out."""
    found, missing = [Chain("raw splat")], []
    for name, make in _MAKERS.items():
        try:
            found.append(replace(make(device), name=name))
        except (AttributeError, ImportError, InputError, TypeError, ValueError) as error:
            missing.append(f"{name} is left out: {error}")
    return found, missing


def run(
    chain: Chain, raw: dw.DepthMap, cloud: dw.PointCloud, label: npt.NDArray[np.uint8]
) -> Outcome:
    """Run a chain on a splat.

    Args:
        chain: What to run.
        raw: The splat.
        cloud: Its points.
        label: What its winners are, values of `Label`, shape (H, W); for the bound alone.
    """
    if chain.is_bound:
        raw = erase_where(raw, (label == Label.HIDDEN) | (label == Label.BOGUS))
    start = time.perf_counter()
    filtered = raw if chain.hide is None else chain.hide(raw, cloud)
    whole = filtered if chain.fill is None else chain.fill(filtered, cloud)
    return Outcome(filtered, whole, time.perf_counter() - start)


def _library(filters: Sequence[Filter], device: str) -> Step:
    return lambda depth_map, _: dw.filters.apply(depth_map, tuple(filters), device=device)


def _paper(side: int, method: Literal["paper", "nearest"], device: str) -> Chain:
    erase = dw.filters.remove_hidden("paper", side=side, threshold=0.5)
    return library_chain("", [erase], [dw.filters.dilate(method, side=10)], device)


def _best(device: str, *more: Filter) -> Chain:
    hide, *fill = dw.filters.best()
    return library_chain("", [hide], [*fill, *more], device)


_MAKERS: dict[str, Callable[[str], Chain]] = {
    "paper": lambda device: _paper(10, "paper", device),
    "paper, side 21": lambda device: _paper(21, "paper", device),
    "paper, nearer grows": lambda device: _paper(10, "nearest", device),
    "cone + nearest": lambda device: Chain(
        "", _library([dw.filters.remove_hidden("cone")], device), peers.nearest(10)
    ),
    "Katz + nearest": lambda device: Chain("", peers.katz(), peers.nearest(10)),
    "plain surround": lambda device: Chain("", plain_surround(), _best(device).fill),
    "IP-Basic": lambda device: Chain("", None, peers.ip_basic()),
    "nearest pixel": lambda device: Chain("", None, peers.nearest(10)),
    "OpenCV inpainting": lambda device: Chain("", None, peers.inpaint()),
    "best + nearest": lambda device: Chain("", _best(device).hide, peers.nearest(10)),
    "best + push-pull": lambda device: library_chain(
        "", dw.filters.best()[:1], [dw.filters.fill("push_pull")], device
    ),
    "best, then push-pull": lambda device: _best(device, dw.filters.fill("push_pull")),
    "best": _best,
    "bound + nearest": lambda device: Chain("", None, peers.nearest(10), is_bound=True),
    "bound + best's fill": lambda device: Chain("", None, _best(device).fill, is_bound=True),
}
"""By name; `paper` is `dw.filters.paper()`: a window of side 10, then dilation by 10."""
