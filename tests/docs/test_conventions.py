"""Every sentence of the lists in `docs/conventions.md` is tested here, and says what it says there.

A test names its sentence; a sentence without a test, or a test without a sentence, is an error.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

import depthwarp as dw
from depthwarp.cameras import formats
from depthwarp.errors import InputError

PAGE = Path(__file__).resolve().parents[2] / "docs" / "conventions.md"
TESTED: dict[str, Callable[..., None]] = {}

ORIGIN = dw.Pose.from_orientation((0, 0, 0), (0, 0, 0))
SQUARE = dw.PinholeCamera(10.0, 10.0, 5.0, 5.0, 11, 11, ORIGIN)


def says(sentence: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Mark the test of a sentence."""

    def mark(test: Callable[..., None]) -> Callable[..., None]:
        assert sentence not in TESTED
        TESTED[sentence] = test
        return test

    return mark


def looking(roll: float, pitch: float, yaw: float) -> dw.PinholeCamera:
    """A camera at the origin, 90 degrees wide."""
    return dw.PinholeCamera.from_fov((90, 90), (11, 11), orientation=(roll, pitch, yaw))


def pixel(camera: dw.Camera, point: tuple[float, float, float]) -> tuple[float, float]:
    """(u, v) of a world point."""
    u, v, _, _ = camera.project(np.array([point]))
    return float(u[0]), float(v[0])


def drawn(camera: dw.Camera, *points: tuple[float, float, float], **options) -> dw.DepthMap:
    """The depth map of some points."""
    cloud = dw.PointCloud(np.array(points, np.float32).reshape(-1, 3))
    return dw.render(cloud, camera, device="cpu", **options)


