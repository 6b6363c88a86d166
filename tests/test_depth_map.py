"""The depth map's parts: states, and the counts of what became of every point."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import depthwarp as dw

COUNTS = (100, 1, 2, 3, 4, 5, 6, 79)
NAMES = ["total", "not_finite", "behind", "outside", "too_far", "too_near", "hidden", "drawn"]


def test_the_values_of_state():
    """The numbers that a saved map holds: they never change."""
    assert {state.name: int(state) for state in dw.State} == {
        "EMPTY": 0,
        "MEASURED": 1,
        "FILLED": 2,
        "ERASED": 3,
        "FILLED_BORDER": 4,
    }


def test_counts_are_attributes_and_a_mapping():
    """`stats.behind`, `stats["behind"]`, `dict(stats)`."""
    stats = dw.RenderStats(*COUNTS)
    assert list(stats) == NAMES and len(stats) == 8
    assert dict(stats) == dict(zip(NAMES, COUNTS, strict=True))
    assert all(stats[name] == getattr(stats, name) for name in NAMES)
    assert "behind" in stats and "above" not in stats
    assert dw.RenderStats(**stats) == stats


def test_an_unknown_count_is_a_key_error():
    """Also for names of methods, which are no counts."""
    stats = dw.RenderStats(*COUNTS)
    for name in ("above", "keys", "__len__"):
        with pytest.raises(KeyError, match=name):
            stats[name]


def test_counts_of_a_rendering_add_up(device):
    """All but `total` sum to `total`."""
    points = np.random.default_rng(0).uniform(-9, 9, (5000, 3)).astype(np.float32)
    points[:10] = np.nan
    camera = dw.PinholeCamera.from_fov((90, 60), (30, 20))
    stats = dw.render(
        dw.PointCloud(points), camera, min_range=2.0, max_range=8.0, device=device
    ).stats
    assert stats.total == len(points) == sum(dict(stats).values()) - stats.total
    assert min(stats.values()) > 0 and stats.not_finite == 10


def test_a_depth_map_is_not_written_over():
    """Its fields cannot be set: a filtered map is another map."""
    camera = dw.PinholeCamera.from_fov((60, 45), (3, 3))
    depth_map = dw.render(dw.PointCloud(np.ones((1, 3))), camera, device="cpu")
    with pytest.raises(dataclasses.FrozenInstanceError):
        depth_map.kind = "z"
    with pytest.raises(dataclasses.FrozenInstanceError):
        depth_map.stats.total = 0


def test_a_depth_map_says_what_it_is():
    """Size, model, kind, and the share of pixels that are not empty; not its arrays."""
    camera = dw.PinholeCamera.from_fov((60, 45), (4, 2))
    cloud = dw.PointCloud(np.float32([[2, 0.1, 0.1], [2, -0.1, 0.1]]))
    depth_map = dw.render(cloud, camera, depth="z", device="cpu")
    assert repr(depth_map) == "DepthMap(4 x 2 px, PinholeCamera, z, 25.0% not empty)"
