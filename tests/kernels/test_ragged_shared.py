"""Small images in shared memory: the bits and counts of a plan for many clouds on the CPU."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import warp as wp

import depthwarp as dw
from depthwarp.devices import resolve_device
from depthwarp.rendering import RenderConfig, ViewPlan
from depthwarp.rendering.ragged import OUTPUTS, RaggedPlan
from depthwarp.rendering.views import DeviceViews
from depthwarp_kernels import ragged, ragged_shared, splat
from depthwarp_kernels.point_source import PLAIN
from depthwarp_kernels.ragged_shared import MOST_PIXELS, SharedConfig, shared_config
from tests.cameras.models import IDENTITY, MODELS, quietly
from tests.kernels.scenes import POSES, points_world

ALL = frozenset(OUTPUTS)
BOUNDS = RenderConfig("range", 0.8, 4.0)
SIZES = np.array([300, 0, 1, 20011])
"""Points of the clouds."""


def views_of(lens: str) -> list[ViewPlan]:
    """Three small views through a lens."""
    camera = MODELS[lens](np.random.default_rng(3), IDENTITY, 24)
    if not isinstance(camera, dw.SpinningLidar):
        camera = quietly(dataclasses.replace, camera, width=20, height=16)
    return [ViewPlan(camera.with_pose(pose)) for pose in POSES]


def image(size: tuple[int, int]) -> list[ViewPlan]:
    """One view of an image of a size, in the midst of the points."""
    return [ViewPlan(dw.PinholeCamera.from_fov((100, 90), size))]


def config_of(plans, pixels: int, outputs=ALL, begins: bool = False) -> SharedConfig | None:
    """The kernel's configuration for views."""
    source = splat.SplatConfig(PLAIN, plans[0].lens.model, BOUNDS.depth, False)
    return shared_config(source, frozenset(outputs), pixels, begins)


def cloud(sizes) -> np.ndarray:
    """Points of clouds one behind the other."""
    return np.concatenate([points_world(size) for size in sizes])


def spans_of(sizes) -> np.ndarray:
    """Where each of them begins and ends."""
    ends = np.cumsum(sizes)
    return np.stack([ends - sizes, ends], axis=1)


def shared(config: SharedConfig, plans, points, spans, cloud_of, device, begun=((0,),), rank=0):
    """Maps and counts of the kernel for shared memory; on a CPU a block is one thread.

    What they hold before is anything; a map that is not asked for has one pixel.
    """
    views = DeviceViews(plans, BOUNDS, wp.get_device(device))
    shape = (views.count, views.size[0] * views.size[1])
    outputs = {
        name: wp.full(shape if name in config.outputs else (1, 1), 9, dtype, device=device)
        for name, dtype in OUTPUTS.items()
    }
    outputs["counts"] = wp.full((views.count, ragged.RAGGED_COLUMNS), 9, wp.int64, device=device)
    lanes = ragged_shared.LANES if wp.get_device(device).is_cuda else 1
    wp.launch(
        ragged_shared.shared_kernel(config),
        dim=(views.count, lanes),
        inputs=[
            *views.arrays,
            wp.array(points, dtype=wp.vec3f, device=device),
            wp.array(spans, dtype=wp.vec2i, device=device),
            wp.array(cloud_of, dtype=wp.int32, device=device),
            rank,
            wp.array(begun, dtype=wp.uint64, device=device),
        ],
        outputs=list(outputs.values()),
        device=device,
        block_dim=lanes,
    )
    return {name: array.numpy() for name, array in outputs.items()}


def on_cpu(plans, sizes, cloud_of) -> dict[str, np.ndarray]:
    """The same of a plan on the CPU."""
    plan = RaggedPlan(plans, BOUNDS, tuple(OUTPUTS), resolve_device("cpu"), 1)
    plan.render(
        wp.array(cloud(sizes), dtype=wp.vec3f, device="cpu"),
        wp.array(np.cumsum([0, *sizes]), dtype=wp.int32, device="cpu"),
        wp.array(cloud_of, dtype=wp.int32, device="cpu"),
    )
    maps = plan.depth_maps()
    result = {name: np.stack([getattr(m, name).ravel() for m in maps]) for name in OUTPUTS}
    names = ("not_finite", "behind", "outside", "too_far", "too_near", "drawn", "total")
    counts = [[getattr(m.stats, name) for name in names] for m in maps]
    return result | {"counts": np.array(counts, np.int64)}


