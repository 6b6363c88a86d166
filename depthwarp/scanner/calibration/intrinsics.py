"""The lens from views of a board: OpenCV's calibration, its sigmas, and what the views covered."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError
from depthwarp.scanner.calibration.boards import BoardCorners
from depthwarp.scanner.calibration.views import pose_matrix
from depthwarp.scanner.geometry import Lens

__all__ = ["Coverage", "LensCalibration", "calibrate_lens", "coverage"]

Float64Array = npt.NDArray[np.float64]

MIN_VIEWS = 4
MIN_TILT_SPREAD_DEG = 10.0
"""Boards that are nearer to parallel than this leave the focal length undetermined."""

LARGE_RMS_PX = 1.0
"""Corners that scatter more than this have not been fitted: found ones scatter by 0.1 px."""

CELLS = 5
"""The frame is divided into this many cells a side to see where the corners lie."""


@dataclass(frozen=True)
class Coverage:
    """How well the views cover what the lens does.

    Attributes:
        filled: Share of the frame's 5 x 5 cells that hold a corner.
        rim: Share of the outer cells that hold a corner: there the distortion is measured.
        tilt_spread_deg: Largest angle between two boards' normals [degrees].
        distance_ratio: Farthest over nearest board.
    """

    filled: float
    rim: float
    tilt_spread_deg: float
    distance_ratio: float


@dataclass(frozen=True, eq=False)
class LensCalibration:
    """A lens and how well it is known.

    Attributes:
        lens: The lens; k3 is 0 where the views do not show it.
        sigmas: Standard deviations of fx, fy, cx, cy [px], k1, k2, p1, p2, k3, shape (9,).
        rms_px: Root mean square distance of the corners from where the lens puts them [px].
        view_rms_px: The same for each view, shape (V,).
        poses: `optical_from_board` of each view [m], shape (V, 4, 4).
        coverage: What the views covered.
    """

    lens: Lens
    sigmas: Float64Array
    rms_px: float
    view_rms_px: Float64Array
    poses: Float64Array
    coverage: Coverage


def calibrate_lens(views: Sequence[BoardCorners], size: tuple[int, int]) -> LensCalibration:
    """Calibrate the lens from at least four views of a board at different tilts.

    The sixth-order term k3 is kept only where it is three times its own sigma: a term that the
    views do not show would bend the lens where no corner was.

    Args:
        views: The corners of each view.
        size: (width, height) of the frames [px].

    Raises:
        InputError: Too few views, boards that are all parallel, corners outside the frame, or
            views that fit no lens. The message says what to add.
    """
    _check(views, size)
    fit = _fit(views, size, flags=0)
    if abs(fit.lens.distortion[4]) < 3 * fit.sigmas[8]:
        fit = _fit(views, size, flags=cv2.CALIB_FIX_K3)
    if fit.coverage.tilt_spread_deg < MIN_TILT_SPREAD_DEG:
        raise InputError(
            f"all {len(views)} boards are parallel within {fit.coverage.tilt_spread_deg:.1f} "
            "degrees, which leaves the focal length open: tilt the board by 20 to 40 degrees to "
            "the left, right, top and bottom"
        )
    return fit


def _fit(views: Sequence[BoardCorners], size: tuple[int, int], flags: int) -> LensCalibration:
    """The better fit of two starts, the second tried where the first leads nowhere.

    OpenCV starts from the perspective of the boards; a few small ones that face the camera have
    next to none, and may lead it to a lens that fits no view. A usual focal length does not.
    """
    fits: list[LensCalibration] = []
    refusal: InputError | None = None
    for start in (None, _usual_camera(size)):
        try:
            fits.append(_opencv(views, size, flags, start))
        except InputError as error:
            refusal = refusal or error
        if fits and fits[-1].rms_px <= LARGE_RMS_PX:
            break
    if not fits and refusal is not None:
        raise refusal
    return min(fits, key=lambda fit: fit.rms_px)


def _usual_camera(size: tuple[int, int]) -> Float64Array:
    """Camera matrix of a lens that sees 60 degrees along the longer side."""
    focal, (width, height) = max(size) / 2 / math.tan(math.radians(30)), size
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1]])


def _opencv(
    views: Sequence[BoardCorners], size: tuple[int, int], flags: int, start: Float64Array | None
) -> LensCalibration:
    """OpenCV's fit, from a camera matrix and no distortion, or from its own first guess."""
    if start is not None:
        flags |= cv2.CALIB_USE_INTRINSIC_GUESS
    guess = np.eye(3) if start is None else start
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-12)
    points = [view.points_board.astype(np.float32) for view in views]
    pixels = [view.pixels.astype(np.float32) for view in views]
    try:
        rms, K, distortion, turns, shifts, sigmas, _, view_rms = cv2.calibrateCameraExtended(
            points, pixels, size, guess, np.zeros(5), flags=flags, criteria=criteria
        )
    except cv2.error as error:
        raise InputError(
            f"the {len(views)} board views fit no lens ({error.err}): are all of them of the same "
            "board, with its true numbers of corners?"
        ) from error
    (fx, _, cx), (_, fy, cy), _ = np.asarray(K, np.float64).tolist()
    k1, k2, p1, p2, k3 = np.ravel(distortion)[:5].tolist()
    poses = np.stack([pose_matrix(*pose) for pose in zip(turns, shifts, strict=True)])
    if not np.isfinite(rms) or (poses[:, 2, 3] <= 0).any():
        raise InputError("the board views fit no lens: a board would stand behind the camera")
    return LensCalibration(
        lens=Lens(fx, fy, cx, cy, size, (k1, k2, p1, p2, k3)),
        sigmas=np.ravel(sigmas)[:9].astype(np.float64),
        rms_px=float(rms),
        view_rms_px=np.ravel(view_rms).astype(np.float64),
        poses=poses,
        coverage=coverage(views, size, poses),
    )


def _check(views: Sequence[BoardCorners], size: tuple[int, int]) -> None:
    if len(views) < MIN_VIEWS:
        raise InputError(
            f"{len(views)} views of the board are too few for a lens, at least {MIN_VIEWS} are "
            "needed and 15 are good: tilt the board and move it through the whole image"
        )
    for number, view in enumerate(views):
        low, high = view.pixels.min(axis=0), view.pixels.max(axis=0)
        if (low < -0.5).any() or (high > np.array(size) - 0.5).any():
            raise InputError(
                f"view {number} has corners from {low.round(1)} to {high.round(1)}, outside the "
                f"frame of {size[0]} x {size[1]} px: it is from another camera or size"
            )


def coverage(views: Sequence[BoardCorners], size: tuple[int, int], poses: Float64Array) -> Coverage:
    """What views of a board covered.

    Args:
        views: The corners of each view.
        size: (width, height) of the frames [px].
        poses: `optical_from_board` of each view [m], shape (V, 4, 4).
    """
    pixels = np.concatenate([view.pixels for view in views])
    cell = np.clip(((pixels + 0.5) / size * CELLS).astype(int), 0, CELLS - 1)
    filled = np.zeros((CELLS, CELLS), bool)
    filled[cell[:, 1], cell[:, 0]] = True
    rim = np.ones_like(filled)
    rim[1:-1, 1:-1] = False
    normals, distances = poses[:, :3, 2], np.linalg.norm(poses[:, :3, 3], axis=1)
    cosine = np.clip((normals @ normals.T).min(), -1, 1)
    return Coverage(
        filled=float(filled.mean()),
        rim=float(filled[rim].mean()),
        tilt_spread_deg=float(np.degrees(np.arccos(cosine))),
        distance_ratio=float(distances.max() / distances.min()),
    )
