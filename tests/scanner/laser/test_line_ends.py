"""Which points lie beside the end of a line."""

from __future__ import annotations

import numpy as np
import pytest

from depthwarp.scanner.laser.line_ends import is_beside_end

ROWS = np.arange(100, 160, dtype=np.int32)
SIGMA = np.full(len(ROWS), 0.03)


def line(slope: float = 0.4) -> np.ndarray:
    """A straight line with half the noise that its sigma states."""
    return 50.0 + slope * (ROWS - 100) + np.random.default_rng(0).normal(0.0, 0.015, len(ROWS))


def marked(columns: np.ndarray, sigma: np.ndarray = SIGMA, rows: np.ndarray = ROWS) -> list[int]:
    return np.flatnonzero(is_beside_end(rows, columns, sigma)).tolist()


@pytest.mark.parametrize("slope", [-0.9, 0.0, 0.4, 1.2])
def test_a_straight_line_keeps_its_ends(slope: float) -> None:
    """Noise alone, and missing rows, mark nothing, whatever the slope."""
    assert marked(line(slope)) == []
    some = np.delete(np.arange(len(ROWS)), [2, 3, 7, 30, 31, 55])
    assert marked(line(slope)[some], SIGMA[some], ROWS[some]) == []


def test_ends_that_bend_away_are_marked_from_the_innermost_point() -> None:
    """Also a point that happens to lie on the line, if one further in does not."""
    columns = line()
    columns[[1, 2]] -= [1.5, 0.8]
    columns[-1] += 2.0
    assert marked(columns) == [0, 1, 2, 59]


def test_both_sides_of_a_jump_are_ends() -> None:
    """Where the line jumps, sideways or by missing rows, the blended rows go."""
    columns = line()
    columns[30:] += 20.0
    columns[[29, 30]] += [1.0, -1.5]
    assert marked(columns) == [29, 30]
    away = ROWS.copy()
    away[30:] += 10
    columns = line() + 0.4 * (away - ROWS)
    columns[29] += 1.0
    assert marked(columns, rows=away) == [29]


def test_a_bend_within_its_own_sigma_stays() -> None:
    """A weak row that says that it is doubtful is not marked."""
    columns, sigma = line(), SIGMA.copy()
    columns[0] += 1.0
    sigma[0] = 0.4
    assert marked(columns) == [0]
    assert marked(columns, sigma) == []


def test_short_stretches_and_nothing_at_all_are_left_alone() -> None:
    """Where there is no line to go on from, nothing is known about its end."""
    columns = line()
    columns[0] += 3.0
    assert marked(columns[:15], SIGMA[:15], ROWS[:15]) == []
    assert marked(columns[:16], SIGMA[:16], ROWS[:16]) == [0]
    assert marked(columns[:0], SIGMA[:0], ROWS[:0]) == []
