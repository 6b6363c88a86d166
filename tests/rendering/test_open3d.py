"""A real room scan against Open3D's `project_to_depth_image`, an independent implementation."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import depthwarp as dw

E = 2.0**-24  # half a unit in the last place of float32, relatively

VIEWS = {
    # From the laser itself, which stood at the origin: one surface in each direction.
    "laser": ((0, 0, 0), (0, 0, 0)),
    "laser, back": ((0, 0, 0), (0, 0, 180)),
    # From elsewhere in the room: surfaces overlap, gaps show what is behind.
    "aside": ((2.5, 1.5, 0.3), (0, 0, 140)),
    "down": ((-3.0, 0.5, 1.0), (5, 35, -20)),
    "rolled": ((4.0, -2.0, 0.0), (30, -10, 200)),
}


@pytest.fixture(scope="module")
def room_scan(shared_data: Path) -> dw.PointCloud:
    """The full-sphere laser scan of a room, 112,586 points."""
    path = shared_data / "indoor" / "room_scan1.pcd"
    if not path.is_file():
        pytest.skip(f"no real scan on this machine: there is no file {path}")
    return dw.read(path)


@pytest.fixture(scope="module")
def open3d():
    """Open3D, if it is installed and rounds to the nearest pixel (older versions cut)."""
    o3d = pytest.importorskip("open3d", reason="needs the package open3d, an independent renderer")
    column = np.argmax(render_open3d(o3d, np.float32([[0.9, 0, 1]]), np.eye(3), np.eye(4), (2, 1)))
    if column != 1:
        pytest.skip(f"open3d {o3d.__version__} cuts pixel coordinates instead of rounding them")
    return o3d


def render_open3d(o3d, points, K, optical_from_world, size) -> np.ndarray:
    """z depth [m] by Open3D, shape (H, W), 0 = empty."""
    cloud = o3d.t.geometry.PointCloud(o3d.core.Tensor(np.ascontiguousarray(points)))
    image = cloud.project_to_depth_image(
        *size,
        o3d.core.Tensor(np.ascontiguousarray(K)),
        o3d.core.Tensor(np.ascontiguousarray(optical_from_world)),
        depth_scale=1.0,
        depth_max=1e9,
    )
    return image.as_tensor().numpy()[:, :, 0]


def rounding_bounds(points: np.ndarray, camera: dw.PinholeCamera):
    """u, v and z in float64, and how far float32 arithmetic may move each of them.

    Both programs rotate and shift in float32: at most 8 roundings of terms that are no larger than
    |R| (|p| + |P_C|). The division carries that to the pixel as f / z (dx + |x / z| dz), and adds
    its own roundings of f, x / z, the product, the sum and u + 0.5.
    """
    points = points.astype(np.float64)
    transform, center = camera.pose.optical_from_world, camera.pose.center_world
    x, y, z = (points @ transform[:3, :3].T + transform[:3, 3]).T
    dx, dy, dz = 8 * E * np.abs(transform[:3, :3]) @ (np.abs(points) + np.abs(center)).T
    with np.errstate(divide="ignore", invalid="ignore"):
        ahead = np.where(z > 2 * dz, z - dz, np.nan)  # nearer ones: no statement, handled apart
        u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        du = camera.fx / ahead * (dx + np.abs(x / z) * dz)
        dv = camera.fy / ahead * (dy + np.abs(y / z) * dz)
    du += E * (4 * np.abs(u - camera.cx) + 2 * np.abs(u) + 1)
    dv += E * (4 * np.abs(v - camera.cy) + 2 * np.abs(v) + 1)
    return u, v, z, du, dv, dz


def explain(points: np.ndarray, camera: dw.PinholeCamera):
    """For each pixel: the depths that rounding allows, and whether a point lies at its border.

    Returns:
        nearest: smallest depth of any point that may fall here, less its rounding; inf if none.
        farthest: smallest depth of the points that surely fall here, with their rounding; inf if
            there is none, so that the pixel may be empty.
        at_border: whether a point may fall here or beside, depending on the rounding.
    """
    u, v, z, du, dv, dz = rounding_bounds(points, camera)
    height, width = camera.height, camera.width
    nearest = np.full((height, width), np.inf)
    farthest = np.full((height, width), np.inf)
    at_border = np.zeros((height, width), bool)
    # A point within rounding of the camera's plane is far out of the image, unless it is so near:
    unclear = np.isnan(du) & (z > -2 * dz)
    assert not (unclear & (np.abs(points - camera.pose.center_world).max(axis=1) < 0.01)).any()

    with np.errstate(invalid="ignore"):
        seen = (z > 0) & (u + du > -1) & (u - du < width) & (v + dv > -1) & (v - dv < height)
    for i in np.flatnonzero(seen):
        columns = range(math.floor(u[i] + 0.5 - du[i]), math.floor(u[i] + 0.5 + du[i]) + 1)
        rows = range(math.floor(v[i] + 0.5 - dv[i]), math.floor(v[i] + 0.5 + dv[i]) + 1)
        sure = len(columns) == len(rows) == 1
        for row in rows:
            for column in columns:
                if not (0 <= row < height and 0 <= column < width):
                    continue
                nearest[row, column] = min(nearest[row, column], z[i] - dz[i])
                if sure:
                    farthest[row, column] = min(farthest[row, column], z[i] + dz[i])
                else:
                    at_border[row, column] = True
    return nearest, farthest, at_border


@pytest.mark.parametrize("name", VIEWS)
@pytest.mark.parametrize("size", [(640, 480), (160, 120)], ids=str)
def test_a_real_scan_is_rendered_as_by_open3d(device, room_scan, open3d, name, size):
    """Every pixel is Open3D's, but for those where a point lies within rounding of their border."""
    position, orientation = VIEWS[name]
    camera = dw.PinholeCamera.from_fov((70, 55), size, position, orientation)
    points = room_scan.points_world
    ours = dw.render(room_scan, camera, depth="z", max_range=math.inf, device=device)
    theirs = render_open3d(open3d, points, camera.K, camera.pose.optical_from_world, size)

    nearest, farthest, at_border = explain(points, camera)
    rounding = 2 * 8 * E * 60  # |R| (|p| + |P_C|) of this scan and these views is below 60 m
    same = np.abs(ours.depth - theirs) <= rounding
    same &= (ours.depth > 0) == (theirs > 0)
    print(
        f"{name}, {size[0]} x {size[1]}: {(~same).sum()} of {same.size} pixels differ, "
        f"{at_border.sum()} have a point at their border, {ours.stats.drawn} are drawn"
    )
    assert ours.stats.drawn > 1000
    assert at_border.sum() <= 0.01 * ours.stats.drawn
    assert not (~same & ~at_border).any()
    assert (~same).sum() <= 20
    # Each of the two is what exact arithmetic allows, on the explained pixels too.
    for depth in (ours.depth.astype(np.float64), theirs.astype(np.float64)):
        drawn = depth > 0
        assert (depth[drawn] >= nearest[drawn]).all()
        assert (depth[drawn] <= farthest[drawn]).all()
        assert np.isinf(farthest[~drawn]).all()