def test_every_sentence_has_a_test():
    """The page's sentences and the tests are the same, in the same order."""
    sentences = re.findall(r"^- (.+)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(sentences) > 30
    assert list(TESTED) == sentences


def test_every_file_format_states_its_convention():
    """The table of files has a row for each format, with the words of its module."""
    rows = re.findall(
        r"^\|[^|]+\| `(\w+)` \| (.+) \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE
    )
    modules = [
        importlib.import_module(f"depthwarp.cameras.formats.{name}")
        for name in (*formats.FORMATS, *formats.TRAJECTORIES)
    ]
    assert sorted(rows) == sorted((module.NAME, module.CONVENTION) for module in modules)


def test_the_picture_is_there():
    """The page shows one picture, and it can be opened."""
    (name,) = re.findall(r"!\[[^]]+\]\(([^)]+)\)", PAGE.read_text(encoding="utf-8"))
    picture = cv2.imread(str(PAGE.parent / name))
    assert picture is not None and picture.shape[1] >= 1000


# --- frames ---


@says("The world frame is right-handed, with Z up.")
def test_world():
    """Above the camera is +Z; X forward, Y left and Z up are right-handed."""
    assert pixel(looking(0, 0, 0), (2, 0, 1))[1] < 5
    np.testing.assert_array_equal(np.cross((1, 0, 0), (0, 1, 0)), (0, 0, 1))
    assert np.linalg.det(ORIGIN.rotation) == 1


@says("The camera frame has X forward, Y to the left and Z up.")
def test_camera_frame():
    """Points ahead, left of and above the axis."""
    u, v = SQUARE.image_of(np.array([[2.0, 0, 0], [2, 1, 0], [2, 0, 1]]))
    assert (u.tolist(), v.tolist()) == ([5, 0, 5], [5, 5, 0])


@says("A camera with the orientation (0, 0, 0) looks along the world's X axis.")
def test_forward():
    """The axis is in the middle of the image."""
    assert pixel(looking(0, 0, 0), (3, 0, 0)) == (5, 5)


@says("A positive yaw turns the view to the left.")
def test_yaw():
    """After 90 degrees the world's Y axis is ahead."""
    assert pixel(looking(0, 0, 90), (0, 3, 0)) == pytest.approx((5, 5))


@says("A positive pitch turns the view down.")
def test_pitch():
    """After 90 degrees the camera looks at the floor."""
    assert pixel(looking(0, 90, 0), (0, 0, -3)) == pytest.approx((5, 5))


@says("A positive roll turns the picture anticlockwise.")
def test_roll():
    """After 90 degrees what was on the left is below."""
    u, v = pixel(looking(90, 0, 0), (3, 1, 0))
    assert u == pytest.approx(5) and v > 6


@says(
    "Orientations are (roll, pitch, yaw) in degrees, and the rotation from world to camera is "
    "Rx(roll) Ry(pitch) Rz(yaw), passive."
)
def test_orientation():
    """Against OpenCV's rotation vectors: passive turns are those of the negative vectors."""
    angles = np.radians((20.0, -35.0, 70.0))
    turns = [cv2.Rodrigues(-angle * axis)[0] for angle, axis in zip(angles, np.eye(3), strict=True)]
    pose = dw.Pose.from_orientation((0, 0, 0), np.degrees(angles))
    np.testing.assert_allclose(pose.rotation, turns[0] @ turns[1] @ turns[2], atol=1e-12)


@says("OpenCV's optical frame has X to the right, Y down and Z forward.")
def test_optical_frame():
    """The camera's forward, left and up in the optical frame."""
    forward, left, up = (ORIGIN.optical_from_world[:3, :3] @ axis for axis in np.eye(3))
    assert (forward.tolist(), left.tolist(), up.tolist()) == ([0, 0, 1], [-1, 0, 0], [0, -1, 0])


@says(
    "`optical_from_world` is a 4 x 4 matrix that takes world points, as column vectors, to the "
    "optical frame."
)
def test_optical_from_world():
    """It gives the point that K draws at the pixel."""
    camera = dw.PinholeCamera.from_fov((70, 50), (64, 48), (1, 2, 3), (5, 10, 20))
    point = (4.0, 3.0, 2.5)
    optical = camera.pose.optical_from_world @ (*point, 1)
    u, v, w = camera.K @ optical[:3]
    assert pixel(camera, point) == pytest.approx((u / w, v / w))


@says("OpenGL's camera frame is the optical frame turned by 180 degrees about X.")
def test_opengl():
    """X stays to the right, Y becomes up and Z becomes backwards."""
    turn = cv2.Rodrigues(np.array([np.pi, 0, 0]))[0]
    np.testing.assert_allclose(turn @ (1, 0, 0), (1, 0, 0), atol=1e-12)
    np.testing.assert_allclose(turn @ (0, -1, 0), (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(turn @ (0, 0, 1), (0, 0, -1), atol=1e-12)


@says("A matrix whose upper 3 x 3 is not a rotation is refused, and the message says by how much.")
def test_not_a_rotation():
    """A stretched axis, a mirrored one."""
    with pytest.raises(InputError, match=r"differs from the identity by 0\.21"):
        dw.Pose.from_optical(np.diag([1.1, 1, 1, 1]))
    with pytest.raises(InputError, match=r"determinant -1"):
        dw.Pose.from_optical(np.diag([-1, 1, 1, 1]))


# --- pixels ---


@says("Column u grows to the right and row v grows downwards.")
def test_directions_of_pixels():
    """A point to the right and below has a larger u and v than the axis."""
    u, v = pixel(SQUARE, (2, -0.2, -0.4))
    assert u > 5 and v > 5


@says("Pixel centres are at whole numbers: the centre of the upper left pixel is (0, 0).")
def test_pixel_centres():
    """The ray of (0, 0) falls into the middle of the first pixel."""
    ray = SQUARE.directions(0, 0)
    depth_map = drawn(SQUARE, tuple(2 * ray))
    assert depth_map.depth[0, 0] == pytest.approx(2)
    corner = dw.PinholeCamera.from_fov((90, 90), (11, 11))
    assert corner.cx == 5 and corner.directions(5, 5).tolist() == [1, 0, 0]


@says("An image spans u from -0.5, which is inside, to width - 0.5, which is outside.")
def test_span():
    """Points on both borders."""
    camera = dw.PinholeCamera(1.0, 1.0, 0.0, 0.0, 3, 1, ORIGIN)
    valid = camera.project(np.array([[1, 0.5, 0], [1, -2.5, 0], [1, -2.4999, 0]]))[3]
    assert valid.tolist() == [True, False, True]


@says("A point falls into the pixel (floor(u + 0.5), floor(v + 0.5)).")
def test_rounding():
    """Halves go up, also where rounding to even would not."""
    camera = dw.PinholeCamera(1.0, 1.0, 0.0, 0.0, 4, 4, ORIGIN)
    depth_map = drawn(camera, (1, -0.5, -1.5))
    assert np.argwhere(depth_map.depth).tolist() == [[2, 1]]


@says("Arrays are indexed [row, column] and have the shape (height, width).")
def test_arrays():
    """A wide image; a point at the right border."""
    camera = dw.PinholeCamera(2.0, 2.0, 3.0, 1.0, 7, 3, ORIGIN)
    depth_map = drawn(camera, (1, -1.5, 0))
    assert depth_map.depth.shape == depth_map.index.shape == depth_map.state.shape == (3, 7)
    assert depth_map.depth[1, 6] > 0


@says("Sizes are (width, height).")
def test_sizes():
    """As OpenCV has them."""
    camera = dw.PinholeCamera.from_fov((60, 45), (7, 3))
    assert camera.size == (7, 3) == (camera.width, camera.height)


# --- depth ---

POINT = (3.0, 1.5, 1.0)
LENGTH = np.float32(3.5)


@says("The range is the distance from the camera's centre.")
def test_range():
    """3, 1.5, 1 is 3.5 away."""
    assert drawn(SQUARE, POINT).depth.max() == LENGTH


@says("The z depth is the distance along the optical axis.")
def test_z():
    """3, 1.5, 1 is 3 ahead."""
    assert drawn(SQUARE, POINT, depth="z").depth.max() == 3


@says(
    "A fisheye or double sphere camera has z depth up to 85 degrees from its axis, and draws by z "
    "nothing beyond."
)
def test_z_of_wide_lenses():
    """84 and 86 degrees to the left: both by range, one by z; the pixel beyond has no point."""
    fisheye = dw.FisheyeCamera(60.0, 60.0, 100.0, 20.0, 201, 41, ORIGIN)
    spheres = dw.DoubleSphereCamera(60.0, 60.0, 100.0, 20.0, 0.1, 0.6, 201, 41, ORIGIN)
    inside, beyond = ((np.cos(a), np.sin(a), 0) for a in np.radians((84, 86)))
    for camera in (fisheye, spheres):
        assert drawn(camera, inside, beyond).stats.drawn == 2
        stats = drawn(camera, inside, beyond, depth="z").stats
        assert (stats.drawn, stats.behind) == (1, 1)
        assert camera.project(np.array([inside, beyond]), "z")[3].tolist() == [True, False]
        row, column = np.argwhere(drawn(camera, beyond).depth)[0]
        assert np.isnan(camera.unproject(np.ones((41, 201)), "z")[row, column]).all()


@says("Of an orthographic camera both depths are the distance from the image's plane.")
def test_orthographic_depth():
    """3, 1.5, 1 is 3 before the plane."""
    camera = dw.OrthographicCamera(0.5, 11, 11, ORIGIN)
    for kind in ("range", "z"):
        assert drawn(camera, POINT, depth=kind).depth.max() == 3


@says(
    "The range of a spinning LiDAR is the way along the beam, and that of its origin from the axis."
)
def test_lidar_range():
    """A beam that starts 0.1 m from the axis, level and 30 degrees up."""
    lidar = dw.SpinningLidar(64, (30.0, 0.0), ORIGIN, origin_offset=0.1)
    up = (0.1 + 2 * np.cos(np.pi / 6), 0.0, 2 * np.sin(np.pi / 6))
    depth_map = drawn(lidar, (2.1, 0, 0), up)
    np.testing.assert_allclose(depth_map.depth.max(axis=1), (2.1, 2.1), rtol=1e-6)


@says("Panoramas and spinning LiDARs have no z depth, and asking for it is an error.")
def test_no_z():
    """The message says what to use."""
    for camera in (
        dw.EquirectangularCamera.looking((8, 4)),
        dw.CylindricalCamera.looking((8, 4)),
        dw.SpinningLidar(8, (1.0, -1.0), ORIGIN),
    ):
        with pytest.raises(InputError, match="depth='range'"):
            drawn(camera, POINT, depth="z")


@says("Depths are float32 and in metres.")
def test_units():
    """A point 2 m ahead."""
    depth = drawn(SQUARE, (2, 0, 0)).depth
    assert depth.dtype == np.float32 and depth[5, 5] == 2


@says("An empty pixel has depth 0, index -1 and the state EMPTY.")
def test_empty():
    """All but the one that is drawn."""
    depth_map = drawn(SQUARE, (2, 0, 0))
    empty = np.ones((11, 11), bool)
    empty[5, 5] = False
    assert (depth_map.depth[empty] == 0).all() and (depth_map.index[empty] == -1).all()
    assert (depth_map.state[empty] == dw.State.EMPTY).all()
    assert depth_map.state[5, 5] == dw.State.MEASURED


@says("A depth map holds no NaN and no infinity.")
def test_finite():
    """Points that are not finite, or overflow, leave nothing."""
    bad = [(np.nan, 0, 0), (np.inf, 0, 0), (3e38, 3e38, 3e38), (2, -np.inf, 0)]
    depth_map = drawn(SQUARE, *bad, (2, 0, 0), max_range=np.inf)
    assert np.isfinite(depth_map.depth).all() and depth_map.stats.drawn == 1


@says("The nearest point of a pixel wins, and of equally near ones the first of the cloud.")
def test_nearest():
    """Three points on one ray, two of them alike."""
    depth_map = drawn(SQUARE, (4, 0, 0), (2, 0, 0), (2, 0, 0))
    assert depth_map.depth[5, 5] == 2 and depth_map.index[5, 5] == 1


@says("A point farther than `max_range`, by default 15 m, is not drawn.")
def test_max_range():
    """15 m is, a little more is not."""
    assert drawn(SQUARE, (15, 0, 0)).stats.drawn == 1
    assert drawn(SQUARE, (np.nextafter(np.float32(15), 16), 0, 0)).stats.too_far == 1
    assert drawn(SQUARE, (20, 0, 0), max_range=20.0).stats.drawn == 1


@says("Of a 16-bit PNG the value 65535 is `max_range` and 0 is empty.")
def test_png(tmp_path):
    """A point at the greatest range, one at half of it."""
    path = tmp_path / "depth.png"
    drawn(SQUARE, (15, 0, 0), (4.5, 6, 0), (1.0, 0.5, 0.5), max_range=15.0).save(path)
    values = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert values.dtype == np.uint16 and values.max() == values[5, 5] == 65535
    assert np.count_nonzero(values) == 2


# --- camera models ---

DISTORTION = (
    -0.2,
    0.06,
    1e-3,
    -2e-3,
    -0.01,
    0.02,
    0.01,
    -0.003,
    1e-3,
    -1e-3,
    2e-3,
    5e-4,
    0.01,
    -0.02,
)


@says("A point outside a model's domain has no pixel: nothing folds back into the image.")
def test_domain():
    """With k1 = -0.39 growing angles turn back at r = 0.92: beyond that nothing is drawn."""
    camera = dw.PinholeCamera(20.0, 20.0, 5.0, 5.0, 11, 11, ORIGIN, (-0.39, 0, 0, 0))
    u, _, _, valid = camera.project(np.array([[1, -0.2, 0], [1, -1.6, 0]]))
    assert valid.tolist() == [True, False] and np.isnan(u).tolist() == [False, True]
    # The polynomial alone would draw the second point at 5 + 20 * 1.6 * (1 - 0.39 * 1.6^2) = 5.05.
    assert drawn(camera, (1, -1.6, 0)).stats.outside == 1


@says(
    "Distortion coefficients have OpenCV's order: k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, "
    "tau_x, tau_y."
)
def test_distortion_order():
    """All fourteen against `cv2.projectPoints`."""
    camera = dw.PinholeCamera(500.0, 510.0, 320.0, 240.0, 640, 480, ORIGIN, DISTORTION)
    optical = np.array([[0.3, 0.2, 1.0], [-0.4, 0.1, 1.5], [0.1, -0.3, 0.8]])
    expected, _ = cv2.projectPoints(
        optical, np.zeros(3), np.zeros(3), camera.K, np.array(DISTORTION)
    )
    u, v, _, _ = camera.project(optical[:, [2, 0, 1]] * (1, -1, -1))
    np.testing.assert_allclose(np.stack([u, v], axis=1), expected[:, 0], atol=1e-9)


@says(
    "A fisheye draws a ray at the angle theta from the axis at the distance "
    "theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)."
)
def test_fisheye():
    """To the right, 1.2 rad from the axis."""
    camera = dw.FisheyeCamera(
        100.0, 100.0, 200.0, 200.0, 401, 401, ORIGIN, (0.01, 0.02, -0.003, 0.001)
    )
    theta = 1.2
    bent = theta + 0.01 * theta**3 + 0.02 * theta**5 - 0.003 * theta**7 + 0.001 * theta**9
    u, v = pixel(camera, (np.cos(theta), -np.sin(theta), 0))
    assert (u, v) == pytest.approx((200 + 100 * bent, 200))


PANORAMAS = [
    dw.EquirectangularCamera.looking((360, 180), orientation=(0, 0, 30)),
    dw.CylindricalCamera.looking((360, 90), orientation=(0, 0, 30)),
]


@says("The middle column of a panorama looks along the camera's X axis.")
def test_panorama_middle():
    """Of 360 columns the middle is between 179 and 180."""
    for camera in PANORAMAS:
        u, v = pixel(camera, (np.cos(np.pi / 6), np.sin(np.pi / 6), 0))
        assert (u, v) == pytest.approx((179.5, (camera.height - 1) / 2))


@says("Columns of a panorama to the left of the middle see what is to the left.")
def test_panorama_left():
    """A quarter of the turn to the left is a quarter of the width."""
    for camera in PANORAMAS:
        assert pixel(camera, (-np.sin(np.pi / 6), np.cos(np.pi / 6), 0))[0] == pytest.approx(89.5)


@says("The first and the last column of a full turn meet behind the camera.")
def test_panorama_seam():
    """A little to either side of straight behind."""
    for camera in PANORAMAS:
        u = [pixel(camera.with_pose(ORIGIN), (-1, side, 0))[0] for side in (0.001, -0.001)]
        assert u == pytest.approx([-0.5 + 0.18 / np.pi, 359.5 - 0.18 / np.pi], abs=1e-3)
        assert drawn(camera.with_pose(ORIGIN), (-1, 0, 0), (-1, -0.0, 0)).stats.outside == 0


@says(
    "An equirectangular image has equal angles between its rows, a cylindrical one equal tangents."
)
def test_panorama_rows():
    """30 and 45 degrees up."""
    angles = np.radians((0, 30, 45))
    rays = np.stack([np.cos(angles), np.zeros(3), np.sin(angles)], axis=1)
    _, v = PANORAMAS[0].image_of(rays)
    assert v == pytest.approx(89.5 - np.array((0, 30, 45)))
    _, v = PANORAMAS[1].image_of(rays)
    assert v == pytest.approx(44.5 - 45 * np.tan(angles))


@says(
    "The middle pixel of an orthographic image looks along the axis through the camera's position."
)
def test_orthographic():
    """Half a metre to the left is two pixels of a quarter metre."""
    camera = dw.OrthographicCamera.looking(0.25, (11, 11), (1, 2, 3))
    assert pixel(camera, (9, 2, 3)) == (5, 5)
    assert pixel(camera, (9, 2.5, 3)) == (3, 5) == pixel(camera, (2, 2.5, 3))


LIDAR = dw.SpinningLidar(8, (10.0, 0.0, -10.0), ORIGIN, azimuth_zero=4.0)


@says("A spinning LiDAR has one row for each beam and one column for each moment of a turn.")
def test_lidar_size():
    """Three beams, eight moments; a point falls to the nearest beam."""
    assert LIDAR.size == (8, 3)
    slopes = np.tan(np.radians((9, 6, 4, -4, -14)))
    _, v = LIDAR.image_of(np.stack([np.ones(5), np.zeros(5), slopes], axis=1))
    assert v.tolist() == [0, 0, 1, 1, 2]


@says("Seen from above a spinning LiDAR turns clockwise.")
def test_lidar_turns():
    """After straight ahead comes what is on the right."""
    u = [pixel(LIDAR, point)[0] for point in ((1, 0, 0), (0, -1, 0), (-1, -1e-9, 0))]
    assert u == pytest.approx([4, 6, 0], abs=1e-6)


@says("A LiDAR that moves has a pose of its own for every column.")
def test_lidar_moves():
    """Moving ahead by 0.8 m a turn: ranges are those of the moment."""
    end = dw.Pose.from_orientation((0.8, 0, 0), (0, 0, 0))
    lidar = dw.SpinningLidar(8, (0.0, -9.0), ORIGIN, azimuth_zero=4.0, pose_end=end)
    ahead, behind = drawn(lidar, (5, 0, 0)), drawn(lidar, (-5, 0, 0))
    assert ahead.depth[0, 4] == pytest.approx(5 - 0.8 * 4 / 8)
    assert behind.depth[0, 0] == pytest.approx(5)


@says(
    "A moving LiDAR that turns on with its spin sees a part of the world twice, and one that turns "
    "against it misses a part, which is not drawn."
)
def test_lidar_seam():
    """Clockwise by 90 degrees a turn it sees 450 degrees of the world, else 270."""
    circle = np.radians(np.arange(0, 360, 2))
    points = 5 * np.stack([np.cos(circle), np.sin(circle), 0 * circle], axis=1)
    for yaw, seen in ((-90, 450), (90, 270)):
        end = dw.Pose.from_orientation((0, 0, 0), (0, 0, yaw))
        lidar = dw.SpinningLidar(360, (0.0, -9.0), ORIGIN, pose_end=end)
        x, y, _ = np.moveaxis(lidar.unproject(np.full((2, 360), 5.0))[0], -1, 0)
        turned = np.degrees(np.unwrap(np.arctan2(y, x)))
        assert turned[0] - turned[-1] == pytest.approx(seen, abs=2)
        outside = drawn(lidar, *map(tuple, points)).stats.outside
        assert outside == pytest.approx(max(0, 360 - seen) / 2, abs=1)


# --- round trips ---


@says("`camera.project` and `camera.unproject` are each other's inverse.")
def test_inverse():
    """Pixel centres of a distorted lens, at 2 m."""
    camera = dw.PinholeCamera(50.0, 51.0, 32.0, 24.0, 64, 48, ORIGIN, DISTORTION)
    points = camera.unproject(np.full((48, 64), 2.0))
    u, v, depth, valid = camera.project(points.reshape(-1, 3))
    rows, columns = np.indices((48, 64))
    np.testing.assert_allclose(u, columns.ravel(), atol=1e-8)
    np.testing.assert_allclose(v, rows.ravel(), atol=1e-8)
    np.testing.assert_allclose(depth, 2.0)
    assert valid.all()


@says(
    "A depth map that is unprojected and rendered again gives the same pixels and the same depth."
)
def test_render_again():
    """The same but for the rounding of the points to float32."""
    points = np.random.default_rng(0).uniform(-4, 4, (2000, 3)).astype(np.float32)
    for camera in (looking(3, 4, 5), PANORAMAS[0], PANORAMAS[1]):
        first = dw.render(dw.PointCloud(points), camera, device="cpu")
        second = dw.render(first.unproject(), camera, device="cpu")
        np.testing.assert_array_equal(second.state, first.state)
        np.testing.assert_allclose(second.depth, first.depth, rtol=1e-6)


@says("All devices give the same bits.")
def test_same_bits(device):
    """A fisheye, whose angles libraries round in their own ways, here and on the CPU."""
    points = np.random.default_rng(1).uniform(-4, 4, (2000, 3)).astype(np.float32)
    camera = dw.FisheyeCamera(20.0, 20.0, 31.5, 31.5, 64, 64, ORIGIN, (0.01, 0.0, 0.0, 0.0))
    here = dw.render(dw.PointCloud(points), camera, device=device)
    there = dw.render(dw.PointCloud(points), camera, device="cpu")
    assert here.depth.tobytes() == there.depth.tobytes()
    assert here.index.tobytes() == there.index.tobytes()
