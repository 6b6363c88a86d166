"""From recordings of a board to a calibration: corners and line of every stop, then the fit.

The frame without the laser of the longest exposure shows the board. The line is wanted at shorter
ones as well, where it is not saturated: each row takes the exposure that places the line best.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError
from depthwarp.scanner.calibration.boards import (
    Board,
    BoardCorners,
    BoardNotFoundError,
    Image,
)
from depthwarp.scanner.calibration.capture import require_one_camera
from depthwarp.scanner.calibration.procedure import CalibrationReport, calibrate_views
from depthwarp.scanner.calibration.saddles import grey_levels
from depthwarp.scanner.calibration.store import ScannerCalibration
from depthwarp.scanner.calibration.views import BoardView, keep_on_board, place_name
from depthwarp.scanner.frames import Frame, PixelFormat
from depthwarp.scanner.laser import (
    ColorTable,
    LaserColorModel,
    LineFinder,
    fit_pairs,
)
from depthwarp.scanner.line_rows import LineRows, line_rows
from depthwarp.scanner.recording import Recording, Step

__all__ = ["board_views", "calibrate_recordings", "fit_board_color", "picture"]

Float64Array = npt.NDArray[np.float64]

MODEL_STOPS = 3
"""Stops that the laser's colour is learned from, spread over the placements."""

DEMOSAIC = {
    PixelFormat.BAYER_RGGB: cv2.COLOR_BayerRGGB2BGR,
    PixelFormat.BAYER_GRBG: cv2.COLOR_BayerGRBG2BGR,
    PixelFormat.BAYER_GBRG: cv2.COLOR_BayerGBRG2BGR,
    PixelFormat.BAYER_BGGR: cv2.COLOR_BayerBGGR2BGR,
}

EDGE_CONTRAST = 0.2
"""A peak that has more than this share of the board's contrast beside it lies on a print's edge."""

EDGE_WIDTHS = 0.75
"""How far beside a peak the board must be plain, in widths of the line at half height."""

SIGMA_SPAN = 3.0
"""Peaks with more than this many times the sigma of the better ones lie on ink and are left out."""


