"""The whole calibration, from pictures of a board to a file's content and a verdict."""

from __future__ import annotations

import datetime
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError
from depthwarp.scanner.calibration.adjustment import Adjustment, adjust
from depthwarp.scanner.calibration.boards import Board, BoardNotFoundError, Image
from depthwarp.scanner.calibration.intrinsics import calibrate_lens, coverage
from depthwarp.scanner.calibration.laser_plane import LaserPlane, calibrate_laser_plane
from depthwarp.scanner.calibration.store import Residuals, ScannerCalibration
from depthwarp.scanner.calibration.turning_axis import calibrate_turning_axis
from depthwarp.scanner.calibration.verdict import Check, Verdict, judge
from depthwarp.scanner.calibration.views import BoardView, board_pose, keep_on_board, place_name
from depthwarp.scanner.frames import SourceInfo
from depthwarp.scanner.geometry import Lens

__all__ = [
    "BoardShot",
    "CalibrationReport",
    "LineFinder",
    "calibrate",
    "calibrate_views",
    "observe",
]

Float64Array = npt.NDArray[np.float64]

LineFinder = Callable[[Image, Image], tuple[Float64Array, Float64Array, Float64Array]]
"""From a frame with the laser on and one with it off to rows, columns and sigmas [px] of peaks."""


@dataclass(frozen=True, eq=False)
class BoardShot:
    """Pictures of the board at one motor angle.

    Attributes:
        image: Laser off, grey or BGR.
        lit_image: Laser on, the same view; None if the laser does not cross the board.
        angle_deg: Motor angle as reported [degrees].
        placement: Number of the place where the board stood; it stood still within one.
    """

    image: Image
    lit_image: Image | None = None
    angle_deg: float = 0.0
    placement: int = 0


@dataclass(frozen=True, eq=False)
class CalibrationReport:
    """What happened on the way.

    Attributes:
        verdict: Good, usable or bad, and what to do.
        adjustment: The joint adjustment with all its residuals.
        plane: The first, robust laser plane.
        skipped: One line for each shot that could not be used, with the reason.
    """

    verdict: Verdict
    adjustment: Adjustment
    plane: LaserPlane
    skipped: tuple[str, ...] = ()

    @property
    def text(self) -> str:
        """The report in words."""
        used = f"{len(self.adjustment.poses)} views used, {len(self.skipped)} left out"
        lines = [self.verdict.text, used, *self.skipped]
        return "\n".join(lines)


def calibrate(
    shots: Sequence[BoardShot],
    board: Board,
    camera: SourceInfo,
    find_line: LineFinder,
    *,
    max_range: float = 15.0,
    lens: Lens | None = None,
) -> tuple[ScannerCalibration, CalibrationReport]:
    """Calibrate a scanner from pictures of a board.

    Put the board up in several places, near and far, tilted, so that in the end it has filled the
    image; at each place turn the head through several angles, some with the laser on the board.

    Args:
        shots: The pictures.
        board: The board in them.
        camera: The camera that took them.
        find_line: Finds the laser line.
        max_range: Range limit of the scanner [m].
        lens: A lens that is known already and is held; calibrated when None.

    Raises:
        InputError: Pictures that do not determine the scanner; the message says what to add.
    """
    views, skipped = observe(shots, board, camera.size, find_line)
    calibration, report = calibrate_views(views, board, camera, max_range=max_range, lens=lens)
    return calibration, replace(report, skipped=skipped)


