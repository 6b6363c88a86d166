"""`dw.Renderer` with many clouds: which view sees which, poses and arrays, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

import depthwarp as dw
from depthwarp.errors import InputError

OFFSETS = np.array([0, 400, 410, 1000], np.int32)


def points_of(seed: int) -> np.ndarray:
    """Points of three clouds all round the origin."""
    return np.random.default_rng(seed).uniform(-5, 5, (1000, 3)).astype(np.float32)


def cameras(count: int = 3) -> list[dw.PinholeCamera]:
    """The same lens in several directions."""
    lens = dw.PinholeCamera.from_fov((80, 60), (20, 15))
    return [
        lens.with_pose(dw.Pose.from_orientation((0.1 * n, 0, 0), (n, 3, 40 * n)))
        for n in range(count)
    ]


def upload(values: np.ndarray, dtype, device: str):
    """A Warp array."""
    return wp.array(np.ascontiguousarray(values), dtype=dtype, device=device)


def assert_clouds(maps, points, views, cloud_of, device):
    """Each view shows its cloud, whose rows its index counts."""
    for v, (camera, cloud) in enumerate(zip(views, cloud_of, strict=True)):
        own = points[OFFSETS[cloud] : OFFSETS[cloud + 1]]
        alone = dw.render(dw.PointCloud(own), camera, device=device)
        np.testing.assert_array_equal(maps["depth"].numpy()[v], alone.depth)
        np.testing.assert_array_equal(maps["index"].numpy()[v], alone.index)


def test_which_view_sees_which_cloud(device):
    """By default its own; then as a call says, from the host or the device, and so it stays."""
    views, points = cameras(), upload(points_of(1), wp.vec3f, device)
    renderer = dw.Renderer(views, max_points=1000, device=device)
    for given, expected in [
        (None, (0, 1, 2)),
        ([2, 2, 0], (2, 2, 0)),
        (None, (2, 2, 0)),
        (upload(np.array([1, 0, 0]), wp.int32, device), (1, 0, 0)),
        (None, (1, 0, 0)),
        ((0, 1, 2), (0, 1, 2)),
    ]:
        maps = renderer.render(points, offsets=OFFSETS, cloud_of=given)
        assert_clouds(maps, points_of(1), views, expected, device)


def test_more_views_than_clouds(device):
    """`cloud_of` of the construction: several cameras in each world."""
    views, cloud_of = cameras(6), np.repeat(np.arange(3), 2)
    renderer = dw.Renderer(views, max_points=1000, cloud_of=cloud_of, device=device)
    maps = renderer.render(upload(points_of(2), wp.vec3f, device), offsets=OFFSETS.tolist())
    assert_clouds(maps, points_of(2), views, cloud_of, device)


def test_poses_move_the_views(device):
    """From the host to the bit, from the device but for their rounding; and so they stay."""
    views, points = cameras(), upload(points_of(3), wp.vec3f, device)
    renderer = dw.Renderer(views, max_points=1000, device=device)
    offsets = upload(OFFSETS, wp.int32, device)
    renderer.render(points, offsets=offsets)
    turned = [camera.with_pose(pose.pose) for camera, pose in zip(views, views[::-1], strict=True)]
    matrices = np.stack([camera.pose.optical_from_world for camera in turned])
    moved = [
        camera.with_pose(dw.Pose.from_optical(m)) for camera, m in zip(views, matrices, strict=True)
    ]
    for poses in (matrices, None):
        maps = renderer.render(points, poses, offsets=offsets)
        assert_clouds(maps, points_of(3), moved, (0, 1, 2), device)
    by_host = maps["depth"].numpy().copy()
    renderer.render(points, matrices[::-1].copy(), offsets=offsets)
    on_device = upload(matrices.astype(np.float32), wp.mat44f, device)
    by_device = renderer.render(points, on_device, offsets=offsets)["depth"].numpy()
    assert by_host.any() and np.isclose(by_device, by_host, rtol=1e-5).mean() > 0.995


def test_arrays_are_used_again(device):
    """What comes back lies where it lay before; the caller's arrays hold the same."""
    renderer = dw.Renderer(cameras(), max_points=1000, device=device)
    points = upload(points_of(4), wp.vec3f, device)
    places = {name: array.ptr for name, array in renderer.render(points, offsets=OFFSETS).items()}
    out = {"depth": wp.full((3, 15, 20), -1.0, dtype=wp.float32, device=device)}
    written = renderer.render(points, offsets=OFFSETS, out=out)
    assert written["depth"] is out["depth"]
    again = renderer.render(points, offsets=OFFSETS)
    assert {name: array.ptr for name, array in again.items()} == places
    np.testing.assert_array_equal(out["depth"].numpy(), again["depth"].numpy())


