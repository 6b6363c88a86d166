"""Taking the pictures that a calibration lacks: place after place, with hardware or the twin."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import depthwarp
from depthwarp.cli.options import TWIN
from depthwarp.cli.report import Reporter
from depthwarp.cli.signals import leave_on_signals
from depthwarp.cli.steering import ask_person, ended_by_signals, steered, wait_for_person
from depthwarp.errors import InputError

if TYPE_CHECKING:
    from depthwarp.scanner.axis import Axis
    from depthwarp.scanner.calibration import Board
    from depthwarp.scanner.frames import FrameSource, SourceInfo
    from depthwarp.scanner.plan import ScanPlan
    from depthwarp.scanner.twin.session import TwinScanner

__all__ = ["Shooting", "plan_shooting", "take_pictures"]


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


def plan_shooting(
    folder: Path,
    board: Board,
    placements: int,
    angles: str | None,
    exposures: tuple[float, ...],
    gain: float,
    settle: float,
) -> Shooting:
    """What is still to be taken, and how.

    Args:
        folder: Of all placements.
        board: The board.
        placements: How many there are to be, those already recorded included.
        angles: Stops of the head [degrees], separated by commas; None for the usual ones.
        exposures: For the board first, then for the line [us].
        gain: Gain [dB].
        settle: Standstill before a frame [s].

    Raises:
        InputError: A number that is none, or out of its range.
        FileFormatError: A recorded placement is damaged.
    """
    from depthwarp.scanner.calibration.capture import DEFAULT_STOPS, recorded_placements
    from depthwarp.scanner.plan import ScanPlan

    if not 1 <= placements <= 99:
        raise InputError(f"--placements must be 1 to 99, got {placements}")
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


def take_pictures(
    reporter: Reporter,
    shooting: Shooting,
    axis: str,
    camera: str,
    *,
    rotation: int,
    twin_scale: float,
) -> None:
    """Take the missing placements.

    Args:
        reporter: Shows the progress.
        shooting: What is missing.
        axis: As `--axis` has it.
        camera: As `--camera` has it.
        rotation: How far the camera is rolled clockwise [degrees].
        twin_scale: Size of the twin's sensor.

    Raises:
        InputError: Axis and camera that do not belong together, or that are not there.
        ScanCancelledError: The person left.
        AxisError: See `run_scan`.
        FrameError: See `run_scan`.
    """
    if axis == TWIN or camera == TWIN:
        _take_with_twin(reporter, shooting, axis, camera, twin_scale)
    else:
        _take_with_person(reporter, shooting, axis, camera, rotation)


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
    from depthwarp.scanner.calibration.views import place_name
    from depthwarp.scanner.sources import open_source

    if not shooting.missing:
        return
    source = open_source(camera, rotation=rotation)
    motor = open_axis(axis, ask=ask_person, tell=reporter.say)
    text = "cancelled; the same command goes on where this one stood"
    with leave_on_signals(text), source, motor as head:
        info = source.open()
        head.reference()
        for number in shooting.missing:
            head.move_to(0.0)
            wait_for_person(
                f"For {place_name(number)}: {where_to_put(number)} Press Enter when it stands "
                "still."
            )
            _take(reporter, shooting, number, shooting.plan, source, info, head)


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
    from depthwarp.scanner.calibration.views import place_name
    from depthwarp.scanner.scan import ScanCancelledError, ScanControl

    control = ScanControl()
    settings = {"depthwarp": depthwarp.__version__, "board": shooting.board.text}
    text = place_name(number)
    cancelled = f"cancelled at {text}; the same command goes on with that place"
    with (
        ended_by_signals(control, axis, cancelled),
        steered(reporter, control, axis, "take", text, len(plan.angles)) as update,
    ):
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
            raise ScanCancelledError(cancelled) from error
