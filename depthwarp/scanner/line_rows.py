"""The laser line of a stop: of a bracket of exposures, the best point in each row."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthwarp.scanner.laser import LineFinder, LineStatus, PointFlag
from depthwarp.scanner.recording import Step

__all__ = ["LineRows", "line_rows"]

Float64Array = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class LineRows:
    """At most one point a row, by ascending row; see `laser.LinePoints`.

    Attributes:
        rows: Row [px], shape (M,).
        columns: Column of the line's middle [px], shape (M,).
        sigma_px: Standard deviation of the column [px], shape (M,).
        width_px: Width at half height [px], shape (M,).
        peak: Height over the background [grey levels of 255], shape (M,).
        rivals: Rows in which another peak is at least half as high.
    """

    rows: Float64Array
    columns: Float64Array
    sigma_px: Float64Array
    width_px: Float64Array
    peak: Float64Array
    rivals: int

    @property
    def status(self) -> LineStatus:
        """Whether the stop shows one line, none, or two."""
        return LineStatus.of(len(self.rows), self.rivals)


def line_rows(finder: LineFinder, step: Step, *, is_paired: bool) -> LineRows:
    """The line of a stop; each row takes the exposure with the smallest sigma.

    A saturated peak counts only where no exposure is unsaturated.

    Args:
        finder: Finds the line.
        step: The stop.
        is_paired: Whether the frames without the laser are taken away.
    """
    lines = [finder.find(on, off if is_paired else None) for on, off in step.exposures]
    rows, columns, sigma, width, peak, flags = (
        np.concatenate([getattr(line, name) for line in lines])
        for name in ("rows", "columns", "sigma_px", "width_px", "peak", "flags")
    )
    is_saturated = (flags & PointFlag.SATURATED) != 0
    order = np.lexsort((sigma, is_saturated, rows))
    best = order[np.unique(rows[order], return_index=True)[1]]
    return LineRows(
        rows=rows[best].astype(np.float64),
        columns=columns[best],
        sigma_px=sigma[best],
        width_px=width[best],
        peak=peak[best],
        rivals=int(np.count_nonzero(flags[best] & PointFlag.RIVAL)),
    )
