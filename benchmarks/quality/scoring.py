"""Scores of a depth map against the truth, as counts that add up over views."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Self

import numpy as np
import numpy.typing as npt

from benchmarks.quality.truth import Label
from depthwarp import DepthMap, State

__all__ = ["NEAR_M", "Errors", "Removal", "errors", "removal"]

NEAR_M = 0.05
"""A depth within this of the truth is right, along the optical axis."""


@dataclass(frozen=True)
class _Counts:
    """Numbers that add up, field by field."""

    def __add__(self, other: Self) -> Self:
        own = fields(self)
        return type(self)(*(getattr(self, f.name) + getattr(other, f.name) for f in own))


@dataclass(frozen=True)
class Removal(_Counts):
    """What a hidden-point filter kept and erased: pixels that a point of known label fell in.

    Attributes:
        visible: Pixels whose winner is truly visible.
        visible_erased: Those of them that are gone.
        kept: Pixels that are left.
        hidden_kept: Those of them whose winner is hidden.
        bogus_kept: Those of them whose winner is a mixed pixel or a stray.
    """

    visible: int = 0
    visible_erased: int = 0
    kept: int = 0
    hidden_kept: int = 0
    bogus_kept: int = 0

    @property
    def leak(self) -> float:
        """Share of what is left whose winner is hidden."""
        return _share(self.hidden_kept, self.kept)

    @property
    def bogus(self) -> float:
        """Share of what is left whose winner is bogus."""
        return _share(self.bogus_kept, self.kept)

    @property
    def lost(self) -> float:
        """Share of the truly visible that was erased."""
        return _share(self.visible_erased, self.visible)


@dataclass(frozen=True)
class Errors(_Counts):
    """How a filled map differs from the truth, over pixels whose truth counts.

    Attributes:
        pixels: Pixels that count.
        covered: Those that are not empty.
        near: Those whose depth is right.
        absolute: Sum of the absolute errors of the covered [m].
        square: Sum of their squares [m^2].
    """

    pixels: int = 0
    covered: int = 0
    near: int = 0
    absolute: float = 0.0
    square: float = 0.0

    @property
    def coverage(self) -> float:
        """Share that is not empty."""
        return _share(self.covered, self.pixels)

    @property
    def within(self) -> float:
        """Share whose depth is right; an empty pixel is a miss."""
        return _share(self.near, self.pixels)

    @property
    def mae(self) -> float:
        """Mean absolute error of the covered [m]."""
        return _share(self.absolute, self.covered)

    @property
    def rmse(self) -> float:
        """Root of their mean square error [m]."""
        return math.sqrt(_share(self.square, self.covered))


def removal(raw: DepthMap, filtered: DepthMap, label: npt.NDArray[np.uint8]) -> Removal:
    """Score a hidden-point filter.

    Args:
        raw: The splat.
        filtered: The same after the filter.
        label: What each winner of the splat is, values of `Label`, shape (H, W).
    """
    drawn = (raw.index >= 0) & (label != Label.UNKNOWN)
    kept = drawn & (filtered.state == State.MEASURED)
    visible = drawn & (label == Label.VISIBLE)
    return Removal(
        visible=_count(visible),
        visible_erased=_count(visible & ~kept),
        kept=_count(kept),
        hidden_kept=_count(kept & (label == Label.HIDDEN)),
        bogus_kept=_count(kept & (label == Label.BOGUS)),
    )


def errors(
    depth: npt.NDArray[np.floating],
    truth: npt.NDArray[np.floating],
    counts: npt.NDArray[np.bool_],
    near: float = NEAR_M,
) -> Errors:
    """Score a filled map.

    Args:
        depth: The map [m], 0 = empty, shape (H, W).
        truth: True depth [m], shape (H, W).
        counts: Pixels that count, shape (H, W).
        near: What a right depth may differ by [m].
    """
    covered = counts & (depth > 0)
    error = np.abs(depth[covered].astype(np.float64) - truth[covered])
    return Errors(
        pixels=_count(counts),
        covered=_count(covered),
        near=_count(error <= near),
        absolute=float(error.sum()),
        square=float((error**2).sum()),
    )


def _count(mask: npt.NDArray[np.bool_]) -> int:
    return int(np.count_nonzero(mask))


def _share(part: float, whole: float) -> float:
    return part / whole if whole else 0.0
