"""What else one would take: other people's filters, written from their descriptions."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

import depthwarp as dw
from benchmarks.quality.maps import Step, erase_where, filled

__all__ = ["inpaint", "ip_basic", "katz", "nearest"]

KATZ_GAMMA = 3.5
INVERSION_M = 100.0  # IP-Basic turns depths about this, so that the nearer one wins a dilation
INPAINT_RADIUS_PX = 5


def katz() -> Step:
    """Hidden points by the convex hull of the flipped cloud, gamma 3.5, through Open3D.

    Katz, Tal, Basri: Direct visibility of point sets, SIGGRAPH 2007. The points that won a pixel
    are tested: all others lie behind one of them.

    Raises:
        ImportError: Open3D is not installed.
    """
    import open3d

    def erase(depth_map: dw.DepthMap, cloud: dw.PointCloud) -> dw.DepthMap:
        drawn = depth_map.index >= 0
        center = depth_map.camera.pose.center_world
        points = cloud.points_world[depth_map.index[drawn]].astype(np.float64) - center
        shown: Any = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
        radius = float(np.linalg.norm(points, axis=1).max() * 10**KATZ_GAMMA)
        _, visible = shown.hidden_point_removal(np.zeros((3, 1)), radius)
        hidden = np.ones(len(points), dtype=bool)
        hidden[np.asarray(visible)] = False
        mask = np.zeros(drawn.shape, dtype=bool)
        mask[drawn] = hidden
        return erase_where(depth_map, mask)

    return erase


def nearest(radius: int) -> Step:
    """Each empty pixel takes the nearest measured one within `radius` [px]."""

    def fill(depth_map: dw.DepthMap, cloud: dw.PointCloud) -> dw.DepthMap:
        depth = depth_map.depth
        empty = (depth == 0).astype(np.uint8)
        if empty.all():
            return depth_map
        distance, label = cv2.distanceTransformWithLabels(
            empty, cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
        )
        by_label = np.zeros(label.max() + 1, np.float32)
        by_label[label[empty == 0]] = depth[empty == 0]
        return filled(depth_map, np.where(distance <= radius, by_label[label], 0))

    return fill


def ip_basic() -> Step:
    """IP-Basic, its fast form with a bilateral blur, from its description.

    Ku, Harakeh, Waslander: In defense of classical image processing, CRV 2018: dilation with a
    diamond of 5, closing with 5 x 5, small gaps with 7 x 7, large ones with 31 x 31, median 5,
    bilateral blur 5; all on inverted depth. No column is extended upwards, as
    in its version for whole scenes.
    """
    diamond = np.array(
        [[0, 0, 1, 0, 0], [0, 1, 1, 1, 0], [1, 1, 1, 1, 1], [0, 1, 1, 1, 0], [0, 0, 1, 0, 0]],
        np.uint8,
    )

    def fill(depth_map: dw.DepthMap, cloud: dw.PointCloud) -> dw.DepthMap:
        depth = depth_map.depth
        turned: Any = np.where(depth > 0, INVERSION_M - depth, 0).astype(np.float32)
        turned = cv2.dilate(turned, diamond)
        turned = cv2.morphologyEx(turned, cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8))
        for side in (7, 31):
            grown = cv2.dilate(turned, np.ones((side, side), np.uint8))
            turned = np.where(turned > 0, turned, grown)
        smooth = cv2.medianBlur(turned, 5)
        turned = np.where(smooth > 0, smooth, turned)
        blurred = cv2.bilateralFilter(turned, 5, 1.5, 2.0)
        turned = np.where(turned > 0, blurred, 0)
        return filled(depth_map, np.where(turned > 0, INVERSION_M - turned, 0))

    return fill


def inpaint() -> Step:
    """Telea's inpainting by OpenCV, radius 5 px, on millimetres in 16 bits; at most 65 m."""

    def fill(depth_map: dw.DepthMap, cloud: dw.PointCloud) -> dw.DepthMap:
        millimetres = np.rint(np.minimum(depth_map.depth, 65.535) * 1000).astype(np.uint16)
        empty = (millimetres == 0).astype(np.uint8)
        whole = cv2.inpaint(millimetres, empty, INPAINT_RADIUS_PX, cv2.INPAINT_TELEA)
        return filled(depth_map, np.where(empty, whole / 1000.0, depth_map.depth))

    return fill
