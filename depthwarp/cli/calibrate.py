"""`depthwarp calibrate`: pictures of a board become a calibration; a flat wall checks it later."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

import depthwarp
from depthwarp.cli.guard import BAD_INPUT, run_command
from depthwarp.cli.options import JsonOption
from depthwarp.cli.report import Reporter, quiet_warp
from depthwarp.cli.scan import TWIN, ask_person, cancel_on_signals
from depthwarp.errors import InputError

if TYPE_CHECKING:
    from depthwarp.scanner.axis import Axis
    from depthwarp.scanner.calibration import Board, Verdict
    from depthwarp.scanner.frames import FrameSource, SourceInfo
    from depthwarp.scanner.plan import ScanPlan
    from depthwarp.scanner.twin.session import TwinScanner

__all__ = ["calibrate"]

PLACEMENTS = 12


@dataclass(frozen=True)
class Shooting:
    """What is needed to take the missing placements.

    Attributes:
        folder: Of all placements.
        missing: Numbers of the placements to take.
        board: The board.
        plan: Exposures and stops; with the twin every place has its own stops unless some are
            given.
        has_own_stops: Whether each place's own stops are used.
    """

    folder: Path
    missing: list[int]
    board: Board
    plan: ScanPlan
    has_own_stops: bool


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
        typer.Option(help="Exposure for the line [us]; repeat it. 1000 and 100 unless given."),
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
    after another, and the head turns in front of it. A run that was broken off goes on at the place
    where it stood. The result is good, usable or bad in words; a bad one is not written.
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
            shooting = _shooting(folder, pattern, placements, angles, exposures, gain, settle)
            if axis == TWIN or camera == TWIN:
                _take_with_twin(reporter, shooting, axis, camera, twin_scale)
            else:
                _take_with_person(reporter, shooting, axis, camera, rotation)
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


def _shooting(
    folder: Path,
    board: Board,
    placements: int,
    angles: str | None,
    exposures: tuple[float, ...],
    gain: float,
    settle: float,
) -> Shooting:
    from depthwarp.scanner.calibration.capture import DEFAULT_STOPS, recorded_placements
    from depthwarp.scanner.plan import ScanPlan

    if not 1 <= placements <= 99:
        raise InputError(f"placements must be 1 to 99, got {placements}")
    recorded = recorded_placements(folder)
    missing = [n for n in range(placements) if n not in recorded or recorded[n].remaining]
    stops = DEFAULT_STOPS if angles is None else _stops(angles)
    plan = ScanPlan(stops, exposures, gain, settle)
    return Shooting(folder, missing, board, plan, angles is None)


def _stops(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(part) for part in text.split(","))
    except ValueError as error:
        raise InputError(
            f"--angles must be numbers separated by commas, as in -30,-15,0,15,30, got '{text}'"
        ) from error


def _take_with_twin(
    reporter: Reporter, shooting: Shooting, axis: str, camera: str, scale: float
) -> None:
    """The twin puts the board up by itself, in a hall."""
    from depthwarp.scanner.twin.board_hall import BOARD_PLACES, board_renderer
    from depthwarp.scanner.twin.session import TwinScanner

    if axis != camera:
        raise InputError("the twin's camera and axis belong together: give both, or neither")
    if shooting.missing and shooting.missing[-1] >= len(BOARD_PLACES):
        raise InputError(f"the twin knows {len(BOARD_PLACES)} places for the board, no more")
    with ExitStack() as stack:
        twin: TwinScanner = stack.enter_context(TwinScanner(scale))
        geometry = twin.calibration.geometry
        info = stack.enter_context(twin.camera).open()
        head = stack.enter_context(twin.axis)
        head.reference()
        width = float(shooting.board.points[:, 0].max())
        for number in shooting.missing:
            place = BOARD_PLACES[number]
            twin.camera.renderer = board_renderer(geometry, shooting.board, place, seed=number)
            stops = place.angles(width) if shooting.has_own_stops else shooting.plan.angles
            plan = replace(shooting.plan, angles=stops, settle_s=0.0)
            _take(reporter, shooting, number, plan, twin.camera, info, head)


def _take_with_person(
    reporter: Reporter, shooting: Shooting, axis: str, camera: str, rotation: int
) -> None:
    """A person puts the board up and says when it stands."""
    from depthwarp.scanner.axes import open_axis
    from depthwarp.scanner.calibration.capture import where_to_put
    from depthwarp.scanner.sources import open_source

    if not shooting.missing:
        return
    source = open_source(camera, rotation=rotation)
    motor = open_axis(axis, ask=ask_person, tell=reporter.say)
    with _leave_on_signals(), source, motor as head:
        info = source.open()
        head.reference()
        for number in shooting.missing:
            head.move_to(0.0)
            typer.prompt(
                f"Place {number + 1}: {where_to_put(number)} Press Enter when it stands still",
                default="",
                show_default=False,
                err=True,
            )
            _take(reporter, shooting, number, shooting.plan, source, info, head)


@contextmanager
def _leave_on_signals() -> Iterator[None]:
    """Ctrl-C and SIGTERM end even a wait for the person, through the exits of axis and camera.

    Raises:
        ScanCancelledError: Out of what was under way when the signal came.
    """
    from depthwarp.scanner.scan import ScanCancelledError

    wanted = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.getsignal(number) for number in wanted}

    def leave(*_: object) -> None:
        for number in wanted:  # a second signal must not break off the way to a safe machine
            signal.signal(number, signal.SIG_IGN)
        raise ScanCancelledError("cancelled; the same command goes on where this one stood")

    for number in wanted:
        signal.signal(number, leave)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _take(
    reporter: Reporter,
    shooting: Shooting,
    number: int,
    plan: ScanPlan,
    source: FrameSource,
    info: SourceInfo,
    axis: Axis,
) -> None:
    from depthwarp.scanner.calibration.capture import take_placement
    from depthwarp.scanner.scan import ScanCancelledError, ScanControl

    control = ScanControl()
    settings = {"depthwarp": depthwarp.__version__, "board": shooting.board.text}
    text = f"place {number + 1} of the board"
    with cancel_on_signals(control), reporter.progress("take", text, len(plan.angles)) as update:
        try:
            take_placement(
                shooting.folder,
                number,
                plan,
                source,
                info,
                axis,
                settings=settings,
                control=control,
                progress=update,
            )
        except ScanCancelledError as error:
            raise ScanCancelledError(
                f"cancelled at place {number + 1}; the same command goes on with that place"
            ) from error


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
