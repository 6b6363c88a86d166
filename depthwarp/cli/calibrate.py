"""`depthwarp calibrate`: pictures of a board become a calibration; a flat wall checks it later."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from depthwarp.cli.calibrate_session import plan_shooting, take_pictures
from depthwarp.cli.guard import BAD_INPUT, run_command
from depthwarp.cli.options import JsonOption
from depthwarp.cli.report import Reporter, quiet_warp
from depthwarp.errors import InputError

if TYPE_CHECKING:
    from depthwarp.scanner.calibration import Board, Verdict

__all__ = ["calibrate"]

PLACEMENTS = 12


def calibrate(
    folder: Annotated[
        Path | None, typer.Argument(metavar="DIR", help="Folder of the board's pictures.")
    ] = None,
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Calibration file to write.")
    ] = None,
    board: Annotated[
        str | None,
        typer.Option(
            metavar="BOARD",
            help="chessboard:9x6:0.1 (inner corners, square [m]) or "
            "charuco:11x8:0.06:0.045:DICT_5X5_250; the pictures' own unless given.",
        ),
    ] = None,
    axis: Annotated[
        str | None,
        typer.Option(metavar="AXIS", help="Take pictures: grbl:PORT, horus:PORT, manual or twin."),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(
            metavar="CAMERA", help="basler, basler:SERIAL, opencv:N, folder:PATH or twin."
        ),
    ] = None,
    placements: Annotated[
        int, typer.Option(help="Places of the board, those already recorded included.")
    ] = PLACEMENTS,
    angles: Annotated[
        str | None,
        typer.Option(help="Stops of the head at each place [degrees], separated by commas."),
    ] = None,
    exposure: Annotated[float, typer.Option(help="Exposure that shows the board [us].")] = 20_000.0,
    line_exposure: Annotated[
        list[float] | None,
        typer.Option(
            metavar="US", help="Exposure for the line [us]; repeat it. 1000 and 100 unless given."
        ),
    ] = None,
    gain: Annotated[float, typer.Option(help="Gain [dB].")] = 0.0,
    settle: Annotated[float, typer.Option(help="Standstill before a frame [s].")] = 0.2,
    rotation: Annotated[
        int, typer.Option(help="How far the camera is rolled clockwise [degrees].")
    ] = 0,
    max_range: Annotated[float, typer.Option(help="Range limit of the scanner [m].")] = 15.0,
    twin_scale: Annotated[
        float, typer.Option(help="Size of the twin's sensor; 1 is 1942 x 2590 px.")
    ] = 0.25,
    verify: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Check a calibration by the recorded scan of a wall."),
    ] = None,
    calibration: Annotated[
        Path | None, typer.Option(help="With --verify: the calibration to check.")
    ] = None,
    distance: Annotated[
        float | None,
        typer.Option(help="With --verify: the wall's distance from the axis, by tape [m]."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Calibrate the scanner from pictures of a board, or check a calibration on a wall.

    With --axis and --camera the missing pictures are taken first: the board is put up in one place
    after another, and the head turns in front of it; space (or p) pauses, with the laser off. A run
    that was broken off goes on at the place where it stood. The result is good, usable or bad in
    words; a bad one is not written.
    """
    reporter = Reporter(as_json)

    def command() -> None:
        quiet_warp()
        if verify is not None:
            _verify(reporter, verify, calibration, distance)
            return
        if folder is None or output is None:
            raise InputError(
                "give the folder of the board's pictures and -o FILE, or --verify DIR with "
                "--calibration FILE"
            )
        if not output.absolute().parent.is_dir():
            raise InputError(f"cannot write {output}: its folder does not exist")
        pattern = _board(folder, board)
        if axis is not None or camera is not None:
            if axis is None or camera is None:
                raise InputError("pictures need both --axis and --camera")
            exposures = (exposure, *(line_exposure or (1000.0, 100.0)))
            shooting = plan_shooting(folder, pattern, placements, angles, exposures, gain, settle)
            take_pictures(
                reporter, shooting, axis, camera, rotation=rotation, twin_scale=twin_scale
            )
        _compute(reporter, folder, output, pattern, max_range)

    run_command(reporter, command)


def _board(folder: Path, text: str | None) -> Board:
    """The board that is named, or that the pictures were taken of."""
    from depthwarp.scanner.calibration import parse_board
    from depthwarp.scanner.calibration.capture import recorded_placements

    if text is not None:
        return parse_board(text)
    for recording in recorded_placements(folder).values():
        if "board" in recording.settings:
            return parse_board(recording.settings["board"])
    raise InputError(f"{folder} holds no pictures that say their board: give --board")


def _compute(
    reporter: Reporter, folder: Path, output: Path, board: Board, max_range: float
) -> None:
    from depthwarp.scanner.calibration import Grade
    from depthwarp.scanner.calibration.capture import recorded_placements
    from depthwarp.scanner.calibration.recorded import calibrate_recordings

    recordings = recorded_placements(folder)
    stops = sum(len(recording.finished) for recording in recordings.values())
    with reporter.progress("find", "finding board and line", stops) as update:
        calibration, report = calibrate_recordings(
            recordings, board, max_range=max_range, progress=lambda done, _: update(done)
        )
    is_bad = report.verdict.grade is Grade.BAD
    if not is_bad:
        calibration.save(output)
    if reporter.as_json:
        reporter.result(
            {
                "output": None if is_bad else str(output),
                **_verdict_json(report.verdict),
                "residuals": asdict(calibration.residuals),
                "sigmas": calibration.covariance.sigmas,
                "skipped": list(report.skipped),
                "seconds": reporter.seconds,
            }
        )
    reporter.say(report.text)
    reporter.say(f"{output} was not written" if is_bad else f"{output}: written")
    if is_bad:
        raise typer.Exit(BAD_INPUT)


def _verify(
    reporter: Reporter, folder: Path, calibration: Path | None, distance: float | None
) -> None:
    from depthwarp.scanner.calibration import Grade, load_calibration, verify
    from depthwarp.scanner.calibration.recorded_wall import wall_points
    from depthwarp.scanner.recording import Recording

    if calibration is None:
        raise InputError("--verify needs --calibration FILE, the calibration to check")
    known = load_calibration(calibration)
    recording = Recording.open(folder)
    with reporter.progress("find", "finding the line", len(recording.finished)) as update:
        points = wall_points(recording, known, progress=lambda done, _: update(done))
    verdict = verify(points, known.geometry, distance)
    if reporter.as_json:
        reporter.result({**_verdict_json(verdict), "seconds": reporter.seconds})
    reporter.say(verdict.text)
    if verdict.grade is Grade.BAD:
        raise typer.Exit(BAD_INPUT)


def _verdict_json(verdict: Verdict) -> dict[str, Any]:
    checks = [{**asdict(check), "grade": str(check.grade)} for check in verdict.checks]
    return {"grade": str(verdict.grade), "checks": checks}
