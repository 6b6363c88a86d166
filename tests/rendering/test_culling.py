"""Culling of blocks: never a point less than one by one, and no block more than it must be."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import warp as wp
from hypothesis import given, settings

import depthwarp as dw
from depthwarp.errors import InputError
from depthwarp.rendering import RenderConfig, ViewPlan
from depthwarp.rendering.points import points_of
from depthwarp.rendering.views import DeviceViews
from depthwarp_kernels import cull_blocks
from depthwarp_kernels.point_source import BLOCK, GROUP
from depthwarp_kernels.splat import BEHIND, COUNT_COLUMNS, OUTSIDE, SplatConfig
from tests.cameras.device_cull import device_meeting
from tests.cameras.models import IDENTITY, MODELS, quietly
from tests.rendering.clumps import assert_same_map, clump
from tests.rendering.strategies import seeds
from tests.rendering.test_prepared import room

SPHERES = 6000
ROOM_POINTS = 2000 * BLOCK


def rays_of(camera: dw.Camera, rng: np.random.Generator, count: int) -> np.ndarray:
    """Directions of an image: on its border, a little within it, and all over it."""
    u = rng.uniform(-0.5, camera.width - 0.5, count)
    v = rng.uniform(-0.5, camera.height - 0.5, count)
    inset = rng.choice([0.0, 1e-4, 1e-2, 0.3], count)
    on_left, on_right, above, below = (rng.integers(0, 5, count) == side for side in range(4))
    u[on_left], u[on_right] = -0.5 + inset[on_left], camera.width - 0.5 - inset[on_right]
    v[above], v[below] = -0.5 + inset[above], camera.height - 0.5 - inset[below]
    v = np.clip(v, -0.5, camera.height - 0.500001)
    return camera.directions(u, v)


def shown_points(camera: dw.Camera, rng: np.random.Generator, count: int) -> np.ndarray:
    """Camera-frame points at all distances, most of them along rays of the image's border."""
    rays = rays_of(camera, rng, count)
    anywhere = rng.normal(size=(count, 3))
    anywhere /= np.linalg.norm(anywhere, axis=1, keepdims=True)
    lost = np.isnan(rays[:, 0]) | (rng.random(count) < 0.3)
    rays[lost] = anywhere[lost]
    points = rays * 10 ** rng.uniform(-3, 4, (count, 1))
    if isinstance(camera, dw.OrthographicCamera):
        half = 0.5 * camera.pixel_size * np.array(camera.size)
        points[:, 1:] = (
            rng.choice([1, 1, rng.random()], (count, 2)) * half * rng.uniform(-1, 1, (count, 2))
        )
    return points.astype(np.float32)


