"""From a recording to a cloud: learn the laser's colour, find its line, triangulate every stop."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthwarp.cloud import PointCloud
from depthwarp.errors import FileFormatError, InputError
from depthwarp.scanner.calibration import ScannerCalibration
from depthwarp.scanner.laser import (
    ColorKind,
    ColorTable,
    LaserColorModel,
    LineFinder,
    LineStatus,
    NoLineError,
    fit_lit,
    fit_pairs,
)
from depthwarp.scanner.line_rows import line_rows
from depthwarp.scanner.recording import Recording
from depthwarp.scanner.triangulation import LaserPoints, triangulate

__all__ = ["ProcessingCounts", "ScanCloud", "fit_color_model", "process_recording"]

MODEL_STOPS = 4
"""Stops that the colour model is learned from, evenly spread over the scan."""

MODEL_TRIES = 4
"""How many such sets of stops are tried: the line may be out of view at the first ones."""


@dataclass(frozen=True)
class ProcessingCounts:
    """What became of the stops and of the line's rows.

    Attributes:
        stops: Finished stops of the recording.
        stops_without_line: Of those, stops whose frames show no line.
        stops_with_two_lines: Of those, stops in which many rows hold a second line; each row took
            the higher peak, which need not be the laser's own.
        rows: Rows of all stops.
        rows_found: Rows in which the line was found.
        outside_lens: Of those, where the lens has no ray.
        behind: The ray meets the laser plane nowhere ahead.
        too_far: Beyond the scanner's range.
        points: Points of the cloud.
    """

    stops: int
    stops_without_line: int
    stops_with_two_lines: int
    rows: int
    rows_found: int
    outside_lens: int
    behind: int
    too_far: int
    points: int


@dataclass(frozen=True)
class ScanCloud:
    """The cloud of a scan, and what became of everything else.

    Attributes:
        cloud: World frame, with `sigma` [m], `range` [m], `row` [px], `angle` [degrees],
            `intensity` [grey levels of 255] and `frame`, the number of the stop.
        counts: What became of the stops and rows.
    """

    cloud: PointCloud
    counts: ProcessingCounts


def fit_color_model(recording: Recording) -> LaserColorModel:
    """Learn the laser's colour from some of a recording's own stops; nobody marks anything.

    Raises:
        InputError: No stop is finished, or no line is seen in the frames.
    """
    finished = sorted(recording.finished)
    if not finished:
        raise InputError(f"{recording.folder} holds no finished stop: there is nothing to process")
    count, parts = len(finished), MODEL_STOPS * MODEL_TRIES
    sets = [
        tuple(dict.fromkeys(finished[k * count // parts] for k in range(first, parts, MODEL_TRIES)))
        for first in range(MODEL_TRIES)
    ]
    refusals = []
    for chosen in dict.fromkeys(sets):
        try:
            return _fit_stops(recording, chosen)
        except FileFormatError:
            raise
        except InputError as error:
            refusals.append(error)
    looked_at = ", ".join(str(number) for number in sorted({n for chosen in sets for n in chosen}))
    raise InputError(f"{recording.folder}, stops {looked_at}: {refusals[0]}") from refusals[0]


def _fit_stops(recording: Recording, numbers: Sequence[int]) -> LaserColorModel:
    """The colour model from the longest exposure of some stops."""
    steps = [recording.step(number) for number in numbers]
    longest = int(np.argmax(recording.plan.exposures_us))
    frames = [step.exposures[longest] for step in steps]
    pairs = [(on, without) for on, without in frames if without is not None]
    if pairs:
        return fit_pairs(pairs)
    return fit_lit([on for on, _ in frames], "green")


def process_recording(
    recording: Recording,
    calibration: ScannerCalibration,
    model: LaserColorModel | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> ScanCloud:
    """Turn a recording into a cloud; the same recording gives the same cloud, byte for byte.

    Args:
        recording: Finished or not: its finished stops are processed.
        calibration: The calibration that the scan was made with.
        model: The laser's colour; None learns it from the recording.
        progress: Called with (done, total) after every stop.

    Raises:
        InputError: The calibration belongs to another camera or another scan, or no stop is
            finished.
        FileFormatError: A frame of the recording is damaged.
        NoLineError: Not one stop shows a laser line.
    """
    calibration.require_camera(recording.source)
    wanted = recording.settings.get("calibration_hash")
    if wanted is not None:
        calibration.require_hash(wanted)
    model = model or fit_color_model(recording)
    found: list[LaserPoints] = []
    intensities: list[npt.NDArray[np.float64]] = []
    numbers: list[int] = []
    finder: LineFinder | None = None
    statuses: list[LineStatus] = []
    rows_found = 0
    total = len(recording.finished)
    for done, step in enumerate(recording.steps(), start=1):
        if finder is None:
            first, _ = step.exposures[0]
            source = recording.source
            finder = LineFinder(ColorTable(model), source.size, source.pixel_format, first.bits)
        line = line_rows(finder, step, is_paired=model.kind is ColorKind.DIFFERENCE)
        rows_found += len(line.rows)
        statuses.append(line.status)
        points = triangulate(
            calibration.geometry,
            line.rows,
            line.columns,
            line.sigma_px,
            step.reported,
            calibration.covariance,
        )
        found.append(points)
        intensities.append(line.peak[points.index])
        numbers.append(step.number)
        if progress is not None:
            progress(done, total)
    if rows_found == 0:
        raise NoLineError(
            f"{recording.folder}: not one of {total} stops shows a laser line; check that the "
            "laser was on, and the exposure"
        )
    position = recording.settings.get("position", (0.0, 0.0, 0.0))
    cloud = _cloud(found, np.asarray(position, np.float64), intensities, numbers)
    counts = ProcessingCounts(
        stops=total,
        stops_without_line=statuses.count(LineStatus.NO_LINE),
        stops_with_two_lines=statuses.count(LineStatus.TWO_LINES),
        rows=total * recording.source.size[1],
        rows_found=rows_found,
        outside_lens=sum(points.counts.outside_lens for points in found),
        behind=sum(points.counts.behind for points in found),
        too_far=sum(points.counts.too_far for points in found),
        points=len(cloud),
    )
    return ScanCloud(cloud, counts)


def _cloud(
    found: Sequence[LaserPoints],
    position: npt.NDArray[np.float64],
    intensities: Sequence[npt.NDArray[np.float64]],
    numbers: Sequence[int],
) -> PointCloud:
    clouds = [points.to_cloud() for points in found]
    attributes = {
        name: np.concatenate([cloud.attributes[name] for cloud in clouds])
        for name in clouds[0].attributes
    }
    attributes["intensity"] = np.concatenate(intensities).astype(np.float32)
    attributes["frame"] = np.repeat(np.array(numbers, np.int32), [len(cloud) for cloud in clouds])
    points_world = np.concatenate([points.points_world for points in found]) + position
    return PointCloud(points_world.astype(np.float32), attributes)
