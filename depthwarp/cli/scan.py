"""`depthwarp scan`: turn the head, take the frames, record them, and make the cloud."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from depthwarp.cli.guard import run_command
from depthwarp.cli.options import TWIN, JsonOption
from depthwarp.cli.report import Reporter, quiet_warp
from depthwarp.cli.scan_session import ScanOrder, choose_equipment, take_turn

if TYPE_CHECKING:
    from depthwarp.scanner.calibration import ScannerCalibration
    from depthwarp.scanner.recording import Recording

__all__ = ["report_cloud", "scan"]


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
        typer.Option(
            metavar="US", help="Exposure [us]; repeat it for a bracket. 2000 unless given."
        ),
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

    Without hardware, the twin scans a simulated room. Space (or p) pauses after the stop that is
    under way, with the laser off, and goes on again; Ctrl-Z leaves the scan so, too. Ctrl-C stops
    the motor, switches the laser off, and leaves a recording that --resume continues.
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
        order = ScanOrder(out, plan, position, resume, at_start)
        with ExitStack() as stack:
            equipment = choose_equipment(
                stack,
                reporter,
                axis,
                camera,
                calibration,
                rotation=rotation,
                twin_scale=twin_scale,
            )
            recording = take_turn(reporter, equipment, order)
        _finish(reporter, recording, equipment.calibration, out)

    run_command(reporter, command)


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
    warnings = _warnings(counts)
    if reporter.as_json:
        reporter.result(
            {
                "output": str(path),
                "counts": counts,
                "warnings": warnings,
                "seconds": reporter.seconds,
            }
        )
    reporter.say(
        f"{path}: {counts['points']:,} points from {counts['stops']} stops; the line was found in "
        f"{counts['rows_found']:,} of {counts['rows']:,} rows"
    )
    for warning in warnings:
        reporter.say(f"warning: {warning}")


def _warnings(counts: dict[str, Any]) -> list[str]:
    """What a person should know of stops that do not show one line: what is wrong, what to do."""
    total, warnings = counts["stops"], []
    if without := counts["stops_without_line"]:
        warnings.append(
            f"{without} of {total} stops show no laser line: where something is in reach there, "
            "check that the laser was on and in view, and give a longer --exposure"
        )
    if two := counts["stops_with_two_lines"]:
        warnings.append(
            f"{two} of {total} stops show two lines; each row took the brighter one, which may be "
            "the wrong one: switch the other laser off or cover what mirrors the line, and scan "
            "again"
        )
    return warnings