def assert_same(ours: dict[str, np.ndarray], theirs: dict[str, np.ndarray], outputs=ALL) -> None:
    """Maps that were asked for and all counts are the same, bit for bit; no other is written."""
    for name, values in ours.items():
        if name in (*outputs, "counts"):
            np.testing.assert_array_equal(
                values.view(np.uint8), theirs[name].view(np.uint8), err_msg=name
            )
        else:
            assert values.tolist() == [[9]]


@pytest.mark.parametrize("lens", ["pinhole", "moving"])
def test_bits_and_counts_are_those_of_the_plan(device, lens):
    """Clouds of any size, an empty one, some views of one cloud, and of clouds that there are not;
    a lens that takes some points at a time, and one that takes them one by one.
    """
    plans = views_of(lens)
    config = config_of(plans, math.prod(plans[0].camera.size))
    seen = np.zeros(ragged.RAGGED_COLUMNS, np.int64)
    for cloud_of in ([0, 1, 2], [3, 3, 0], [4, -1, 3]):
        maps = shared(config, plans, cloud(SIZES), spans_of(SIZES), cloud_of, device)
        assert_same(maps, on_cpu(plans, SIZES, cloud_of))
        sizes = [SIZES[row] if 0 <= row < 4 else 0 for row in cloud_of]
        assert maps["counts"][:, ragged.TOTAL].tolist() == sizes
        seen += maps["counts"].sum(axis=0)
    behind = plans[0].lens.model.ahead_only  # else no point is behind
    assert (seen > 0).tolist() == [True, behind, *[True] * 5]


@pytest.mark.parametrize("outputs", [("depth", "index", "state"), ("depth", "state"), ("depth",)])
def test_one_pixel_and_the_largest_image(device, outputs):
    """With the index in the keys and without: same bits, and every cell of the storage is used."""
    most = MOST_PIXELS[wp.uint64 if "index" in outputs else wp.uint32]
    config = config_of(image((1, 1)), most, outputs)  # one kernel for both
    assert config.cells == most
    sizes = np.array([20000])
    for size in ((1, 1), (47, most // 47)):
        plans = image(size)
        maps = shared(config, plans, cloud(sizes), spans_of(sizes), [0], device)
        assert_same(maps, on_cpu(plans, sizes, [0]), outputs)
        assert (maps["depth"] > 0).mean() > 0.08
    assert maps["depth"].shape == (1, most)


@pytest.mark.parametrize("outputs", [("depth", "index", "state"), ("depth", "state")])
def test_an_image_that_begins_with_keys(device, outputs):
    """A static cloud's keys and then a moving cloud: as both clouds in one, the static one first.

    A third of the points is the same as another one: equal depths go to the static cloud.
    """
    plans, points, parts = image((30, 20)), cloud([3000]), [[0, 1700], [1700, 3000]]
    alone = config_of(plans, 600)
    both = shared(alone, plans, points, [[0, 3000]], [0], device)
    still = shared(alone, plans, points, parts, [0], device)
    depth, index = still["depth"].view(np.uint32).astype(np.uint64), still["index"].view(np.uint32)
    begun = np.where(still["state"] == 1, depth << np.uint64(32) | index, splat.EMPTY_KEY)
    onto = config_of(plans, 600, outputs, begins=True)
    maps = shared(onto, plans, points, parts, [1], device, begun.astype(np.uint64), 1700)
    for name in outputs:
        np.testing.assert_array_equal(maps[name].view(np.uint8), both[name].view(np.uint8))
    assert maps["counts"][0, splat.DRAWN] == both["counts"][0, splat.DRAWN]
    assert maps["counts"][0, ragged.TOTAL] == 1300
    dropped = slice(0, splat.DRAWN)
    np.testing.assert_array_equal(
        maps["counts"][0, dropped] + still["counts"][0, dropped], both["counts"][0, dropped]
    )
    assert (both["index"] >= 1700).sum() > 20 and (both["index"] < 1700).sum() > 20


def test_images_of_similar_size_share_a_kernel():
    """Room comes in steps; an image too large for shared memory has no such kernel."""
    plans = image((1, 1))
    assert config_of(plans, 1) == config_of(plans, 512) != config_of(plans, 513)
    assert config_of(plans, 64 * 64).cells == 64 * 64
    assert config_of(plans, 6016).cells == 6016 and config_of(plans, 6017) is None
    alone = ("depth",)
    assert config_of(plans, 12032, alone).cells == 12032
    assert config_of(plans, 12033, alone) is None
