"""`depthwarp scan`: turn the head, take the frames, record them, and make the cloud."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import depthwarp
from depthwarp.cli.guard import run_command
from depthwarp.cli.options import JsonOption
from depthwarp.cli.report import Reporter, quiet_warp
from depthwarp.errors import InputError

if TYPE_CHECKING:
    from depthwarp.scanner.axis import Axis
    from depthwarp.scanner.calibration import ScannerCalibration
    from depthwarp.scanner.frames import FrameSource
    from depthwarp.scanner.plan import ScanPlan
    from depthwarp.scanner.recording import Recording
    from depthwarp.scanner.scan import ScanControl

__all__ = ["ask_person", "cancel_on_signals", "report_cloud", "scan"]

TWIN = "twin"


@dataclass(frozen=True)
class Equipment:
    """What a scan runs on, and the calibration that goes with it."""

    source: FrameSource
    axis: Axis
    calibration: ScannerCalibration


def scan(
    out: Annotated[Path, typer.Option("-o", "--output", help="Folder of the recording.")],
    axis: Annotated[
        str,
        typer.Option(
            metavar="AXIS",
            help="grbl:PORT, horus:PORT, manual or twin; PORT may be serial:USB-SERIAL-NUMBER.",
        ),
    ] = TWIN,
    camera: Annotated[
        str,
        typer.Option(
            metavar="CAMERA", help="basler, basler:SERIAL, opencv:N, folder:PATH or twin."
        ),
    ] = TWIN,
    calibration: Annotated[
        Path | None, typer.Option(help="Calibration file; the twin knows its own.")
    ] = None,
    stops: Annotated[int, typer.Option(help="Stops of the turn.")] = 400,
    degrees: Annotated[float, typer.Option(help="Angle that the turn covers [degrees].")] = 360.0,
    exposure: Annotated[
        list[float] | None,
        typer.Option(help="Exposure [us]; repeat it for a bracket. 2000 unless given."),
    ] = None,
    gain: Annotated[float, typer.Option(help="Gain [dB].")] = 0.0,
    settle: Annotated[float, typer.Option(help="Standstill before a frame [s].")] = 0.05,
    off_frame: Annotated[
        bool, typer.Option(help="Take a frame without the laser at each stop.")
    ] = True,
    rotation: Annotated[
        int, typer.Option(help="How far the camera is rolled clockwise [degrees].")
    ] = 0,
    position: Annotated[
        tuple[float, float, float],
        typer.Option(metavar="X Y Z", help="Where the head stands in the world [m]."),
    ] = (0.0, 0.0, 0.0),
    twin_scale: Annotated[
        float, typer.Option(help="Size of the twin's sensor; 1 is 1942 x 2590 px.")
    ] = 0.25,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue the scan in the folder, by its own plan.")
    ] = False,
    at_start: Annotated[
        bool,
        typer.Option(
            "--at-start",
            help="With --resume: the head stands where the scan began (after a power cut).",
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Scan one turn of the head into a recording and a cloud.

    Without hardware, the twin scans a simulated room. Ctrl-C stops the motor, switches the laser
    off, and leaves a recording that --resume continues.
    """
    reporter = Reporter(as_json)

    def command() -> None:
        quiet_warp()
        from depthwarp.scanner.plan import ScanPlan

        plan = ScanPlan.turn(
            stops,
            degrees,
            exposures_us=tuple(exposure or (2000.0,)),
            gain_db=gain,
            settle_s=0.0 if axis == TWIN else settle,
            with_off_frame=off_frame,
        )
        with ExitStack() as stack:
            equipment = _equipment(stack, reporter, axis, camera, calibration, rotation, twin_scale)
            recording = (
                _continue(stack, reporter, equipment, out)
                if resume
                else _begin(stack, equipment, plan, out, position)
            )
            # A controller that kept its position is believed; one that restarted says so itself.
            _take(reporter, equipment, recording, reference=not resume or at_start)
        _finish(reporter, recording, equipment.calibration, out)

    run_command(reporter, command)


