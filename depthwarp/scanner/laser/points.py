"""Points of a laser line in one frame, and what the frame has to say about the line as a whole."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntFlag, StrEnum

import numpy as np
import numpy.typing as npt

from depthwarp.errors import DepthwarpError

__all__ = [
    "LineCounts",
    "LineError",
    "LinePoints",
    "LineStatus",
    "NoLineError",
    "PointFlag",
    "TwoLinesError",
]

TWO_LINES_SHARE = 0.25
"""Share of rows with a rival peak from which there are two lines: reflections make fewer."""


class LineError(DepthwarpError):
    """A frame does not show one laser line."""


class NoLineError(LineError):
    """A frame shows no laser line."""


class TwoLinesError(LineError):
    """A frame shows two lines alike: another laser, or its mirror image."""


class LineStatus(StrEnum):
    """What a frame shows."""

    FOUND = "found"
    NO_LINE = "no line"
    TWO_LINES = "two lines"

    @classmethod
    def of(cls, found: int, rivals: int) -> LineStatus:
        """What rows with a point, and those of them with a rival peak, make of a frame."""
        if found == 0:
            return cls.NO_LINE
        return cls.TWO_LINES if rivals > TWO_LINES_SHARE * found else cls.FOUND


class PointFlag(IntFlag):
    """What is special about a point."""

    SATURATED = 1
    """The sensor is at full scale at the peak; the position comes from the line's flanks."""

    RIVAL = 2
    """Another peak of its row is at least half as high; the higher one was taken."""

    NARROW = 4
    """The line is narrower than a pixel; the position is the apex of a Gaussian."""


@dataclass(frozen=True)
class LineCounts:
    """What became of the rows of a frame; the parts add up to the total.

    Attributes:
        total: Rows of the frame.
        empty: No pixel of the line's colour.
        weak: No peak that stands out from the noise.
        wide: The peak is too wide to be a line.
        cut: The peak is cut off by the edge of the frame.
        isolated: A peak without others near it in the rows beside.
        beside: A peak at an end of the line that bends away from it: the row sees it in part.
        found: Rows with a point.
        rivals: Of those, rows in which another peak is at least half as high.
    """

    total: int
    empty: int
    weak: int
    wide: int
    cut: int
    isolated: int
    beside: int
    found: int
    rivals: int


@dataclass(frozen=True, eq=False)
class LinePoints:
    """Where a laser line crosses the rows of a frame: at most one point a row, by ascending row.

    Attributes:
        rows: Row of the upright frame [px], shape (M,).
        columns: Column of the line's middle, pixel centres at whole numbers [px], shape (M,).
        sigma_px: Standard deviation of the column [px], shape (M,). From sensor noise it is that of
            the derivative filter's output, sqrt(sum of weight^2 * noise variance), over the
            steepness with which the output crosses zero (first-order propagation). What is
            systematic is added in squares: 0.01 px, and for a saturated line 0.01 to 0.08 px by the
            steepness of its flanks. Speckle and the roughness of a surface are not in it.
        peak: Height of the line over its background, blurred [grey levels of 255], shape (M,).
        width_px: Width at half height [px], shape (M,).
        flags: Values of `PointFlag`, shape (M,).
        counts: What became of all rows.
    """

    rows: npt.NDArray[np.int32]
    columns: npt.NDArray[np.float64]
    sigma_px: npt.NDArray[np.float64]
    peak: npt.NDArray[np.float64]
    width_px: npt.NDArray[np.float64]
    flags: npt.NDArray[np.uint8]
    counts: LineCounts

    @property
    def status(self) -> LineStatus:
        """Whether the frame shows one line, none, or two."""
        return LineStatus.of(self.counts.found, self.counts.rivals)

    def check(self) -> LinePoints:
        """Return the points if the frame shows one line.

        Raises:
            NoLineError: It shows none; the message says what became of the rows.
            TwoLinesError: It shows two.
        """
        c = self.counts
        if self.status is LineStatus.NO_LINE:
            raise NoLineError(
                f"no laser line in view: of {c.total} rows {c.empty} hold nothing of its colour, "
                f"{c.weak} too weak a peak, {c.wide} too wide a one, {c.cut} one at the edge, "
                f"{c.isolated} one without neighbours; check that the laser is on and in view, the "
                "exposure, and that the colour model was fitted to this laser"
            )
        if self.status is LineStatus.TWO_LINES:
            raise TwoLinesError(
                f"two laser lines in view: {c.rivals} of {c.found} rows have a second peak at "
                "least half as high; switch the other laser off, or cover what mirrors the line"
            )
        return self