def spheres_that_hold(points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A sphere (N, 4) for each point that just holds it, from tiny to larger than the view."""
    points = points.astype(np.float64)
    ways = rng.normal(size=points.shape)
    # Many centres straight away from the axis: the sphere reaches in only at the point.
    outward = points * (0, 1, 1)
    ways = np.where(rng.random((len(points), 1)) < 0.4, outward + 1e-12, ways)
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    distance = np.linalg.norm(points, axis=1, keepdims=True)
    radii = distance * 10 ** rng.uniform(-4, 2, (len(points), 1))
    centers = points + ways * radii
    # What the caller's margin does for rounding.
    return np.concatenate([centers, radii + 4e-6 * (radii + distance)], axis=1)


@pytest.mark.parametrize("model", MODELS)
@settings(max_examples=12)
@given(seed=seeds)
def test_a_sphere_that_holds_a_shown_point_may_be_in_view(device, model, seed):
    """Brute force on `may_meet`: whatever point the kernel draws, no sphere round it is culled."""
    rng = np.random.default_rng(seed)
    camera = MODELS[model](rng, IDENTITY, int(rng.choice([1, 24, 700])))
    points = shown_points(camera, rng, SPHERES)
    spheres = spheres_that_hold(points, rng)
    shown, may, _ = device_meeting(camera, points, spheres, device)
    lost = np.flatnonzero(shown & ~may)
    assert not len(lost), (points[lost[0]], spheres[lost[0]], camera)
    assert shown.sum() > 0.02 * SPHERES or model in ("brown", "rational", "cylindrical")


SPECIAL_CAMERAS = {
    "narrow": dw.PinholeCamera.from_fov((0.02, 0.01), (700, 500)),
    "widest": dw.PinholeCamera.from_fov((179.9, 179.9), (64, 48)),
    "axis far outside": dw.PinholeCamera(50.0, 60.0, -400.0, 900.0, 40, 30, IDENTITY),
    "beyond 90 degrees": quietly(dw.FisheyeCamera, 60.0, 60.0, 99.5, 99.5, 200, 200, IDENTITY),
    "all round": quietly(dw.FisheyeCamera, 20.0, 20.0, 99.5, 99.5, 200, 200, IDENTITY),
    "fisheye beside its axis": quietly(
        dw.FisheyeCamera, 60.0, 50.0, -30.0, 150.0, 90, 100, IDENTITY
    ),
    "domain smaller than the image": quietly(
        dw.PinholeCamera, 30.0, 30.0, 31.5, 23.5, 64, 48, IDENTITY, (-0.5, 0.1, 0.0, 0.0, 0.0)
    ),
    "one pixel": dw.PinholeCamera.from_fov((60, 60), (1, 1)),
    "one row of a panorama": dw.EquirectangularCamera.looking((90, 1), elevations=(30, 31)),
    "near the pole": dw.EquirectangularCamera.looking((90, 20), elevations=(60, 90), azimuths=70),
    "below only": dw.CylindricalCamera.looking((90, 20), elevations=(-89, -40), azimuths=200),
}


@pytest.mark.parametrize("name", SPECIAL_CAMERAS)
def test_special_cameras_lose_no_sphere(device, name):
    """Narrow, wide, one pixel, an axis outside the image, a domain smaller than the image."""
    rng, camera = np.random.default_rng(7), SPECIAL_CAMERAS[name]
    points = shown_points(camera, rng, 20 * SPHERES)
    shown, may, _ = device_meeting(camera, points, spheres_that_hold(points, rng), device)
    assert not (shown & ~may).any() and shown.sum() > SPHERES


@pytest.mark.parametrize("model", ["pinhole", "brown", "rational"])
@settings(max_examples=12)
@given(seed=seeds)
def test_a_sphere_inside_holds_only_shown_points(device, model, seed):
    """Brute force on `inside`: of such a sphere every point is drawn, also those on its surface."""
    rng = np.random.default_rng(seed)
    camera = MODELS[model](rng, IDENTITY, int(rng.choice([24, 700])))
    points = shown_points(camera, rng, SPHERES)
    shown, _, inside = device_meeting(camera, points, spheres_that_hold(points, rng), device)
    drawn_wrongly = np.flatnonzero(inside & ~shown)
    assert not len(drawn_wrongly), (points[drawn_wrongly[0]], camera)


def test_special_cameras_have_no_point_out_of_an_inside(device):
    """Where the lens's domain or field of view is small, or its axis beside the image."""
    for name in ("narrow", "widest", "axis far outside", "domain smaller than the image"):
        rng, camera = np.random.default_rng(7), SPECIAL_CAMERAS[name]
        points = shown_points(camera, rng, 20 * SPHERES)
        shown, _, inside = device_meeting(camera, points, spheres_that_hold(points, rng), device)
        assert not (inside & ~shown).any()
        assert inside.any() == (name == "widest"), name


# --- blocks of a cloud ---


def places(camera: dw.Camera) -> dict[str, tuple[np.ndarray, float, str]]:
    """Centres in the camera frame, radii [m] and forms of single blocks about a view."""
    rng = np.random.default_rng(1)
    border = {}
    for name, (u, v) in {
        "left": (0, 0.5),
        "right": (1, 0.5),
        "upper": (0.5, 0),
        "lower": (0.5, 1),
        "corner": (0, 0),
    }.items():
        ray = camera.directions(u * camera.width - 0.5, min(v * camera.height, camera.height - 0.6))
        ray = np.where(np.isfinite(ray), ray, (0.6, 0.6, 0.5))
        border[name] = 4.0 * ray, 0.3, "ball"
    return {
        **border,
        "inside": (4.0 * camera.directions(camera.width / 2, camera.height / 2), 0.2, "ball"),
        "round the camera": (np.zeros(3), 0.5, "round the camera"),
        "larger than the view": (np.array([5.0, 0, 0]), 40.0, "ball"),
        "behind": (np.array([-5.0, 0.3, 0.2]), 0.5, "ball"),
        "across the camera's plane": (np.array([0.0, 3.0, 0.3]), 0.6, "ball"),
        "at the camera": (np.array([0.3, 0.3, 0.0]), 0.5, "ball"),
        "anywhere": (rng.normal(size=3) * 5, 1.0, "ball"),
    }


@pytest.mark.parametrize("model", MODELS)
def test_blocks_all_about_a_view(device, model):
    """Across each border, at the corner, round the camera, behind, larger than all of the view."""
    rng = np.random.default_rng(11)
    drawn = 0
    for _ in range(4):
        pose = dw.Pose.from_orientation(rng.uniform(-3, 3, 3), rng.uniform(-180, 180, 3))
        camera = MODELS[model](rng, pose, 60)
        for center, radius, form in places(camera).values():
            points = clump(rng, 512, center, radius, form)
            cloud = dw.PointCloud(pose.to_world(points).astype(np.float32))
            ours = dw.render(cloud.prepare(device=device), camera, device=device)
            assert_same_map(ours, dw.render(cloud, camera, device=device))
            drawn += ours.stats.drawn
    assert drawn > 200


def seen_blocks(
    chunks: dw.PreparedCloud, camera: dw.Camera, depth: str = "range"
) -> tuple[np.ndarray, np.ndarray]:
    """Blocks that the CPU's cull kernel lists for a view, and what it counts of the others."""
    config = RenderConfig(depth)
    views, points = DeviceViews([ViewPlan(camera)], config, chunks.device), points_of(chunks)
    seen = wp.zeros(chunks.blocks + 1, dtype=wp.int32, device=chunks.device)
    counts = wp.zeros(COUNT_COLUMNS, dtype=wp.int64, device=chunks.device)
    wp.launch(
        cull_blocks.cull_kernel(SplatConfig(points.source, views.model, depth, False)),
        dim=1,
        inputs=[
            *(views.arrays[0], 0, points.arrays),
            *points.block_arrays[:3],
            *(0, -(-chunks.blocks // GROUP), points.count),
        ],
        outputs=[seen, counts],
        device=chunks.device,
    )
    return seen.numpy()[: int(seen.numpy()[-1])], counts.numpy()


@pytest.fixture(scope="module")
def chunks() -> dw.PreparedCloud:
    """A room of 2000 blocks."""
    return dw.PointCloud(room(ROOM_POINTS)).prepare(device="cpu")


def away(model: str) -> dw.Camera:
    """A camera far beside the room that looks away from it."""
    pose = dw.Pose.from_orientation((100, 0, 0), (0, 0, 0))
    return {
        "pinhole": lambda: dw.PinholeCamera.from_fov((60, 45), (64, 48)).with_pose(pose),
        "brown": lambda: dw.PinholeCamera(50.0, 50.0, 31.5, 23.5, 64, 48, pose, (-0.1, 0.01, 0, 0)),
        "fisheye": lambda: dw.FisheyeCamera(50.0, 50.0, 31.5, 23.5, 64, 48, pose),
        "double_sphere": lambda: dw.DoubleSphereCamera(
            50.0, 50.0, 31.5, 23.5, -0.2, 0.55, 64, 48, pose
        ),
        "equirectangular": lambda: dw.EquirectangularCamera(64, 48, pose, 360, (30, 80)),
        "cylindrical": lambda: dw.CylindricalCamera(64, 48, pose, 360, (-70, -30)),
        "orthographic": lambda: dw.OrthographicCamera(0.05, 64, 48, pose),
    }[model]()


AWAY = ["pinhole", "brown", "fisheye", "double_sphere", "equirectangular", "cylindrical"]


@pytest.mark.parametrize("model", [*AWAY, "orthographic"])
def test_a_camera_that_looks_away_sees_no_block(chunks, model):
    """Nothing of the cloud is looked at, and every point is counted."""
    seen, counts = seen_blocks(chunks, away(model))
    assert len(seen) == 0
    assert counts[BEHIND] + counts[OUTSIDE] == len(chunks) == counts.sum()


# Bounds of the share of blocks: half as much again as the share with a point in the image, and
# those across the plane of a camera that sees ahead only: their points are counted one by one.
SHARES = {
    "pinhole": 0.33,
    "brown": 0.37,
    "fisheye": 0.36,
    "double_sphere": 0.29,
    "equirectangular": 0.18,
    "cylindrical": 0.18,
    "orthographic": 0.38,
}


@pytest.mark.parametrize("model", SHARES)
def test_a_view_from_inside_a_room_sees_a_part_of_its_blocks(chunks, model):
    """The share of blocks that is looked at stays near that of blocks in view."""
    camera = away(model).with_pose(dw.Pose.from_orientation((0, 0, 0), (0, 0, 25)))
    seen, counts = seen_blocks(chunks, camera)
    assert 0 < len(seen) < SHARES[model] * chunks.blocks
    assert counts.sum() == (chunks.blocks - len(seen)) * BLOCK


def test_blocks_that_are_seen_are_those_with_drawn_points(chunks):
    """Every block with a point in the image is listed; few others are."""
    camera = dw.PinholeCamera.from_fov((60, 45), (640, 480), (1, 0.5, 0.2), (3, 10, 60))
    listed, _ = seen_blocks(chunks, camera)
    whole = -1 - listed[listed < 0]
    seen = np.where(listed < 0, -1 - listed, listed)
    points = np.stack(
        [axis.numpy() for axis in (chunks.source.x, chunks.source.y, chunks.source.z)], axis=1
    )
    shown = camera.project(points)[3].reshape(-1, BLOCK)
    in_image = shown.any(axis=1)
    assert shown[whole].all() and len(whole) > 0.6 * shown.all(axis=1).sum()
    assert set(np.flatnonzero(in_image)) <= set(seen.tolist())
    spheres = chunks.source.spheres.numpy()
    x = camera.to_camera(spheres[:, :3])[:, 0]
    across = np.abs(x) <= 1.01 * spheres[:, 3]  # behind in part: looked at for its counts
    assert (~across[seen]).sum() < 1.5 * in_image.sum()


def test_z_depth_of_a_wide_lens_culls_what_is_behind(chunks):
    """A fisheye has points behind it; with `z` they are behind, as blocks and as points."""
    camera = dw.FisheyeCamera(20.0, 20.0, 31.5, 23.5, 64, 48, IDENTITY)
    _, counts = seen_blocks(chunks, camera, "z")
    assert counts[BEHIND] > 0.3 * len(chunks)
    cloud = dw.PointCloud(room(ROOM_POINTS))
    assert_same_map(
        dw.render(chunks, camera, depth="z", device="cpu"),
        dw.render(cloud, camera, depth="z", device="cpu"),
    )


def test_a_sensor_that_moves_culls_nothing_it_meets(device):
    """The frame of a moving LiDAR depends on the point: what it draws is drawn from blocks too."""
    pose = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))
    end = dw.Pose.from_orientation((2.0, 0.5, 0.1), (0, 5, 60))
    lidar = dw.SpinningLidar(
        128, tuple(np.linspace(20, -20, 16)), pose, origin_offset=0.03, pose_end=end
    )
    cloud = dw.PointCloud(room(20_000))
    for camera in (lidar, dataclasses.replace(lidar, pose_end=None)):
        ours = dw.render(cloud.prepare(device=device), camera, device=device)
        assert_same_map(ours, dw.render(cloud, camera, device=device))
        assert ours.stats.drawn > 1000


@pytest.mark.parametrize("model", ["pinhole", "orthographic"])
def test_rounding_moves_no_point_out_of_its_sphere(device, model):
    """Blocks of two neighbouring numbers on the camera's plane, where rounding decides."""
    rng = np.random.default_rng(13)
    for _ in range(4):
        pose = dw.Pose.from_orientation((0, 0, 0), rng.uniform(-180, 180, 3))
        on_plane = rng.uniform(-1000, 1000, (250, 3)) * (0, 1, 1)
        first = pose.to_world(on_plane).astype(np.float32)
        second, rows = first.copy(), np.arange(len(first))
        axis = rng.integers(0, 3, len(first))
        second[rows, axis] = np.nextafter(second[rows, axis], np.float32(np.inf))
        cloud = dw.PointCloud(np.repeat(np.concatenate([first, second]), BLOCK // 2, axis=0))
        camera = away(model).with_pose(pose)
        ours = dw.render(cloud.prepare(device=device), camera, device=device)
        assert_same_map(ours, dw.render(cloud, camera, device=device))


@pytest.mark.parametrize("kind", ["range", "z"])
def test_range_bounds_do_not_cull(device, kind):
    """Too far and too near are counted point by point, whatever blocks they stand in."""
    cloud = dw.PointCloud(room(200_000))
    camera = dw.PinholeCamera.from_fov((90, 70), (40, 30))
    options = {"depth": kind, "min_range": 2.8, "max_range": 3.5, "device": device}
    ours = dw.render(cloud.prepare(device=device), camera, **options)
    assert ours.stats.too_far > 0 and ours.stats.too_near > 0
    assert_same_map(ours, dw.render(cloud, camera, **options))


def test_views_of_two_models_share_no_plan(chunks):
    """A plan has one `may_meet`: two of them are refused."""
    cameras = [ViewPlan(away(name)) for name in ("pinhole", "fisheye")]
    with pytest.raises(InputError, match="one camera model"):
        DeviceViews(cameras, RenderConfig(), chunks.device)
