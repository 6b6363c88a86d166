"""A scan from the command line: its equipment, its recording, and the turn itself."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import depthwarp
from depthwarp.checks import check_finite_vector
from depthwarp.cli.options import TWIN
from depthwarp.cli.report import Reporter
from depthwarp.cli.steering import ask_person, ended_by_signals, steered
from depthwarp.errors import InputError

if TYPE_CHECKING:
    from depthwarp.scanner.axis import Axis
    from depthwarp.scanner.calibration import ScannerCalibration
    from depthwarp.scanner.frames import FrameSource, SourceInfo
    from depthwarp.scanner.plan import ScanPlan
    from depthwarp.scanner.recording import Recording
    from depthwarp.scanner.scan import ScanControl

__all__ = ["Equipment", "ScanOrder", "choose_equipment", "take_turn"]


@dataclass(frozen=True)
class Equipment:
    """What a scan runs on, and the calibration that goes with it."""

    source: FrameSource
    axis: Axis
    calibration: ScannerCalibration


@dataclass(frozen=True)
class ScanOrder:
    """What is to be scanned.

    Attributes:
        folder: Of the recording.
        plan: Of a new scan; one that is continued has its own.
        position: Where the head stands in the world [m], of a new scan.
        resume: Whether the scan in the folder is continued.
        at_start: Whether the head stands where that scan began.

    Raises:
        InputError: Values that do not go together.
    """

    folder: Path
    plan: ScanPlan
    position: tuple[float, float, float]
    resume: bool
    at_start: bool

    def __post_init__(self) -> None:
        check_finite_vector("--position", self.position, 3)
        if self.at_start and not self.resume:
            raise InputError("--at-start is for a scan that is continued: give --resume with it")


def choose_equipment(
    stack: ExitStack,
    reporter: Reporter,
    axis: str,
    camera: str,
    calibration: Path | None,
    *,
    rotation: int,
    twin_scale: float,
) -> Equipment:
    """Make, but do not open, what the options name.

    Args:
        stack: Ends the twin.
        reporter: Shows what takes long; tells a person what to do.
        axis: As `--axis` has it.
        camera: As `--camera` has it.
        calibration: File; the twin knows its own.
        rotation: How far the camera is rolled clockwise [degrees].
        twin_scale: Size of the twin's sensor.

    Raises:
        InputError: Something that there is not, or that does not go together.
    """
    from depthwarp.scanner.axes import open_axis
    from depthwarp.scanner.calibration import load_calibration
    from depthwarp.scanner.sources import open_source
    from depthwarp.scanner.twin.session import TwinScanner

    if (axis == TWIN) != (camera == TWIN):
        raise InputError(
            "the twin's camera and axis belong together: give both --axis and --camera of a real "
            "scanner, or neither"
        )
    if axis == TWIN:
        with reporter.stage("twin", "building the twin and its room"):
            twin = stack.enter_context(TwinScanner(twin_scale))
        known = twin.calibration if calibration is None else load_calibration(calibration)
        return Equipment(twin.camera, twin.axis, known)
    if calibration is None:
        raise InputError("a real scanner needs --calibration FILE; depthwarp calibrate makes one")
    return Equipment(
        open_source(camera, rotation=rotation),
        open_axis(axis, ask=ask_person, tell=reporter.say),
        load_calibration(calibration),
    )


def take_turn(reporter: Reporter, equipment: Equipment, order: ScanOrder) -> Recording:
    """Take all stops, or those that are left; whatever happens, the axis is left safe.

    A new recording begins only when camera and axis are there.

    Raises:
        InputError: Camera, calibration or folder do not fit.
        ScanCancelledError: A person or a signal ended it.
        AxisError: See `run_scan`.
        FrameError: See `run_scan`.
    """
    from depthwarp.scanner.scan import ScanControl

    control = ScanControl()
    text = "cancelled; --resume continues the scan"
    with equipment.source as source:
        info = source.open()
        recording = _found(reporter, equipment, order.folder, info) if order.resume else None
        if recording is None:
            equipment.calibration.require_camera(info)
            _require_colour(info)
        with ended_by_signals(control, equipment.axis, text), equipment.axis as axis:
            if recording is None:
                recording = _begun(equipment, order, info)
            # A controller that kept its position is believed; one that restarted says so itself.
            if order.at_start or not recording.finished:
                axis.reference()
            _take_stops(reporter, equipment, recording, control)
    return recording


def _require_colour(info: SourceInfo) -> None:
    """Refuse a grey camera before the turn, not after it.

    Raises:
        InputError: The frames have no colours.
    """
    from depthwarp.scanner.frames import PixelFormat

    if info.pixel_format is PixelFormat.MONO:
        raise InputError(
            f"{info.name} {info.serial} gives grey frames, but the laser line is found by its "
            "colour: use a colour camera; for images of a Bayer mosaic say so in a file "
            'frames.json beside them, as {"pixel_format": "bayer_rggb"}'
        )


def _begun(equipment: Equipment, order: ScanOrder, info: SourceInfo) -> Recording:
    """A new recording with the calibration in it."""
    from depthwarp.scanner.recording import Recording

    settings = {
        "depthwarp": depthwarp.__version__,
        "calibration_hash": equipment.calibration.content_hash,
        "position": list(order.position),
    }
    recording = Recording.create(order.folder, order.plan, info, settings)
    equipment.calibration.save(order.folder / "calibration.json")
    return recording


def _found(reporter: Reporter, equipment: Equipment, folder: Path, info: SourceInfo) -> Recording:
    """The recording in the folder, if camera and calibration are the ones it was begun with."""
    from depthwarp.scanner.recording import Recording

    recording = Recording.open(folder)
    if info != recording.source:
        raise InputError(
            f"{folder} was begun with camera {recording.source.name} ({recording.source.serial}), "
            f"this is {info.name} ({info.serial}): use that one, in the same setting"
        )
    equipment.calibration.require_hash(recording.settings["calibration_hash"])
    reporter.say(
        f"continuing {folder}: {len(recording.finished)} of {len(recording.plan.angles)} stops "
        "are done; stops, exposures and gain are those that it was begun with"
    )
    return recording


def _take_stops(
    reporter: Reporter, equipment: Equipment, recording: Recording, control: ScanControl
) -> None:
    """Take the stops that are left; after a failure say how the scan goes on."""
    from depthwarp.scanner.axis import AxisAlarmError, AxisError, AxisRestartedError
    from depthwarp.scanner.frames import FrameError
    from depthwarp.scanner.scan import run_scan

    axis, total = equipment.axis, len(recording.plan.angles)
    try:
        with steered(reporter, control, axis, "scan", "scanning", total) as update:
            run_scan(
                recording,
                equipment.source,
                axis,
                control=control,
                progress=lambda progress: update(progress.done),
            )
    except (AxisError, FrameError) as error:
        lost = isinstance(error, AxisAlarmError | AxisRestartedError)
        how = (
            "turn the head to where the scan began; --resume --at-start then continues it"
            if lost
            else "--resume continues the scan"
        )
        reporter.say(f"{len(recording.finished)} of {total} stops are recorded: {how}")
        raise
