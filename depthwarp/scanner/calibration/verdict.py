"""Is the calibration good, and what to do if it is not: limits and words.

The limits follow the error budget: a toe-in error e moves a point at range r along its ray by
e r^2 / d, where d is the camera's distance from the laser plane. With d = 0.5 m, 0.1 mrad is 45 mm
at 15 m, as much as the noise of the line itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from depthwarp.scanner.calibration.store import ScannerCalibration

__all__ = ["Check", "Grade", "Verdict", "judge"]


class Grade(StrEnum):
    """How good something is."""

    GOOD = "good"
    USABLE = "usable"
    BAD = "bad"


@dataclass(frozen=True)
class Check:
    """One number against its limits; larger is worse, unless the limits fall.

    Attributes:
        name: What was measured, in words.
        value: The number.
        unit: Its unit, as written after it.
        good: Up to here it is good.
        usable: Up to here it is usable; below `good` where small numbers are bad.
        advice: What to do if it is not good.
    """

    name: str
    value: float
    unit: str
    good: float
    usable: float
    advice: str

    @property
    def grade(self) -> Grade:
        """Good, usable or bad; a value that is not a number is bad."""
        sign = 1.0 if self.usable >= self.good else -1.0
        if sign * self.value <= sign * self.good:
            return Grade.GOOD
        return Grade.USABLE if sign * self.value <= sign * self.usable else Grade.BAD

    @property
    def text(self) -> str:
        """One line: grade, name, value and limit, and the advice where it is needed."""
        limit = "at most" if self.usable >= self.good else "at least"
        line = (
            f"{self.grade:6}  {self.name}: {self.value:.3g}{self.unit} "
            f"(good: {limit} {self.good:.3g}{self.unit})"
        )
        return line if self.grade is Grade.GOOD else f"{line}\n        -> {self.advice}"


@dataclass(frozen=True)
class Verdict:
    """All checks and what they come to: as good as the worst of them.

    Attributes:
        checks: In the order of the work.
    """

    checks: tuple[Check, ...]

    @property
    def grade(self) -> Grade:
        """The worst grade."""
        worst_first = (Grade.BAD, Grade.USABLE, Grade.GOOD)
        return min((check.grade for check in self.checks), key=worst_first.index)

    @property
    def text(self) -> str:
        """The verdict in words, a line for each check."""
        summary = {
            Grade.GOOD: "The calibration is good.",
            Grade.USABLE: "The calibration is usable; it gets better as said below.",
            Grade.BAD: "The calibration is bad: do what is said below, then repeat it.",
        }[self.grade]
        return "\n".join([summary, *(check.text for check in self.checks)])


def judge(calibration: ScannerCalibration) -> Verdict:
    """Judge a calibration by its residuals, its coverage and its uncertainty."""
    return Verdict((*_lens_checks(calibration), *_laser_checks(calibration), *_axis(calibration)))


def _lens_checks(calibration: ScannerCalibration) -> tuple[Check, ...]:
    residuals = calibration.residuals
    return (
        Check(
            "residual of the board's corners",
            residuals.corner_rms_px,
            " px",
            0.3,
            1.0,
            "use a flat, stiff board, sharp and evenly lit frames, and the true size of squares",
        ),
        Check(
            "part of the image's rim with corners",
            100 * residuals.rim_covered,
            " %",
            75,
            40,
            "take more board poses at the edges and corners of the image, where the lens bends",
        ),
        Check(
            "largest angle between boards",
            residuals.tilt_spread_deg,
            " degrees",
            40,
            20,
            "tilt the board by 20 to 40 degrees to the left, right, top and bottom",
        ),
    )


def _laser_checks(calibration: ScannerCalibration) -> tuple[Check, ...]:
    residuals, geometry = calibration.residuals, calibration.geometry
    farthest = geometry.max_range
    sigma = _range_sigma(calibration, farthest)
    toe_in = sigma * geometry.plane_distance / farthest**2
    return (
        Check(
            "residual of the laser line on the boards",
            residuals.laser_rms_px,
            " px",
            0.3,
            1.0,
            "use a matt board, less exposure where the line is saturated, and a stiff mount",
        ),
        Check(
            "farthest board with the laser on it",
            residuals.laser_farthest_m,
            " m",
            farthest / 3,
            farthest / 10,
            f"add targets farther away, best up to {farthest:g} m: an error of 0.1 mrad that does "
            f"not show nearby is {1e3 * 1e-4 * farthest**2 / geometry.plane_distance:.0f} mm there",
        ),
        Check(
            f"uncertainty of the ray and plane angle ({1e3 * sigma:.0f} mm at {farthest:g} m)",
            1e3 * toe_in,
            " mrad",
            0.1,
            0.4,
            "take more boards with the laser on them, farther away and at both ends of the line",
        ),
    )


def _axis(calibration: ScannerCalibration) -> tuple[Check, ...]:
    sigmas = calibration.covariance.sigmas
    return (
        Check(
            "uncertainty of the axis's direction",
            1e3 * math.hypot(sigmas["axis_pitch"], sigmas["axis_roll"]),
            " mrad",
            0.1,
            0.5,
            "turn the head further while the board stands still, 40 degrees or more, with the "
            "board at the top and at the bottom of the image",
        ),
        Check(
            "uncertainty of the axis's place",
            1e3 * math.hypot(sigmas["axis_forward"], sigmas["axis_sideways"]),
            " mm",
            0.1,
            0.5,
            "take more motor angles for each place of the board, the board near the scanner",
        ),
    )


def _range_sigma(calibration: ScannerCalibration, reach: float) -> float:
    """What the calibration alone adds to a point of the line at height 0 and some range [m]."""
    geometry = calibration.geometry
    across = np.asarray(geometry.plane_normal)[[0, 2]]
    foot = geometry.plane_distance / float(np.linalg.norm(across))
    across /= np.linalg.norm(across)
    along = np.array([-across[1], across[0]]) * np.copysign(1.0, across[0])
    x, z = foot * across + math.sqrt(max(reach**2 - foot**2, 0.0)) * along
    ray = np.array([[x / z, 0.0]])
    return float(calibration.covariance.range_sigma(geometry, ray)[0])
