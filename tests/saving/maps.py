"""What the tests of saving share: a map with every state, and how to compare maps and folders."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np

import depthwarp as dw

SUFFIXES = [".png", ".tiff", ".tif", ".npz"]


def render(**options) -> dw.DepthMap:
    """A map with all states, through a view that is turned and shifted."""
    rng = np.random.default_rng(0)
    points = rng.uniform(-6, 6, (3000, 3)).astype(np.float32)
    camera = dw.PinholeCamera.from_fov(
        (80, 60), (40, 30), (0.1, 0.2, 0.3), (5, 10, 70), position_frame="rotated"
    )
    filters = (dw.filters.remove_hidden(side=5), dw.filters.dilate(side=2))
    drawn = dw.render(dw.PointCloud(points), camera, filters=filters, device="cpu", **options)
    state = drawn.state.copy()
    state[tuple(np.argwhere(state == dw.State.FILLED)[:20].T)] = dw.State.FILLED_BORDER
    return dataclasses.replace(drawn, state=state)


def assert_same(ours: dw.DepthMap, theirs: dw.DepthMap) -> None:
    """The same bits, camera, bounds, kind and counts."""
    np.testing.assert_array_equal(ours.depth.view(np.uint32), theirs.depth.view(np.uint32))
    for name in ("depth", "index", "state"):
        a, b = getattr(ours, name), getattr(theirs, name)
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)
    for name in ("camera", "kind", "min_range", "max_range", "stats"):
        assert getattr(ours, name) == getattr(theirs, name)


def files_in(folder: Path) -> dict[str, bytes]:
    """Every file of a folder, hidden ones too."""
    return {path.name: path.read_bytes() for path in folder.iterdir()}
