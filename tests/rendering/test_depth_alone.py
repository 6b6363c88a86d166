"""Plans without an index: the same depth, state and counts from half the Z-buffer."""

from __future__ import annotations

import numpy as np
import pytest

import depthwarp as dw
from depthwarp import arrays
from depthwarp.devices import resolve_device
from depthwarp.errors import InputError
from depthwarp.rendering import RenderConfig, RenderPlan, ViewPlan
from tests.rendering.test_prepared import room
from tests.rendering.test_threads import CPU, SHARED, cameras, source_of, with_ties

CONFIG = RenderConfig("range", 0.2, 6.0)


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize("prepared", [True, False])
@pytest.mark.parametrize("views", [1, 4])
def test_depth_is_the_same_without_an_index(prepared, views, threads):
    """Depth and state bit for bit, and all counts; of one view and of several, ties included."""
    points = with_ties(SHARED + 100)
    cloud = source_of(points, prepared)
    plans = [
        RenderPlan(
            [ViewPlan(camera) for camera in cameras("pinhole", views)],
            CONFIG,
            CPU,
            with_index=with_index,
            threads=threads,
        )
        for with_index in (True, False)
    ]
    for plan in plans:
        plan.render(cloud)
    whole, alone = (plan.maps for plan in plans)
    assert alone.index is None
    np.testing.assert_array_equal(alone.depth.numpy(), whole.depth.numpy())
    np.testing.assert_array_equal(alone.state.numpy(), whole.state.numpy())
    assert plans[0].stats() == plans[1].stats()
    assert (whole.depth.numpy() > 0).sum() > 500


def test_a_depth_map_needs_an_index():
    """A plan of depths alone has none; the message says what to ask for."""
    plan = RenderPlan([ViewPlan(cameras("pinhole", 1)[0])], CONFIG, CPU, with_index=False)
    plan.render(arrays.share_points(room(100), CPU))
    with pytest.raises(InputError, match="'depth' and 'index'"):
        plan.depth_maps()


def test_filters_bring_the_index_back(device):
    """They erase and fill it, so that a plan with filters always has it."""
    config = RenderConfig(filters=dw.filters.paper())
    views = [ViewPlan(cameras("pinhole", 1)[0])]
    plan = RenderPlan(views, config, resolve_device(device), with_index=False)
    assert plan.maps.index is not None