def observe(
    shots: Sequence[BoardShot], board: Board, size: tuple[int, int], find_line: LineFinder
) -> tuple[list[BoardView], tuple[str, ...]]:
    """Find board and laser line in all pictures.

    Args:
        shots: The pictures.
        board: The board in them.
        size: (width, height) that they must have [px].
        find_line: Finds the laser line.

    Returns:
        The views, and one line for each shot in which the board was not found.

    Raises:
        InputError: A picture of another size.
    """
    views, skipped = [], []
    for number, shot in enumerate(shots):
        for image in (shot.image, shot.lit_image):
            if image is not None and (image.shape[1], image.shape[0]) != size:
                raise InputError(
                    f"picture {number} has {image.shape[1]} x {image.shape[0]} px, the camera "
                    f"gives {size[0]} x {size[1]} px"
                )
        try:
            corners = board.detect(shot.image)
        except BoardNotFoundError as error:
            skipped.append(f"picture {number} at {shot.angle_deg:g} degrees: {error}")
            continue
        view = BoardView(corners, angle_deg=shot.angle_deg, placement=shot.placement)
        if shot.lit_image is not None:
            rows, columns, sigma = find_line(shot.lit_image, shot.image)
            peaks = keep_on_board(np.column_stack([columns, rows]), corners)
            typical = float(np.median(sigma)) if len(sigma) else view.laser_sigma_px
            view = replace(view, laser_pixels=peaks, laser_sigma_px=typical)
        views.append(view)
    return views, tuple(skipped)


def calibrate_views(
    views: Sequence[BoardView],
    board: Board,
    camera: SourceInfo,
    *,
    max_range: float = 15.0,
    lens: Lens | None = None,
) -> tuple[ScannerCalibration, CalibrationReport]:
    """Calibrate a scanner from corners and laser peaks; see `calibrate`."""
    corners = [view.corners for view in views]
    start = calibrate_lens(corners, camera.size).lens if lens is None else lens
    # Not the poses of the lens calibration: of a far board it may take the tilt to the wrong side.
    poses = np.stack([board_pose(view, start) for view in corners])
    plane = calibrate_laser_plane(views, start, poses)
    axis = calibrate_turning_axis(views, poses)
    views = _without_outliers(views, plane)
    adjusted = adjust(
        views, poses, start, plane, axis, max_range=max_range, lens_is_exact=lens is not None
    )
    covered = coverage(corners, camera.size, adjusted.poses)
    calibration = ScannerCalibration(
        geometry=adjusted.geometry,
        covariance=adjusted.covariance,
        camera_name=camera.name,
        camera_serial=camera.serial,
        date=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        board=board.text,
        residuals=Residuals(
            views=len(views),
            placements=len({view.placement for view in views}),
            laser_peaks=int(plane.inliers.sum()),
            corner_rms_px=adjusted.corner_rms_px,
            laser_rms_px=adjusted.laser_rms_px,
            laser_rms_m=adjusted.laser_rms_m,
            laser_nearest_m=plane.nearest_m,
            laser_farthest_m=plane.farthest_m,
            rim_covered=covered.rim,
            tilt_spread_deg=covered.tilt_spread_deg,
            turn_deg=_largest_turn(views),
        ),
    )
    verdict = Verdict((*judge(calibration).checks, _worst_view(views, adjusted)))
    return calibration, CalibrationReport(verdict, adjusted, plane)


def _worst_view(views: Sequence[BoardView], adjusted: Adjustment) -> Check:
    """One view that does not fit hardly shows in the residual of all: it is judged by itself."""
    worst = int(np.argmax(adjusted.view_rms_px))
    view = views[worst]
    return Check(
        f"residual of the worst view ({place_name(view.placement)}, head at "
        f"{view.angle_deg:g} degrees)",
        float(adjusted.view_rms_px[worst]),
        " px",
        0.6,
        2.0,
        "there the motor lost steps, the board was moved, or its corners are wrong: take that "
        "place again",
    )


def _without_outliers(views: Sequence[BoardView], plane: LaserPlane) -> list[BoardView]:
    """The views with those laser peaks that lie in the plane."""
    ends = np.cumsum([len(view.laser_pixels) for view in views])[:-1]
    masks = np.split(plane.inliers, ends)
    return [
        replace(view, laser_pixels=view.laser_pixels[mask])
        for view, mask in zip(views, masks, strict=True)
    ]


def _largest_turn(views: Sequence[BoardView]) -> float:
    angles: dict[int, list[float]] = {}
    for view in views:
        angles.setdefault(view.placement, []).append(view.angle_deg)
    return max(max(group) - min(group) for group in angles.values())
