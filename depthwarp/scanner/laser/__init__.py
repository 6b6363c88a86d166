"""The laser line: learn its colour, bake it into a table, find its sub-pixel crossing of each row.

model = fit_pairs([(lit_frame, off_frame)])
finder = LineFinder(ColorTable(model), info.size, info.pixel_format)
points = finder.find(lit_frame, off_frame).check()
"""

from depthwarp.scanner.laser.color_model import ColorKind, LaserColorModel
from depthwarp.scanner.laser.color_table import ColorTable
from depthwarp.scanner.laser.colors import frame_colors
from depthwarp.scanner.laser.fitting import fit_lit, fit_marked, fit_pairs
from depthwarp.scanner.laser.line import LineFinder, SensorNoise
from depthwarp.scanner.laser.mixture import GaussianMixture, fit_mixture
from depthwarp.scanner.laser.points import (
    LineCounts,
    LineError,
    LinePoints,
    LineStatus,
    NoLineError,
    PointFlag,
    TwoLinesError,
)

__all__ = [
    "ColorKind",
    "ColorTable",
    "GaussianMixture",
    "LaserColorModel",
    "LineCounts",
    "LineError",
    "LineFinder",
    "LinePoints",
    "LineStatus",
    "NoLineError",
    "PointFlag",
    "SensorNoise",
    "TwoLinesError",
    "fit_lit",
    "fit_marked",
    "fit_mixture",
    "fit_pairs",
    "frame_colors",
]
