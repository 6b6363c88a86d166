"""Running a scan: turn, settle, take the frames, record the stop; safe on every way out."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from depthwarp.errors import DepthwarpError
from depthwarp.scanner.axis import Axis
from depthwarp.scanner.frames import (
    Frame,
    FrameSource,
    FrameTimeoutError,
    IncompleteFrameError,
)
from depthwarp.scanner.recording import Recording, Step, lit, off

__all__ = ["ScanCancelledError", "ScanControl", "ScanProgress", "run_scan"]

FRAME_TRIES = 3
"""How often a frame is asked for before a late or damaged one ends the scan."""

_LOOK_S = 0.02  # how often a paused scan looks whether to go on


class ScanCancelledError(DepthwarpError):
    """The scan was cancelled; what is recorded can be continued."""


@dataclass(frozen=True)
class ScanProgress:
    """How far a scan is.

    Attributes:
        done: Finished stops, those of earlier runs included.
        total: Stops of the plan.
        angle: Reported angle of the last stop [degrees].
        seconds_left: Expected time to the end [s], from the stops of this run.
    """

    done: int
    total: int
    angle: float
    seconds_left: float


class ScanControl:
    """Pause, continue and cancel a running scan, from another thread or a signal handler.

    Nothing but plain attributes, looked at often: a lock could be held by the very code that a
    signal handler interrupts.
    """

    def __init__(self) -> None:
        self._paused = self._resting = self._cancelled = False
        self._at_rest: list[Callable[[], None]] = []

    @property
    def is_paused(self) -> bool:
        """Whether a pause was asked for."""
        return self._paused

    @property
    def is_resting(self) -> bool:
        """Whether the scan has come to the pause: the head stands still, the laser is off."""
        return self._resting

    def pause(self) -> None:
        """Hold after the stop that is under way; the laser is off meanwhile."""
        self._paused = True

    def resume(self) -> None:
        """Go on after `pause`."""
        self._paused = False

    def cancel(self) -> None:
        """End the scan before the next frame."""
        self._cancelled = True

    def call_at_rest(self, action: Callable[[], None]) -> None:
        """Have something done, once, by the scan's own thread when it next stands between stops.

        The head stands still and the laser is off then, paused or not.
        """
        self._at_rest.append(action)

    def check(self) -> None:
        """Go on unless the scan is cancelled.

        Raises:
            ScanCancelledError: `cancel` was called.
        """
        if self._cancelled:
            raise ScanCancelledError("the scan was cancelled; --resume continues it")

    def hold(self) -> float:
        """Wait while paused; called where the head stands still and the laser is off.

        Returns:
            How long the scan was held [s].

        Raises:
            ScanCancelledError: `cancel` was called, also in the pause.
        """
        begun = time.monotonic()
        try:
            while not self._cancelled and (self._paused or self._at_rest):
                self._resting = True
                if self._at_rest:
                    self._at_rest.pop(0)()
                else:
                    time.sleep(_LOOK_S)
        finally:
            self._resting = False
        self.check()
        return time.monotonic() - begun


def run_scan(
    recording: Recording,
    source: FrameSource,
    axis: Axis,
    *,
    control: ScanControl | None = None,
    progress: Callable[[ScanProgress], None] | None = None,
) -> None:
    """Take the stops that a recording still lacks, and record each as soon as it is complete.

    The caller has opened source and axis. Whatever ends the scan, the motor stands and the laser is
    off when this returns or raises.

    Args:
        recording: A new recording, or one to continue.
        source: The camera, open.
        axis: The motor, connected and referenced.
        control: Pause and cancel.
        progress: Called after every stop.

    Raises:
        ScanCancelledError: `control.cancel` was called.
        FrameError: The camera is lost, or a frame failed several times.
        AxisError: The axis is lost, in alarm, or restarted.
        InputError: The disk refuses.
    """
    control = control or ScanControl()
    plan, remaining = recording.plan, recording.remaining
    begun = time.monotonic()
    try:
        for taken, number in enumerate(remaining, start=1):
            begun += control.hold()
            reported = axis.move_to(plan.angles[number])
            time.sleep(plan.settle_s)
            frames = _take_frames(recording, source, axis, control)
            recording.append(Step(number, plan.angles[number], reported, frames))
            if progress is not None:
                pace = (time.monotonic() - begun) / taken
                progress(
                    ScanProgress(
                        done=len(plan.angles) - len(remaining) + taken,
                        total=len(plan.angles),
                        angle=reported,
                        seconds_left=pace * (len(remaining) - taken),
                    )
                )
    finally:
        axis.stop()


def _take_frames(
    recording: Recording, source: FrameSource, axis: Axis, control: ScanControl
) -> dict[str, Frame]:
    """The frames of one stop: each exposure without the laser, then each with it.

    An exposure has a frame without the laser of its own: ambient light grows with the exposure.
    What ends this early leaves the laser to the caller's `stop`, which asks nobody to confirm.
    """
    plan = recording.plan
    frames: dict[str, Frame] = {}

    def take(name: Callable[[int], str]) -> None:
        for number, exposure in enumerate(plan.exposures_us):
            source.configure(exposure, plan.gain_db)
            frames[name(number)] = _grab(recording, source, control, exposure)

    if plan.with_off_frame:
        axis.set_laser(False)
        take(off)
    axis.set_laser(True)
    take(lit)
    axis.set_laser(False)
    return frames


def _grab(
    recording: Recording, source: FrameSource, control: ScanControl, exposure_us: float
) -> Frame:
    """One frame of the size that the recording has; late and damaged ones are asked for again.

    Raises:
        FrameError: It failed several times, or the camera is gone.
    """
    timeout = recording.plan.frame_timeout_s + exposure_us * 1e-6
    tries = 1
    while True:
        control.check()
        try:
            return _of_full_size(source.grab(timeout), recording)
        except (FrameTimeoutError, IncompleteFrameError):
            if tries == FRAME_TRIES:
                raise
        tries += 1


def _of_full_size(frame: Frame, recording: Recording) -> Frame:
    """The frame, if it has the size of the recording.

    Raises:
        IncompleteFrameError: It has another one.
    """
    width, height = recording.source.size
    if frame.pixels.shape[:2] != (height, width):
        raise IncompleteFrameError(
            f"the camera delivered a frame of {frame.pixels.shape[1]} x {frame.pixels.shape[0]} "
            f"pixels, the scan has {width} x {height}: set the camera's region back to full size"
        )
    return frame
