"""Many views in one call: each is what it would be alone, whatever it is drawn together with."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

import depthwarp as dw
from depthwarp.errors import InputError


def cloud_of(seed: int, count: int = 3000) -> dw.PointCloud:
    """Points all round the origin."""
    points = np.random.default_rng(seed).uniform(-5, 5, (count, 3))
    return dw.PointCloud(points.astype(np.float32))


def cameras_of_all_kinds() -> list[dw.Camera | dw.RangeView]:
    """Models, sizes, poses and intrinsics mixed, some alike so that they share a plan."""
    pose = dw.Pose.from_orientation((0.2, -0.1, 0.3), (5, 10, 40))
    return [
        dw.PinholeCamera.from_fov((60, 45), (24, 18)),
        dw.EquirectangularCamera.looking((36, 18), orientation=(0, 5, 80)),
        dw.PinholeCamera(30.0, 31.0, 10.0, 9.0, 24, 18, pose),
        dw.PinholeCamera(30.0, 31.0, 10.0, 9.0, 24, 18, pose, (-0.05, 0.01, 1e-3, -1e-3)),
        dw.PinholeCamera.from_fov((90, 70), (40, 20), (1, 0, 0), (0, 0, 120)),
        dw.SpinningLidar(60, (20.0, 5.0, -10.0), pose, beam_azimuths=(1.0, 0.0, -1.0)),
        dw.SpinningLidar(60, (12.0, 3.0, -20.0), dw.Pose.from_orientation((0, 0, 1), (0, 0, 9))),
        dw.RangeView((0, 0, 0), (0, 0, 30), (60, 50), 0.1, 0.5),
    ]


def assert_same(ours: dw.DepthMap, theirs: dw.DepthMap) -> None:
    """All of two maps is the same, bit for bit."""
    for name in ("depth", "index", "state"):
        np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name))
    assert ours.stats == theirs.stats and ours.camera == theirs.camera


def test_a_batch_is_its_views(device):
    """Every view of a mixed batch has the bits of its own render, in the order of the cameras."""
    cloud, cameras = cloud_of(1), cameras_of_all_kinds()
    options = {"filters": dw.filters.paper(), "max_range": 6.0, "device": device}
    maps = dw.render_batch(cloud, cameras, **options)
    assert len(maps) == len(cameras)
    for depth_map, camera in zip(maps, cameras, strict=True):
        assert_same(depth_map, dw.render(cloud, camera, **options))
        assert depth_map.stats.drawn > 0


def test_each_camera_may_see_its_own_cloud(device):
    """A cloud for each camera, of different lengths, one of them empty."""
    clouds = [cloud_of(1), cloud_of(2, 17), cloud_of(3, 0), cloud_of(1, 900)]
    cameras = [
        dw.PinholeCamera.from_fov((80, 60), (16, 12), orientation=(0, 0, 90 * n)) for n in range(4)
    ]
    maps = dw.render_batch(clouds, cameras, device=device)
    for depth_map, cloud, camera in zip(maps, clouds, cameras, strict=True):
        assert_same(depth_map, dw.render(cloud, camera, device=device))
        assert depth_map.stats.total == len(cloud)


def test_clouds_and_cameras_of_generators():
    """A batch of generators is that of lists; the number of clouds is asked for all the same."""
    clouds, camera = [cloud_of(1), cloud_of(2)], dw.PinholeCamera.from_fov((80, 60), (16, 12))
    maps = dw.render_batch(iter(clouds), iter([camera] * 2), device="cpu")
    for depth_map, cloud in zip(maps, clouds, strict=True):
        assert_same(depth_map, dw.render(cloud, camera, device="cpu"))
    with pytest.raises(InputError, match="there are 2 clouds and more cameras"):
        dw.render_batch(iter(clouds), [camera] * 3, device="cpu")
    with pytest.raises(InputError, match="more clouds than the 1 cameras"):
        dw.render_batch(clouds, iter([camera]), device="cpu")


@pytest.mark.parametrize("draw", [dw.render_batch, dw.render_stream])
@pytest.mark.parametrize(
    ("clouds", "cameras", "message"),
    [
        (cloud_of(1, 9), None, "cameras must be several, in a list or a rig, got NoneType"),
        (cloud_of(1, 9), 5, "cameras must be several, in a list or a rig, got int"),
        (
            np.zeros((9, 3), np.float32),
            [],
            r"PointCloud or several, got ndarray: dw.PointCloud\(points\)",
        ),
        (
            wp.zeros(9, dtype=wp.vec3f, device="cpu"),
            [],
            r"PointCloud or several, got array: dw.PointCloud\(points\)",
        ),
    ],
)
def test_what_is_refused_at_once(draw, clouds, cameras, message):
    """Points that are no cloud, and no cameras: also of a stream, before its first map."""
    with pytest.raises(InputError, match=message):
        draw(clouds, cameras, device="cpu")


def test_views_of_one_size_stack():
    """`depth`, `index`, `state` of a batch have the shape (V, H, W); a slice is a batch."""
    cameras = [
        dw.PinholeCamera.from_fov((80, 60), (16, 12), orientation=(0, 0, n)) for n in range(3)
    ]
    maps = dw.render_batch(cloud_of(1), cameras, device="cpu")
    assert maps.depth.shape == maps.index.shape == maps.state.shape == (3, 12, 16)
    assert (maps.depth.dtype, maps.index.dtype, maps.state.dtype) == (
        np.float32,
        np.int32,
        np.uint8,
    )
    np.testing.assert_array_equal(maps.depth[1], maps[1].depth)
    np.testing.assert_array_equal(maps[1:].depth, maps.depth[1:])
    assert [depth_map.camera for depth_map in maps] == cameras


def test_views_of_two_sizes_do_not_stack():
    """The message names the sizes and what to do."""
    cameras = [dw.PinholeCamera.from_fov((80, 60), size) for size in ((16, 12), (8, 6))]
    maps = dw.render_batch(cloud_of(1), cameras, device="cpu")
    with pytest.raises(InputError, match=r"8 x 6, 16 x 12.*one by one"):
        _ = maps.depth


def test_a_mapping_is_a_rig():
    """Cameras by name are drawn in the order of the names."""
    rig = {
        "left": dw.PinholeCamera.from_fov((60, 45), (8, 6), (0, 0.1, 0)),
        "right": dw.PinholeCamera.from_fov((60, 45), (8, 6), (0, -0.1, 0)),
    }
    maps = dw.render_batch(cloud_of(4), rig, device="cpu")
    assert [depth_map.camera for depth_map in maps] == list(rig.values())
    assert maps.names == ("left", "right") and maps["right"] is maps[1]
    assert maps[1:].names == ("right",) and maps[1:]["right"] is maps[1]
    with pytest.raises(KeyError, match="no view 'top'; there are left, right"):
        maps["top"]


def test_maps_of_a_list_have_no_names():
    """By name there is none; names in another number than maps are refused."""
    camera = dw.PinholeCamera.from_fov((60, 45), (8, 6))
    maps = dw.render_batch(cloud_of(4, 9), [camera], device="cpu")
    assert maps.names is None and maps[:].names is None
    with pytest.raises(KeyError, match="without names"):
        maps["left"]
    with pytest.raises(InputError, match="2 names and 1 maps"):
        dw.DepthMaps(list(maps), ("a", "b"))


def test_a_batch_says_what_it_holds():
    """How many, the names, the first maps; one line, not the arrays."""
    camera = dw.PinholeCamera.from_fov((60, 45), (8, 6))
    one = "DepthMap(8 x 6 px, PinholeCamera, range, 0.0% not empty)"
    empty = cloud_of(4, 0)
    named = dw.render_batch(empty, {"left": camera, "right": camera}, device="cpu")
    assert repr(named) == f"DepthMaps of 2 views (left: {one}, right: {one})"
    many = dw.render_batch(empty, [camera] * 5, device="cpu")
    assert repr(many) == f"DepthMaps of 5 views ({', '.join([one] * 4)}, ...)"


def test_what_a_batch_refuses():
    """No camera, too few clouds, something else than a camera or a cloud."""
    camera, cloud = dw.PinholeCamera.from_fov((60, 45), (8, 6)), cloud_of(1, 10)
    with pytest.raises(InputError, match="at least one"):
        dw.render_batch(cloud, [])
    with pytest.raises(InputError, match=r"got one PinholeCamera: \[camera\], or dw.render"):
        dw.render_batch(cloud, camera)
    with pytest.raises(InputError, match="got 2 clouds and 3 cameras"):
        dw.render_batch([cloud, cloud], [camera] * 3)
    with pytest.raises(InputError, match="got str"):
        dw.render_batch(cloud, [camera, "camera"], device="cpu")
    with pytest.raises(InputError, match="PointCloud"):
        dw.render_batch([cloud, np.zeros((3, 3))], [camera] * 2, device="cpu")
    panorama = dw.EquirectangularCamera.looking((8, 4))
    with pytest.raises(InputError, match="use depth='range'"):
        dw.render_batch(cloud, [camera, panorama], depth="z", device="cpu")
