"""The points of a recorded wall, which a calibration is verified with."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from depthwarp.errors import InputError
from depthwarp.scanner.calibration.store import ScannerCalibration
from depthwarp.scanner.laser import ColorKind, ColorTable, LineFinder
from depthwarp.scanner.line_rows import line_rows
from depthwarp.scanner.processing import fit_color_model
from depthwarp.scanner.recording import Recording
from depthwarp.scanner.triangulation import LaserPoints, triangulate

__all__ = ["wall_points"]


def wall_points(
    recording: Recording,
    calibration: ScannerCalibration,
    *,
    progress: Callable[[int, int], None] | None = None,
) -> LaserPoints:
    """Triangulate a recorded scan with any calibration of its camera.

    The sigma of the points is that of the line alone, as `verify` wants it.

    Args:
        recording: The scan of a wall.
        calibration: Not necessarily the one that the scan was made with.
        progress: Called with (done, total) after every stop.

    Raises:
        InputError: The calibration belongs to another camera, or no line is seen.
        FileFormatError: A frame is damaged.
    """
    calibration.require_camera(recording.source)
    model = fit_color_model(recording)
    total = len(recording.finished)
    finder: LineFinder | None = None
    lines, angles = [], []
    for done, step in enumerate(recording.steps(), start=1):
        if finder is None:
            frame, _ = step.exposures[0]
            size = recording.source.size
            finder = LineFinder(ColorTable(model), size, frame.pixel_format, frame.bits)
        line = line_rows(finder, step, is_paired=model.kind is ColorKind.DIFFERENCE)
        lines.append(line)
        angles.append(np.full(len(line.rows), step.reported))
        if progress is not None:
            progress(done, total)
    rows, columns, sigma = (
        np.concatenate([getattr(line, name) for line in lines])
        for name in ("rows", "columns", "sigma_px")
    )
    if not len(rows):
        raise InputError(f"{recording.folder}: no stop shows the laser line")
    return triangulate(calibration.geometry, rows, columns, sigma, np.concatenate(angles))