def _equipment(
    stack: ExitStack,
    reporter: Reporter,
    axis: str,
    camera: str,
    calibration: Path | None,
    rotation: int,
    twin_scale: float,
) -> Equipment:
    from depthwarp.scanner.axes import open_axis
    from depthwarp.scanner.calibration import load_calibration
    from depthwarp.scanner.sources import open_source
    from depthwarp.scanner.twin.session import TwinScanner

    if (axis == TWIN) != (camera == TWIN):
        raise InputError("the twin's camera and axis belong together: give both, or neither")
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


def ask_person(question: str) -> float | None:
    """Ask the person at the terminal for a number, until it is one; an empty answer is None."""
    while True:
        answer: str = typer.prompt(question, default="", show_default=False, err=True)
        if not answer.strip():
            return None
        try:
            return float(answer)
        except ValueError:
            typer.echo(f"{answer!r} is not a number: type one, or just Enter", err=True)


def _begin(
    stack: ExitStack,
    equipment: Equipment,
    plan: ScanPlan,
    out: Path,
    position: tuple[float, float, float],
) -> Recording:
    """A new recording with the calibration in it."""
    from depthwarp.scanner.recording import Recording

    info = stack.enter_context(equipment.source).open()
    equipment.calibration.require_camera(info)
    settings = {
        "depthwarp": depthwarp.__version__,
        "calibration_hash": equipment.calibration.content_hash,
        "position": list(position),
    }
    recording = Recording.create(out, plan, info, settings)
    equipment.calibration.save(out / "calibration.json")
    return recording


def _continue(stack: ExitStack, reporter: Reporter, equipment: Equipment, out: Path) -> Recording:
    """The recording in the folder, if camera and calibration are the ones it was begun with."""
    from depthwarp.scanner.recording import Recording

    recording = Recording.open(out)
    info = stack.enter_context(equipment.source).open()
    if info != recording.source:
        raise InputError(
            f"{out} was begun with camera {recording.source.name} ({recording.source.serial}), "
            f"this is {info.name} ({info.serial}): use that one, in the same setting"
        )
    equipment.calibration.require_hash(recording.settings["calibration_hash"])
    reporter.say(
        f"continuing {out}: {len(recording.finished)} of {len(recording.plan.angles)} stops are "
        "done; stops, exposures and gain are those that it was begun with"
    )
    return recording


def _take(
    reporter: Reporter, equipment: Equipment, recording: Recording, *, reference: bool
) -> None:
    """Take the stops that are left; whatever happens, the axis is left safe."""
    from depthwarp.scanner.scan import ScanControl, run_scan

    control, total = ScanControl(), len(recording.plan.angles)
    with cancel_on_signals(control), equipment.axis as axis:
        if reference:
            axis.reference()
        with reporter.progress("scan", "scanning", total) as update:
            run_scan(
                recording,
                equipment.source,
                axis,
                control=control,
                progress=lambda progress: update(progress.done),
            )


@contextmanager
def cancel_on_signals(control: ScanControl) -> Iterator[None]:
    """Ctrl-C and SIGTERM end the scan in order: motor stopped, laser off, recording whole."""
    wanted = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.getsignal(number) for number in wanted}
    for number in wanted:
        signal.signal(number, lambda *_: control.cancel())
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _finish(
    reporter: Reporter, recording: Recording, calibration: ScannerCalibration, out: Path
) -> None:
    from depthwarp.scanner.processing import process_recording

    with reporter.progress("process", "finding the line", len(recording.finished)) as update:
        result = process_recording(recording, calibration, progress=lambda done, _: update(done))
    result.cloud.save(out / "cloud.ply")
    report_cloud(reporter, out / "cloud.ply", asdict(result.counts))


def report_cloud(reporter: Reporter, path: Path, counts: dict[str, Any]) -> None:
    """Say what a processed recording has become."""
    if reporter.as_json:
        reporter.result({"output": str(path), "counts": counts, "seconds": reporter.seconds})
        return
    reporter.say(
        f"{path}: {counts['points']:,} points from {counts['stops']} stops; the line was found in "
        f"{counts['rows_found']:,} of {counts['rows']:,} rows"
    )
    if counts["stops_without_line"]:
        reporter.say(f"warning: {counts['stops_without_line']} stops show no line")