def calibrate_recordings(
    recordings: Mapping[int, Recording],
    board: Board,
    *,
    max_range: float = 15.0,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[ScannerCalibration, CalibrationReport]:
    """Calibrate a scanner from recordings of a board.

    Args:
        recordings: By number of the placement; unfinished ones give the stops that they have.
        board: The board in them.
        max_range: Range limit of the scanner [m].
        progress: Called with (done, total) after every stop.

    Raises:
        InputError: Recordings of different cameras, without off frames, or that do not determine
            the scanner; the message says what to add.
        FileFormatError: A frame is damaged.
    """
    camera = require_one_camera(recordings)
    views, skipped = board_views(recordings, board, progress=progress)
    calibration, report = calibrate_views(views, board, camera, max_range=max_range)
    return calibration, replace(report, skipped=skipped)


def board_views(
    recordings: Mapping[int, Recording],
    board: Board,
    model: LaserColorModel | None = None,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[list[BoardView], tuple[str, ...]]:
    """Find board and laser line in every stop; see `calibrate_recordings`.

    Args:
        recordings: By number of the placement.
        board: The board in them.
        model: The laser's colour; None learns it from the recordings.
        progress: Called with (done, total) after every stop.

    Returns:
        The views, and one line for each stop in which the board was not found.
    """
    model = model or fit_board_color(recordings)
    finder: LineFinder | None = None
    views: list[BoardView] = []
    skipped: list[str] = []
    total = sum(len(recording.finished) for recording in recordings.values())
    stops = ((number, step) for number, each in recordings.items() for step in each.steps())
    for done, (number, step) in enumerate(stops, start=1):
        if finder is None:
            first = _board_frame(step)
            size = require_one_camera(recordings).size
            finder = LineFinder(ColorTable(model), size, first.pixel_format, first.bits)
        image = picture(_board_frame(step))
        try:
            corners = board.detect(image)
        except BoardNotFoundError:
            skipped.append(
                f"{place_name(number)}, head at {step.reported:g} degrees: the board is not in "
                "view whole, or not sharp, bright and large enough"
            )
        else:
            line = line_rows(finder, step, is_paired=True)
            views.append(_view(corners, line, image, step.reported, number))
        if progress is not None:
            progress(done, total)
    return views, tuple(skipped)


def picture(frame: Frame) -> Image:
    """A frame as an image for people and corner finders: grey or BGR."""
    if not frame.pixel_format.is_bayer:
        return frame.pixels
    image: Image = cv2.cvtColor(frame.pixels, DEMOSAIC[frame.pixel_format])  # type: ignore[assignment]
    return image


def fit_board_color(recordings: Mapping[int, Recording]) -> LaserColorModel:
    """Learn the laser's colour from the differences of a few stops' own frames.

    Raises:
        InputError: No stop is finished, none has off frames, or no line is seen.
    """
    stops = [
        (recording, number)
        for recording in recordings.values()
        for number in sorted(recording.finished)
    ]
    if not stops:
        raise InputError(
            "no stop at any place of the board is finished: there is nothing to calibrate from"
        )
    chosen = dict.fromkeys(k * len(stops) // MODEL_STOPS for k in range(MODEL_STOPS))
    steps = [stops[k][0].step(stops[k][1]) for k in chosen]
    pairs = [(on, off) for step in steps for on, off in step.exposures if off is not None]
    if not pairs:
        raise InputError(
            "there are no frames with the laser off: record the board's pictures with some"
        )
    return fit_pairs(pairs)


def _board_frame(step: Step) -> Frame:
    """The frame without the laser that shows the board best: the longest exposure."""
    off = [without for _, without in step.exposures if without is not None]
    if not off:
        raise InputError(
            f"stop {step.number} has no frame with the laser off, in which the board could be "
            "seen: record the board's pictures with off frames"
        )
    return max(off, key=lambda frame: frame.exposure_us)


def _view(
    corners: BoardCorners,
    line: LineRows,
    image: Image,
    angle_deg: float,
    placement: int,
) -> BoardView:
    """A view with those peaks that lie on the board's paper, clear of the print's edges."""
    view = BoardView(corners, angle_deg=angle_deg, placement=placement)
    pixels = np.column_stack([line.columns, line.rows])
    on_board = keep_on_board(pixels, corners)
    kept = np.isin(line.rows, on_board[:, 1])  # a row holds one peak
    kept[kept] = _is_plain(image, pixels[kept], line.width_px[kept], corners)
    if not kept.any():
        return view
    sigma = line.sigma_px[kept]
    good = sigma <= SIGMA_SPAN * np.quantile(sigma, 0.25)
    return replace(
        view,
        laser_pixels=pixels[kept][good],
        laser_sigma_px=max(float(np.median(sigma[good])), 1e-3),
    )


def _is_plain(
    image: Image,
    pixels: Float64Array,
    width_px: Float64Array,
    corners: BoardCorners,
) -> npt.NDArray[np.bool_]:
    """Which peaks, shape (N, 2), have the same paper or ink on both sides.

    On an edge of the print one flank of the line is darker, which draws its middle aside.
    """
    if not len(pixels):
        return np.zeros(0, bool)
    grey = grey_levels(image)
    u, v, wide, high = cv2.boundingRect(corners.pixels.astype(np.float32))
    part = grey[max(v, 0) : v + high, max(u, 0) : u + wide]
    contrast = float(np.ptp(np.quantile(part, (0.05, 0.95))))
    reach = max(2, math.ceil(EDGE_WIDTHS * float(np.median(width_px))))
    window = np.ones((3, 2 * reach + 1), np.uint8)
    span = cv2.dilate(grey, window) - cv2.erode(grey, window)
    column, row = np.rint(pixels).astype(int).T
    return np.asarray(span[row, column] <= EDGE_CONTRAST * contrast)
