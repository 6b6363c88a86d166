"""The filters that look at layers: kernels against loops, alone, in batches and in plans."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import depthwarp as dw
from depthwarp.filters.chain import build_steps
from tests.filters.maps import (
    MAPS,
    arrays_of,
    assert_maps,
    device_maps,
    grid_of,
    layered_maps,
    make_map,
    sparse,
    stacked,
)
from tests.reference import layer_filters as reference

FEW = settings(max_examples=25)
REACH = st.integers(1, 7)


@FEW
@given(depth_map=layered_maps(), keep=st.booleans())
def test_surround_is_the_loop(device, depth_map, keep):
    """Any map and lens, with a full turn or without."""
    step = dw.filters.remove_hidden("surround", keep_depth=keep)
    result = dw.filters.apply(depth_map, [step], device=device)
    assert_maps(result, reference.surround_erase(arrays_of(depth_map), grid_of(depth_map), keep))


@FEW
@given(depth_map=layered_maps())
def test_a_chain_is_its_filters_one_by_one(device, depth_map):
    """The fill goes on with what the erase found, to the same result as on the erased map."""
    chain = dw.filters.best()
    together = dw.filters.apply(depth_map, chain, device=device)
    erased = dw.filters.apply(depth_map, chain[:1], device=device)
    assert_maps(together, arrays_of(dw.filters.apply(erased, chain[1:], device=device)))


@FEW
@given(depth_map=layered_maps(), radius=REACH, angle=st.sampled_from([10.0, 30.0, 60.0]))
def test_cone_is_the_loop(device, depth_map, radius, angle):
    """Any map, lens, radius and angle."""
    step = dw.filters.remove_hidden("cone", radius=radius, angle=angle)
    result = dw.filters.apply(depth_map, [step], device=device)
    expected = reference.cone_erase(arrays_of(depth_map), grid_of(depth_map), radius, angle)
    assert_maps(result, expected)


@FEW
@given(depth_map=layered_maps())
def test_plane_fill_is_the_loop(device, depth_map):
    """Depths, winners and states, inside and at borders."""
    result = dw.filters.apply(depth_map, [dw.filters.fill()], device=device)
    assert_maps(result, reference.plane_fill(arrays_of(depth_map), grid_of(depth_map)))


@FEW
@given(depth_map=layered_maps(), radius=REACH)
def test_nearest_fill_is_the_loop(device, depth_map, radius):
    """Ties go to the smallest depth, then the lowest index; a full turn goes round."""
    result = dw.filters.apply(depth_map, [dw.filters.fill("nearest", radius=radius)], device=device)
    assert_maps(result, reference.nearest_fill(arrays_of(depth_map), grid_of(depth_map), radius))


@FEW
@given(depth_map=layered_maps())
def test_push_and_pull_is_the_loop(device, depth_map):
    """Averages up and down again."""
    result = dw.filters.apply(depth_map, [dw.filters.fill("push_pull")], device=device)
    assert_maps(result, reference.push_pull(arrays_of(depth_map)))


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_the_result_depends_neither_on_threads_nor_on_the_batch(device, threads):
    """Three views in one batch, twice other maps and the first again: each as it is alone."""
    rng = np.random.default_rng(5)
    frames = [
        [
            sparse(make_map(np.where(rng.random((150, 203)) < 0.5, 2.0, 5.0)), share)
            for share in shares
        ]
        for shares in ((0.02, 0.2, 0.9), (0.4, 0.0, 0.03))
    ]
    methods = [
        dw.filters.remove_hidden(name, keep_depth=keep)
        for name, keep in (("surround", False), ("surround", True), ("cone", True), ("paper", True))
    ]
    fills = [dw.filters.fill(name) for name in ("plane", "plane", "nearest", "push_pull")]
    for chain in zip(methods, fills, strict=True):
        batch = device_maps(frames[0], device, threads)
        steps = build_steps(chain, batch)
        for maps in (*frames, frames[0]):
            for name in MAPS:
                getattr(batch, name).assign(stacked(maps, name))
            for step in steps:
                step()
            for v, single in enumerate(maps):
                alone = dw.filters.apply(single, chain, device=device)
                expected = [array.numpy()[v] for array in (batch.depth, batch.index, batch.state)]
                assert_maps(alone, expected)


def test_the_chain_in_a_plan_is_that_of_the_finished_map(device):
    """`filters=best()` of a rendering, and `apply` on the plain map; also after another pose."""
    rng = np.random.default_rng(6)
    cloud = dw.PointCloud(
        np.stack([rng.choice([3.0, 6.0], 4000), *rng.uniform(-3, 3, (2, 4000))], 1)
    )
    for camera in (
        dw.PinholeCamera.from_fov((60, 45), (80, 60)),
        dw.OrthographicCamera.looking(0.05, (80, 60)),
    ):
        plain = dw.render(cloud, camera, device=device)
        expected = dw.filters.apply(plain, dw.filters.best(), device=device)
        filtered = dw.render(cloud, camera, filters=dw.filters.best(), device=device)
        assert_maps(filtered, arrays_of(expected))
        assert (filtered.state == dw.State.FILLED).any()
