"""Clouds of clumps: blocks of a prepared cloud that a view sees, meets in part, or does not see."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st

import depthwarp as dw
from tests.rendering.strategies import SPECIAL, ahead_of, seeds

SIZES = [0, 1, 2, 511, 512, 513, 1024, 1025, 2600]
REACHES = [0.0, 1e-30, 1e-22, 1e-6, 0.3, 2.0, 6.0, 14.0, 1e5, 1e17, 1e20, 3e30, 2e38]
FORMS = ["ball", "point", "line", "plane", "round the camera"]


def clump(rng: np.random.Generator, size: int, center: np.ndarray, radius: float, form: str):
    """Points (size, 3) about a centre: a ball, a plane, a line, or one point again and again."""
    points = rng.uniform(-1, 1, (size, 3)) * radius
    points[:, : {"point": 3, "line": 2, "plane": 1}.get(form, 0)] = 0.0
    points = np.roll(points, rng.integers(3), axis=1)
    return points if form == "round the camera" else points + center


@st.composite
def clumps(draw: st.DrawFn, pose: dw.Pose) -> np.ndarray:
    """Points (N, 3) float32 in up to 8 clumps about a pose, from 1e-30 m to where numbers end.

    Some are doubled, some not finite; shuffled, so that the order of the rows tells nothing.
    """
    rng = np.random.default_rng(draw(seeds))
    size = draw(st.sampled_from(SIZES))
    reaches = draw(st.lists(st.sampled_from(REACHES), min_size=1, max_size=8))
    parts = []
    for reach, share in zip(reaches, np.array_split(np.arange(size), len(reaches)), strict=True):
        way = rng.normal(size=3)
        radius = reach * rng.choice([1e-7, 0.01, 0.3, 1.0, 1.7])
        form = str(rng.choice(FORMS))
        parts.append(clump(rng, len(share), way / np.linalg.norm(way) * reach, radius, form))
    camera = np.concatenate(parts)
    with np.errstate(over="ignore", invalid="ignore"):
        points = ahead_of(pose, camera)
    doubled = rng.random(size) < draw(st.sampled_from([0.0, 0.3]))
    points[doubled] = points[rng.integers(0, max(size, 1), doubled.sum())]
    broken = rng.random((size, 3)) < draw(st.sampled_from([0.0, 0.0, 0.001, 0.5]))
    points[broken] = rng.choice(SPECIAL, broken.sum())
    return points[rng.permutation(size)]


def assert_same_map(ours: dw.DepthMap, theirs: dw.DepthMap) -> None:
    """All that two maps hold is the same: bits of depth, winners, states and counts."""
    np.testing.assert_array_equal(ours.depth.view(np.uint32), theirs.depth.view(np.uint32))
    np.testing.assert_array_equal(ours.index, theirs.index)
    np.testing.assert_array_equal(ours.state, theirs.state)
    assert ours.stats == theirs.stats
