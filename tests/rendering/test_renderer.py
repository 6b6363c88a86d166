"""`dw.Renderer`: the same buffers for every call, the same bits as `dw.render`."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

import depthwarp as dw
from depthwarp.errors import InputError
from depthwarp.rendering.handed import check_points


def points_of(seed: int, count: int = 2000) -> np.ndarray:
    """Points all round the origin."""
    return np.random.default_rng(seed).uniform(-5, 5, (count, 3)).astype(np.float32)


def cameras(count: int = 3) -> list[dw.PinholeCamera]:
    """Cameras that differ in pose and lens."""
    return [
        dw.PinholeCamera.from_fov((60 + 10 * n, 45), (20, 15), (0.1 * n, 0, 0), (n, 3, 40 * n))
        for n in range(count)
    ]


def poses(seed: int, count: int) -> np.ndarray:
    """Matrices optical_from_world, (V, 4, 4)."""
    rng = np.random.default_rng(seed)
    return np.stack(
        [
            dw.Pose.from_orientation(
                rng.uniform(-1, 1, 3), rng.uniform(-180, 180, 3)
            ).optical_from_world
            for _ in range(count)
        ]
    )


def upload(values: np.ndarray, dtype, device: str):
    """A Warp array."""
    return wp.array(np.ascontiguousarray(values, np.float32), dtype=dtype, device=device)


def test_it_renders_what_render_does(device):
    """Every view, every call, another cloud each time, with filters: all bits."""
    views = cameras()
    options = {"filters": dw.filters.paper(), "max_range": 4.0, "device": device}
    renderer = dw.Renderer(views, max_points=3000, outputs=("depth", "index", "state"), **options)
    for seed, count in ((1, 2000), (2, 3000), (3, 0), (4, 17)):
        points = points_of(seed, count)
        maps = renderer.render(upload(points, wp.vec3f, device))
        assert set(maps) == {"depth", "index", "state"}
        for v, camera in enumerate(views):
            alone = dw.render(dw.PointCloud(points), camera, **options)
            for name, array in maps.items():
                np.testing.assert_array_equal(array.numpy()[v], getattr(alone, name))
            assert renderer.depth_maps()[v].stats == alone.stats


def test_depth_alone(device):
    """Without the index the same depth, in half the Z-buffer; a DepthMap needs the index."""
    points = upload(points_of(1), wp.vec3f, device)
    alone = dw.Renderer(cameras(), max_points=2000, outputs=("depth",), device=device)
    maps = alone.render(points)
    both = dw.Renderer(cameras(), max_points=2000, device=device).render(points)
    assert set(maps) == {"depth"}
    np.testing.assert_array_equal(maps["depth"].numpy(), both["depth"].numpy())
    with pytest.raises(InputError, match="ask for the outputs 'depth' and 'index'"):
        alone.depth_maps()


def test_poses_of_the_host_move_the_cameras(device):
    """Matrices as NumPy give the bits of cameras with those poses, and stay."""
    views, matrices = cameras(), poses(5, 3)
    points = points_of(1)
    renderer = dw.Renderer(views, max_points=2000, device=device)
    renderer.render(upload(points, wp.vec3f, device))
    for given in (matrices, None):
        maps = renderer.render(upload(points, wp.vec3f, device), given)
        for v, camera in enumerate(views):
            moved = camera.with_pose(dw.Pose.from_optical(matrices[v]))
            alone = dw.render(dw.PointCloud(points), moved, device=device)
            np.testing.assert_array_equal(maps["depth"].numpy()[v], alone.depth)
            np.testing.assert_array_equal(maps["index"].numpy()[v], alone.index)
            assert renderer.cameras[v] == moved


def test_poses_of_the_device_move_the_cameras(device):
    """Matrices on the device draw the same but for their rounding to float32."""
    views, matrices = cameras(), poses(6, 3)
    points = points_of(1)
    renderer = dw.Renderer(views, max_points=2000, device=device)
    on_device = upload(points, wp.vec3f, device)
    by_host = renderer.render(on_device, matrices)["depth"].numpy().copy()
    renderer.render(on_device, poses(7, 3))
    by_device = renderer.render(on_device, upload(matrices, wp.mat44f, device))["depth"].numpy()
    same = np.isclose(by_device, by_host, rtol=1e-5)
    assert by_host.any() and same.mean() > 0.995


def test_callers_arrays_are_written(device):
    """`out` holds the results afterwards, and is what comes back."""
    renderer = dw.Renderer(cameras(), max_points=2000, device=device)
    points = upload(points_of(1), wp.vec3f, device)
    own = renderer.render(points)
    out = {"depth": wp.full((3, 15, 20), -1.0, dtype=wp.float32, device=device)}
    maps = renderer.render(points, out=out)
    assert maps["depth"] is out["depth"]
    np.testing.assert_array_equal(out["depth"].numpy(), own["depth"].numpy())


def test_prepared_clouds_and_host_points(device):
    """A prepared cloud; on a CPU also NumPy points and a cloud of them, which are not copied."""
    points = points_of(9)
    renderer = dw.Renderer(cameras(), max_points=2000, device=device)
    expected = renderer.render(upload(points, wp.vec3f, device))["index"].numpy().copy()
    prepared = dw.PointCloud(points).prepare(device=device)
    np.testing.assert_array_equal(renderer.render(prepared)["index"].numpy(), expected)
    for given, name in ((points, "points"), (dw.PointCloud(points), "cloud.points_world")):
        if device == "cpu":
            np.testing.assert_array_equal(renderer.render(given)["index"].numpy(), expected)
            shared = check_points(given, 2000, wp.get_device(device)).numpy()
            assert np.shares_memory(shared, points)
        else:
            with pytest.raises(InputError, match=rf"on the host.*wp.array\({name}, .*'{device}"):
                renderer.render(given)


def test_replayed_as_a_graph(device):
    """On CUDA a captured call draws the new content of its arrays; the same bits as eager."""
    if device == "cpu":
        pytest.skip("graphs are captured on CUDA")
    renderer = dw.Renderer(cameras(), max_points=2000, device=device)
    points = upload(points_of(1), wp.vec3f, device)
    matrices = upload(poses(1, 3), wp.mat44f, device)
    renderer.render(points, matrices)
    with wp.ScopedCapture(device=device) as capture:
        maps = renderer.render(points, matrices)
    points.assign(points_of(2))
    matrices.assign(poses(2, 3).astype(np.float32))
    wp.capture_launch(capture.graph)
    replayed = maps["depth"].numpy().copy()
    np.testing.assert_array_equal(renderer.render(points, matrices)["depth"].numpy(), replayed)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"outputs": ()}, "got none"),
        ({"outputs": ("depth", "normals")}, "'normals'"),
        ({"outputs": None}, r"list of some of 'depth', 'index', 'state', got None"),
        ({"outputs": 5}, "list of some of .*, got 5"),
        ({"outputs": "depth"}, r"list of some of .*, got the text 'depth': \('depth',\)"),
        ({"max_points": -1}, "max_points must be a whole number from 0, got -1"),
        ({"max_points": "10"}, "max_points must be a whole number from 0, got '10'"),
        ({"max_points": None}, "max_points must be a whole number from 0, got None"),
        ({"max_points": 1.5}, "max_points must be a whole number from 0, got 1.5"),
        ({"cameras": []}, "cameras must be at least one, got an empty list"),
        ({"cameras": None}, "cameras must be several, in a list, got NoneType"),
        ({"cameras": cameras()[0]}, r"got one PinholeCamera: \[camera\]"),
        (
            {"cameras": [cameras()[0], dw.EquirectangularCamera.looking((20, 15))]},
            "one camera model",
        ),
        (
            {"cameras": [cameras()[0], dw.PinholeCamera.from_fov((60, 45), (8, 6))]},
            "cameras must all be of one image size, got 8 x 6, 20 x 15: make a Renderer",
        ),
        ({"cameras": ["camera"]}, "got str"),
    ],
)
def test_what_cannot_be_made(options, message):
    """Each is refused when the renderer is made."""
    arguments = {"cameras": cameras(), "max_points": 10, "device": "cpu"} | options
    with pytest.raises(InputError, match=message):
        dw.Renderer(arguments.pop("cameras"), **arguments)


@pytest.mark.parametrize(
    ("points", "given", "out", "message"),
    [
        (points_of(1, 11), None, None, "11 points are more than"),
        (points_of(1, 5).astype(np.float64), None, None, "float32"),
        (np.zeros((4, 4), np.float32), None, None, r"\(N, 3\)"),
        ([[1, 2, 3]], None, None, "got list"),
        (points_of(1, 5), np.eye(4), None, r"\(3, 4, 4\)"),
        (
            points_of(1, 5),
            np.stack([np.eye(4), np.diag([2, 2, 2, 1]), np.eye(4)]),
            None,
            r"poses\[1\].*rotation",
        ),
        (points_of(1, 5), "poses", None, "got str"),
        (points_of(1, 5), None, "x", "out must be arrays by the names of the outputs, .*got str"),
        (points_of(1, 5), None, np.zeros((3, 15, 20), np.float32), "by the names.*got ndarray"),
        (points_of(1, 5), None, [], "by the names.*got list"),
        (points_of(1, 5), None, {"state": None}, "'state'"),
        (dw.PointCloud(points_of(1, 11)), None, None, "11 points are more than"),
        (
            points_of(1, 5),
            None,
            {"depth": wp.zeros((3, 15, 21), dtype=wp.float32, device="cpu")},
            "shape",
        ),
        (
            points_of(1, 5),
            None,
            {"depth": wp.zeros((3, 15, 20), dtype=wp.int32, device="cpu")},
            "float32",
        ),
    ],
)
def test_what_cannot_be_rendered(points, given, out, message):
    """Each is refused in words, and the renderer still works afterwards."""
    renderer = dw.Renderer(cameras(), max_points=10, device="cpu")
    before = renderer.render(points_of(2, 10))["depth"].numpy().copy()
    with pytest.raises(InputError, match=message):
        renderer.render(points, given, out=out)
    np.testing.assert_array_equal(renderer.render(points_of(2, 10))["depth"].numpy(), before)
