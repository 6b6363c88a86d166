"""Scoring chains on a case: scan, splat, filter, fill, compare with the truth."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import warp as wp

import depthwarp as dw
from benchmarks.quality.cases import Case, Stage, stage
from benchmarks.quality.chains import Chain, Outcome, run
from benchmarks.quality.scanning import scan
from benchmarks.quality.scoring import NEAR_M, Errors, Removal, errors, removal
from benchmarks.quality.truth import Label, View, labels
from depthwarp.arrays import share_points
from depthwarp.devices import resolve_device
from depthwarp.rendering import RenderConfig, RenderPlan, ViewPlan

__all__ = ["Score", "Shot", "evaluate", "plan_seconds", "shots"]

TIMED_RUNS = 21


@dataclass(frozen=True, eq=False)
class Shot:
    """A view of a scan: the splat, and what is true.

    Attributes:
        view: Camera and truth.
        cloud: The scan.
        raw: Its splat.
        label: What the winners are, values of `Label`, shape (H, W).
        near: What a right depth may differ by [m].
        held_out: Pixels that were kept from the cloud and judge the filled map, shape (H, W);
            None: all that the view says was observed.
    """

    view: View
    cloud: dw.PointCloud
    raw: dw.DepthMap
    label: npt.NDArray[np.uint8]
    near: float = NEAR_M
    held_out: npt.NDArray[np.bool_] | None = None

    @property
    def label_observed(self) -> npt.NDArray[np.uint8]:
        """The labels, unknown where no scan position observed, shape (H, W)."""
        return np.where(self.view.observed, self.label, np.uint8(Label.UNKNOWN))

    @property
    def judged(self) -> npt.NDArray[np.bool_]:
        """Pixels whose depth counts after filling, shape (H, W)."""
        return self.view.observed if self.held_out is None else self.held_out


@dataclass(frozen=True)
class Score:
    """One chain on one case, all views together.

    Attributes:
        chain: Its name.
        removal: Of the hidden-point filter alone, where some scan position observed.
        anywhere: The same over all pixels, also where the surface in front has no points at all, so
            that no filter can know of it.
        everywhere: Of the filled map, where some scan position observed.
        band: The same within 5 px of true depth edges.
        milliseconds: Median of a view: filters of depthwarp inside a plan, others on the host.
    """

    chain: str
    removal: Removal
    anywhere: Removal
    everywhere: Errors
    band: Errors
    milliseconds: float


def shots(case: Case, views: int, device: str = "cpu") -> list[Shot]:
    """The scan of a case, seen from the first so many views."""
    ready = stage(case.scene, views)
    cloud, found = _splats(case, ready, device)
    return [
        Shot(view, cloud, raw, label) for view, (raw, label) in zip(ready.views, found, strict=True)
    ]


def evaluate(
    taken: Sequence[Shot], chains: Sequence[Chain], device: str = "cpu"
) -> Iterator[Score]:
    """Score chains on a case, one after the other.

    Args:
        taken: Its views.
        chains: What to score.
        device: Where depthwarp's filters are timed.
    """
    for chain in chains:
        first = taken[0]
        run(chain, first.raw, first.cloud, first.label)  # compiles what has to be compiled
        counts, anywhere, everywhere, band = Removal(), Removal(), Errors(), Errors()
        seconds = []
        for shot in taken:
            made: Outcome = run(chain, shot.raw, shot.cloud, shot.label)
            view = shot.view
            anywhere += removal(shot.raw, made.filtered, shot.label)
            counts += removal(shot.raw, made.filtered, shot.label_observed)
            everywhere += errors(made.filled.depth, view.depth, shot.judged, shot.near)
            band += errors(made.filled.depth, view.depth, shot.judged & view.band, shot.near)
            seconds.append(made.seconds)
        cost = statistics.median(seconds)
        if chain.filters:
            cost = plan_seconds(first, chain, device) - plan_seconds(first, None, device)
        yield Score(chain.name, counts, anywhere, everywhere, band, 1000 * cost)


def plan_seconds(shot: Shot, chain: Chain | None, device: str) -> float:
    """Median seconds of a plan's frame with a chain's filters; None: the splat alone."""
    target = resolve_device(device)
    points = share_points(shot.cloud.points_world, target)
    filters = () if chain is None else chain.filters
    config = RenderConfig(shot.raw.kind, max_range=math.inf, filters=filters)
    plan = RenderPlan([ViewPlan(shot.view.camera)], config, target)
    seconds = []
    for _ in range(TIMED_RUNS + 1):
        start = time.perf_counter()
        plan.render(points)
        wp.synchronize_device(target)
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds[1:])


def _splats(
    case: Case, ready: Stage, device: str
) -> tuple[dw.PointCloud, list[tuple[dw.DepthMap, npt.NDArray[np.uint8]]]]:
    measured = scan(ready.scene, ready.world, case.rays, case.dirty)
    cloud = dw.PointCloud(measured.points)
    found = []
    for view in ready.views:
        raw = dw.render(cloud, view.camera, depth="z", max_range=math.inf, device=device)
        found.append((raw, labels(measured, ready.world, view.camera, raw.index)))
    return cloud, found
