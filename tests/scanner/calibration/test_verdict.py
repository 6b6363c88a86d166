"""Verdicts: limits, words, and what a scan of a flat wall reveals."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.calibration import (
    Check,
    Grade,
    Residuals,
    ScannerCalibration,
    Verdict,
    judge,
    verify,
)
from depthwarp.scanner.geometry import ScannerGeometry, reference_geometry
from depthwarp.scanner.lens import project
from depthwarp.scanner.triangulation import LaserPoints, triangulate
from depthwarp.scanner.uncertainty import GeometryCovariance, tangents

TRUTH = reference_geometry()
WALL_M = 5.0
GOOD_RESIDUALS = Residuals(40, 7, 5000, 0.1, 0.12, 1e-4, 0.5, 6.0, 1.0, 80.0, 50.0)
GOOD_SIGMAS = {"cx": 0.05, "plane_toe_in": 3e-5, "axis_roll": 2e-5, "axis_forward": 3e-5}


def calibration(sigmas: dict[str, float], residuals: Residuals) -> ScannerCalibration:
    known = GeometryCovariance.from_sigmas(sigmas)
    return ScannerCalibration(TRUTH, known, "c", "1", "2026", "chessboard:8x6:0.04", residuals)


def scan_wall(geometry: ScannerGeometry, bump_m: float = 0.0) -> LaserPoints:
    """A wall square to world X at `WALL_M`, seen by the true scanner, computed with `geometry`.

    The reference laser points 40 degrees to the left, so the head turns 40 to the right.
    """
    rng = np.random.default_rng(0)
    head = TRUTH.head_from_optical
    normal, distance = np.array(TRUTH.plane_normal), TRUTH.plane_distance
    rows, columns, angles = [], [], []
    for angle in np.arange(-60.0, -19.0, 2.0):
        # Points of the laser plane are a + z b for each height y; the wall fixes z.
        turn = np.radians(angle)
        facing = np.array([np.cos(turn), -np.sin(turn), 0.0]) @ head[:3, :3]
        offset = np.array([np.cos(turn), -np.sin(turn), 0.0]) @ head[:3, 3]
        y = np.linspace(-1.5, 1.5, 60)
        a = np.column_stack([(distance - normal[1] * y) / normal[0], y, 0 * y])
        b = np.array([-normal[2] / normal[0], 0.0, 1.0])
        z = (WALL_M + bump_m * np.sin(7 * y) - offset - a @ facing) / (b @ facing)
        pixels = project(TRUTH.lens, a + z[:, None] * b)
        columns.append(pixels[:, 0] + rng.normal(0, 0.1, len(y)))
        rows.append(pixels[:, 1])
        angles.append(np.full(len(y), angle))
    return triangulate(
        geometry, np.concatenate(rows), np.concatenate(columns), 0.1, np.concatenate(angles)
    )


def toed_in(error_rad: float) -> ScannerGeometry:
    normal = np.array(TRUTH.plane_normal) + error_rad * tangents(TRUTH.plane_normal)[0]
    return replace(TRUTH, plane_normal=tuple(normal / np.linalg.norm(normal)))


def named(verdict: Verdict, words: str) -> Check:
    (check,) = (check for check in verdict.checks if words in check.name)
    return check


@pytest.mark.parametrize(
    ("value", "good", "usable", "grade"),
    [
        (1.0, 1.0, 2.0, Grade.GOOD),
        (1.5, 1.0, 2.0, Grade.USABLE),
        (2.5, 1.0, 2.0, Grade.BAD),
        (80.0, 75.0, 40.0, Grade.GOOD),
        (50.0, 75.0, 40.0, Grade.USABLE),
        (39.0, 75.0, 40.0, Grade.BAD),
        (float("nan"), 1.0, 2.0, Grade.BAD),
    ],
)
def test_a_number_is_graded_by_its_limits(value: float, good: float, usable: float, grade: Grade):
    """Both ways round; what is not a number is bad."""
    assert Check("number", value, "", good, usable, "advice").grade is grade


def test_a_verdict_is_as_good_as_its_worst_check_and_advises_only_where_needed():
    """Good checks carry no advice."""
    fine = Check("first", 1.0, " px", 2.0, 3.0, "do nothing")
    poor = Check("second", 9.0, " px", 2.0, 3.0, "do it again")
    verdict = Verdict((fine, poor))
    assert verdict.grade is Grade.BAD
    assert "do it again" in verdict.text and "do nothing" not in verdict.text
    assert "calibration is bad" in verdict.text
    assert Verdict((fine,)).grade is Grade.GOOD


def test_a_good_calibration_is_called_good():
    """All checks pass with the numbers of a careful calibration."""
    verdict = judge(calibration(GOOD_SIGMAS, GOOD_RESIDUALS))
    assert verdict.grade is Grade.GOOD, verdict.text


@pytest.mark.parametrize(
    ("residuals", "sigmas", "words", "advice"),
    [
        ({"corner_rms_px": 1.5}, {}, "corners", "flat, stiff board"),
        ({"rim_covered": 0.2}, {}, "rim", "poses at the edges and corners"),
        ({"tilt_spread_deg": 12.0}, {}, "between boards", "tilt the board"),
        ({"laser_rms_px": 2.0}, {}, "laser line on the boards", "matt board"),
        ({"laser_farthest_m": 1.0}, {}, "farthest board", "0.1 mrad .* is 59 mm there"),
        ({}, {"plane_toe_in": 1e-3}, "plane angle", "farther away"),
        ({}, {"axis_roll": 1e-3}, "direction", "turn the head further"),
        ({}, {"axis_sideways": 1e-3}, "place", "more motor angles"),
    ],
)
def test_each_weakness_makes_it_bad_and_is_named_with_a_remedy(
    residuals: dict, sigmas: dict, words: str, advice: str
):
    """One bad number is enough, and no other check is blamed."""
    verdict = judge(calibration({**GOOD_SIGMAS, **sigmas}, replace(GOOD_RESIDUALS, **residuals)))
    bad = [check for check in verdict.checks if check.grade is Grade.BAD]
    assert [words in check.name for check in bad] == [True]
    assert re.search(advice, bad[0].advice)


def test_a_wall_scanned_with_the_true_geometry_is_good():
    """Flat within its noise, unbent, and where it is."""
    verdict = verify(scan_wall(TRUTH), TRUTH, WALL_M)
    print(verdict.text)
    assert verdict.grade is Grade.GOOD
    assert named(verdict, "distance").value < 2.0


def test_a_toe_in_error_shows_in_the_walls_distance_and_is_named():
    """1 mrad is far off at 5 m; the words give the size of the error and the remedy."""
    for sign, word in ((1, "near"), (-1, "far")):
        wrong = toed_in(sign * 1e-3)
        verdict = verify(scan_wall(wrong), wrong, WALL_M)
        distance = named(verdict, "distance")
        assert verdict.grade is Grade.BAD
        assert f"too {word}, like a toe-in error of" in distance.advice
        mrad = float(distance.advice.split("toe-in error of ")[1].split()[0])
        assert mrad == pytest.approx(1.0, rel=0.3)  # of the right size; the slant is left out


def test_a_toe_in_error_bends_the_wall_even_without_a_known_distance():
    """3 mrad shows without a tape measure."""
    wrong = toed_in(3e-3)
    verdict = verify(scan_wall(wrong), wrong)
    assert named(verdict, "bend").grade is not Grade.GOOD
    assert len(verdict.checks) == 2


def test_a_rough_wall_is_seen():
    """Waves of 6 cm are no flat wall."""
    verdict = verify(scan_wall(TRUTH, bump_m=0.06), TRUTH)
    assert named(verdict, "roughness").grade is Grade.BAD


def test_what_is_no_wall_is_refused():
    """Few points, and points all around."""
    points = scan_wall(TRUTH)
    few = triangulate(TRUTH, [1200.0], [400.0], 0.1, 0.0)
    with pytest.raises(InputError, match="1 points on the wall, at least 200"):
        verify(few, TRUTH)
    rng = np.random.default_rng(0)
    cloud = replace(points, points_world=rng.normal(0, 1, points.points_world.shape))
    with pytest.raises(InputError, match="lie on no plane"):
        verify(cloud, TRUTH)
    with pytest.raises(InputError, match="wall_distance_m"):
        verify(points, TRUTH, -1.0)
