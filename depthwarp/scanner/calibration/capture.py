"""Pictures for a calibration on disk: one recording for each place where the board stood."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from depthwarp.errors import InputError
from depthwarp.scanner.axis import Axis
from depthwarp.scanner.calibration.views import place_name
from depthwarp.scanner.frames import FrameSource, SourceInfo
from depthwarp.scanner.plan import ScanPlan
from depthwarp.scanner.recording import Recording
from depthwarp.scanner.scan import ScanControl, run_scan

__all__ = [
    "DEFAULT_STOPS",
    "placement_folder",
    "recorded_placements",
    "require_one_camera",
    "take_placement",
    "where_to_put",
]

DEFAULT_STOPS = (-30.0, -15.0, -6.0, -2.0, 2.0, 6.0, 15.0, 30.0)
"""Stops of the head [degrees]: close ones for the laser on the board, wide ones for the axis."""

ADVICE = (
    "about 1.3 m away, facing the head",
    "about 1.6 m away at the top of the image, leaning towards the head",
    "about 1.6 m away at the bottom of the image, leaning back",
    "4 m away or more, facing the head",
    "about 2 m away, turned 35 degrees to the left",
    "about 2 m away, turned 35 degrees to the right",
    "about 3 m away at the top of the line, leaning towards the head",
    "about 3 m away at the bottom of the line, leaning back",
    "about 1.8 m away, upright, leaning back 30 degrees",
    "5 m away or more, facing the head",
)


def where_to_put(number: int) -> str:
    """Words for a person: where the board goes; near and far, high and low, tilted each way."""
    return (
        f"put the board up {ADVICE[number % len(ADVICE)]}, so that the laser line crosses its "
        "middle while the head stands at 0 degrees."
    )


def placement_folder(folder: Path, number: int) -> Path:
    """Where the recording of a placement of the board lies."""
    return folder / f"placement_{number:02d}"


def recorded_placements(folder: Path) -> dict[int, Recording]:
    """The placements that were recorded, by number; one that was never begun is passed over.

    Raises:
        FileFormatError: A recording is damaged.
    """
    numbers = sorted(
        int(match[1])
        for path in folder.glob("placement_*/scan.json")
        if (match := re.fullmatch(r"placement_(\d{2,})", path.parent.name))
    )
    return {number: Recording.open(placement_folder(folder, number)) for number in numbers}


def take_placement(
    folder: Path,
    number: int,
    plan: ScanPlan,
    source: FrameSource,
    info: SourceInfo,
    axis: Axis,
    *,
    settings: Mapping[str, Any],
    control: ScanControl | None = None,
    progress: Callable[[int], None] | None = None,
) -> Recording:
    """Record a placement: the head turns while the board stands still.

    What an earlier run left unfinished is taken anew: nobody knows whether the board has been
    moved since.

    Args:
        folder: Holds all placements.
        number: Of the placement.
        plan: The head's stops, and the exposures: the longest one shows the board, see
            `depthwarp.scanner.calibration.recorded`.
        source: The camera, open.
        info: What it said when it was opened.
        axis: The motor, connected and referenced.
        settings: JSON values to keep.
        control: Pause and cancel.
        progress: Called with the finished stops.

    Raises:
        InputError: The placement is recorded already, or the disk refuses.
        FrameError: See `run_scan`.
        AxisError: See `run_scan`.
    """
    place = placement_folder(folder, number)
    before = recorded_placements(folder).get(number)
    if before is not None:
        if not before.remaining:
            raise InputError(f"{place} is recorded already: remove it to take it again")
        shutil.rmtree(place)
    recording = Recording.create(place, plan, info, settings)
    run_scan(
        recording,
        source,
        axis,
        control=control,
        progress=None if progress is None else lambda report: progress(report.done),
    )
    return recording


def require_one_camera(recordings: Mapping[int, Recording]) -> SourceInfo:
    """The camera that took all placements.

    Raises:
        InputError: There is no placement, or two were taken with different cameras or settings.
    """
    if not recordings:
        raise InputError(
            "no pictures of a board are recorded: give --axis and --camera to take some"
        )
    (first, camera), *others = ((n, recording.source) for n, recording in recordings.items())
    for number, other in others:
        if other != camera:
            raise InputError(
                f"{place_name(number)} was seen by {other.name} {other.serial} with frames of "
                f"{other.size[0]} x {other.size[1]} px, {place_name(first)} by {camera.name} "
                f"{camera.serial} with {camera.size[0]} x {camera.size[1]} px: a calibration "
                "belongs to one camera; remove the folders of the other, such as "
                f"{recordings[number].folder}"
            )
    return camera
