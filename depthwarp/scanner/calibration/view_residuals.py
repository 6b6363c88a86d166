"""What a board view says against a geometry: its corners in the image, its peaks off the plane."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from depthwarp.scanner.calibration.laser_plane import LaserPlane
from depthwarp.scanner.calibration.views import BoardView, on_board, rays_on_board
from depthwarp.scanner.geometry import Lens
from depthwarp.scanner.lens import undistort

__all__ = ["ViewPeaks", "corner_error", "shared_corner_errors"]

Float64Array = npt.NDArray[np.float64]

MAX_PEAKS = 200
"""Peaks used of each view, evenly spread: the errors of neighbouring rows are not independent."""

SHARED_CORNER_PX = 0.01
"""Error that the corners of a view have in common: one standard deviation of a shift, and of the
root mean square of each linear stretch or shear, in u and in v alike. Measured on the boards of
the twin; noise averages out over a view's corners and would promise less."""


class ViewPeaks:
    """The laser peaks of a view; their rays are computed anew only when the lens has moved."""

    def __init__(self, pixels: Float64Array, sigma_px: float, metres_a_pixel: Float64Array) -> None:
        self.pixels, self.sigma_px, self.metres_a_pixel = pixels, sigma_px, metres_a_pixel
        self._lens: Lens | None = None
        self._rays = pixels

    @classmethod
    def of(cls, view: BoardView, lens: Lens, plane: LaserPlane, pose: Float64Array) -> ViewPeaks:
        """A view's peaks, with how far each leaves the plane when it moves by one column [m]."""
        count = len(view.laser_pixels)
        spread = np.unique(np.linspace(0, count - 1, min(count, MAX_PEAKS)).astype(int))
        pixels = view.laser_pixels[spread]
        half = np.array([0.5, 0.0])
        moved = on_board(lens, pose, pixels + half) - on_board(lens, pose, pixels - half)
        return cls(pixels, view.laser_sigma_px, np.abs(moved @ plane.normal))

    def error_m(
        self, lens: Lens, pose: Float64Array, plane: tuple[Float64Array, float]
    ) -> Float64Array:
        """Distance of the laser points on the board from the plane [m]."""
        if lens != self._lens:
            self._lens, self._rays = lens, undistort(lens, self.pixels)
        normal, distance = plane
        return rays_on_board(self._rays, pose) @ normal - distance


def corner_error(lens: Lens, pose: Float64Array, view: BoardView) -> Float64Array:
    """Seen less computed corners [px], u and v in turn."""
    turn, _ = cv2.Rodrigues(pose[:3, :3])
    points = view.corners.points_board
    computed, _ = cv2.projectPoints(points, turn, pose[:3, 3], lens.K, np.array(lens.distortion))
    return np.ravel(np.asarray(computed, np.float64)[:, 0] - view.corners.pixels)


def shared_corner_errors(view: BoardView) -> Float64Array:
    """Errors that a view's corners have in common, one a column [px], shape (2 N, 6)."""
    pixels = view.corners.pixels
    offset = pixels - pixels.mean(axis=0)
    offset /= np.sqrt(np.mean(offset**2, axis=0))
    shapes = np.column_stack([np.ones(len(pixels)), offset])
    return np.asarray(SHARED_CORNER_PX * np.kron(shapes, np.eye(2)), np.float64)
