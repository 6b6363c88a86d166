"""What a scan does: at which angles it stops, and which frames it takes there."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from depthwarp.errors import InputError

__all__ = ["ScanPlan"]

MAX_STOPS = 1_000_000
"""Most stops of one scan: five hundred times a full turn of the finest usual stepping motor."""


@dataclass(frozen=True)
class ScanPlan:
    """The stops of a scan and the frames of each.

    At every stop the head stands still for `settle_s`; then, for each exposure, one frame is taken
    with the laser off (if `with_off_frame`) and one with it on.

    Attributes:
        angles: Commanded angles [degrees].
        exposures_us: Exposure times of the lit frames [microseconds]; several are a bracket, of
            which every row of the line takes its best frame.
        gain_db: Gain of the camera [dB].
        settle_s: How long the head stands still before the first frame [s].
        with_off_frame: Whether frames without the laser are taken, to subtract ambient light.
        frame_timeout_s: How long a frame may take beyond its exposure [s].

    Raises:
        InputError: No stops, no exposures, or numbers out of their range.
    """

    angles: tuple[float, ...]
    exposures_us: tuple[float, ...] = (10_000.0,)
    gain_db: float = 0.0
    settle_s: float = 0.05
    with_off_frame: bool = True
    frame_timeout_s: float = 5.0

    def __post_init__(self) -> None:
        if not 1 <= len(self.angles) <= MAX_STOPS:
            raise InputError(f"a scan must have 1 to {MAX_STOPS} stops, got {len(self.angles)}")
        if not self.exposures_us or any(not 0 < e < math.inf for e in self.exposures_us):
            raise InputError(
                f"exposures must be one or more times above 0 us, got {self.exposures_us}"
            )
        finite = (*self.angles, self.gain_db)
        if not all(math.isfinite(value) for value in finite):
            raise InputError("angles and gain must be finite numbers")
        if not (0 <= self.settle_s < math.inf and 0 < self.frame_timeout_s < math.inf):
            raise InputError(
                "settle_s must be 0 or more and frame_timeout_s above 0, "
                f"got {self.settle_s} and {self.frame_timeout_s}"
            )

    @classmethod
    def turn(cls, stops: int, degrees: float = 360.0, **settings: Any) -> ScanPlan:
        """A plan of evenly spaced stops over a turn.

        Args:
            stops: How many there are.
            degrees: Angle that the turn covers; the stop after the last one would stand there.
            settings: The other attributes of the plan.

        Raises:
            InputError: Numbers out of their range.
        """
        if not 1 <= stops <= MAX_STOPS:
            raise InputError(f"stops must be 1 to {MAX_STOPS}, got {stops}")
        if not 0 < abs(degrees) <= 360:
            raise InputError(f"degrees must be above 0 and at most 360, got {degrees}")
        return cls(angles=tuple(degrees * k / stops for k in range(stops)), **settings)

    def to_json(self) -> dict[str, Any]:
        """The plan as JSON values."""
        return asdict(self) | {"angles": list(self.angles), "exposures_us": list(self.exposures_us)}

    @classmethod
    def from_json(cls, entries: dict[str, Any]) -> ScanPlan:
        """The plan of `to_json`.

        Raises:
            TypeError: Entries that a plan does not have.
            InputError: Numbers out of their range.
        """
        return cls(
            **{
                **entries,
                "angles": tuple(entries["angles"]),
                "exposures_us": tuple(entries["exposures_us"]),
            }
        )
