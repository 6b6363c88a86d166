"""The paper's figures as PNG pictures: the scanner, clouds, range views and depth maps.

Every function draws on a canvas of its own (no display, no global state) and writes one file whole
or not at all. Matplotlib is imported when a function is called. The arguments, in one frame:

- `geometry`: a scanner; `pixels_bgr`, (H, W, 3) uint8: one frame of its camera, with the measured
  points of the laser line at `rows` and `columns`, (N,) [px];
- `points`, (N, 3): a cloud [m], Z up, its not finite rows left out; `selected`, (N,) bool: those
  that the segmentation keeps;
- `position`, (3,): the camera position P_C [m];
- `rectangles`, (K, 4, 3): rectangles of the range view [m], corners in order around each, nearest
  rectangle first; the last one is the depth plane;
- `rotation`, (3, 3): the matrix R of equations (4) to (6); its rows are the camera's X, Y, Z axes;
- `orientation`, (3,): the angles alpha, beta, gamma about X, Y and Z [degrees];
- `depth`, (H, W): a depth map [m], 0 where it is empty; `depths`: several of one size, each with
  a mask of pixels to tint in `marked`, (H, W) bool, and its text in `captions`;
- `path`: the PNG file to write; `title`: what stands above the picture.

Each function raises `InputError` for an array that it cannot draw and a file that it cannot write,
and `MissingExtraError` where matplotlib is not installed.
"""

from depthwarp.plots.clouds import (
    plot_point_cloud,
    plot_range_view,
    plot_range_view_angles,
    plot_rotated_cloud,
    plot_segmented_points,
)
from depthwarp.plots.depth import plot_depth_map, plot_depth_maps, plot_surf
from depthwarp.plots.frame import plot_frame
from depthwarp.plots.page import require_matplotlib
from depthwarp.plots.scanner import plot_setup

__all__ = [
    "plot_depth_map",
    "plot_depth_maps",
    "plot_frame",
    "plot_point_cloud",
    "plot_range_view",
    "plot_range_view_angles",
    "plot_rotated_cloud",
    "plot_segmented_points",
    "plot_setup",
    "plot_surf",
    "require_matplotlib",
]