def test_nothing_is_allocated(device, monkeypatch):
    """After a first call with everything on the device the allocator is not asked again."""
    renderer = dw.Renderer(cameras(), max_points=1000, device=device)
    matrices = np.stack([camera.pose.optical_from_world for camera in cameras()])
    points = upload(points_of(4), wp.vec3f, device)
    poses = upload(matrices.astype(np.float32), wp.mat44f, device)
    offsets = upload(OFFSETS, wp.int32, device)
    renderer.render(points, poses, offsets=offsets)
    allocated = []
    allocator = type(wp.get_device(device).get_allocator())
    allocate = allocator.allocate

    def counted(self, size, *rest):
        allocated.append(size)
        return allocate(self, size, *rest)

    monkeypatch.setattr(allocator, "allocate", counted)
    wp.zeros(3, dtype=wp.int32, device=device)
    assert len(allocated) == 1  # the count counts
    for _ in range(3):
        renderer.render(points, poses, offsets=offsets)
    assert len(allocated) == 1


def test_replayed_as_a_graph(device):
    """On CUDA a captured call draws the new content of its arrays; the same bits as eager."""
    if device == "cpu":
        pytest.skip("graphs are captured on CUDA")
    renderer = dw.Renderer(cameras(), max_points=1000, device=device)
    points = upload(points_of(1), wp.vec3f, device)
    offsets = upload(OFFSETS, wp.int32, device)
    renderer.render(points, offsets=offsets)
    with wp.ScopedCapture(device=device) as capture:
        maps = renderer.render(points, offsets=offsets)
    points.assign(points_of(2))
    wp.capture_launch(capture.graph)
    replayed = maps["depth"].numpy().copy()
    np.testing.assert_array_equal(
        renderer.render(points, offsets=offsets)["depth"].numpy(), replayed
    )


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"offsets": [0, 5, 4, 10]}, r"must not fall: offsets\[1\] = 5, offsets\[2\] = 4"),
        ({"offsets": [0, 5, 8, 1001]}, "from 0 to the 1000 points, got 0 to 1001"),
        ({"offsets": [-1, 5, 8, 10]}, "got -1 to 10"),
        ({"offsets": [0.0, 5.0, 8.0, 10.0]}, "whole numbers of one dimension, got float64"),
        ({"offsets": [[0, 5, 8, 10]]}, "whole numbers of one dimension"),
        ({"offsets": [0]}, "at least two numbers, got 1"),
        ({"offsets": wp.zeros(1, dtype=wp.int32, device="cpu")}, "at least two numbers, got 1"),
        ({"offsets": wp.zeros(4, dtype=wp.int64, device="cpu")}, "int32"),
        ({"offsets": [0, 5, 10]}, "2 clouds for 3 views: cloud_of must say"),
        ({"offsets": OFFSETS, "cloud_of": [0, 1]}, "each of 3 views, got 2"),
        ({"offsets": OFFSETS, "cloud_of": [0, -1, 1]}, r"cloud_of\[1\] must be .* got -1"),
        ({"offsets": OFFSETS, "cloud_of": [0, 3, 1]}, r"cloud_of\[1\] is cloud 3, .* 3 clouds"),
        ({"offsets": OFFSETS, "cloud_of": wp.zeros(2, dtype=wp.int32, device="cpu")}, r"\(3,\)"),
        ({"offsets": OFFSETS, "poses": np.zeros((3, 4, 4))}, r"poses\[0\]"),
        ({"cloud_of": [0, 1, 2]}, "offsets are missing"),
        ({}, "offsets are missing"),
    ],
)
def test_what_cannot_be_divided(given, message):
    """Each is refused in words, and the next call draws as before."""
    points = points_of(5)
    renderer = dw.Renderer(cameras(), max_points=1000, device="cpu")
    before = renderer.render(points, offsets=OFFSETS)["index"].numpy().copy()
    with pytest.raises(InputError, match=message):
        renderer.render(points, **given)
    np.testing.assert_array_equal(renderer.render(points, offsets=OFFSETS)["index"], before)


def test_what_a_renderer_cannot_become():
    """The first call decides: one cloud or many; a prepared cloud is one; none has no maps."""
    points = points_of(6)
    renderer = dw.Renderer(cameras(), max_points=1000, device="cpu")
    with pytest.raises(InputError, match="nothing was rendered yet"):
        renderer.depth_maps()
    prepared = dw.PointCloud(points).prepare(device="cpu")
    with pytest.raises(InputError, match="not a PreparedCloud"):
        renderer.render(prepared, offsets=OFFSETS)
    renderer.render(points)
    with pytest.raises(InputError, match="make another for many clouds"):
        renderer.render(points, offsets=OFFSETS)
    with pytest.raises(InputError, match="offsets are missing"):
        dw.Renderer(cameras(), max_points=1000, cloud_of=[0, 0, 0], device="cpu").render(points)
    with pytest.raises(InputError, match="each of 3 views, got 1"):
        dw.Renderer(cameras(), max_points=10, cloud_of=[0], device="cpu")
