"""The solver: known minima, covariance, held parameters, and refusals."""

from __future__ import annotations

import numpy as np
import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.calibration.least_squares import Block, shared_error_covariance, solve

X = np.linspace(0.0, 2.0, 40)


def decay(noise: np.ndarray, sigma: float) -> Block:
    """y = a exp(-b x) + c, measured with noise."""
    measured = 3.0 * np.exp(-1.5 * X) + 0.5 + noise

    def residual(values: np.ndarray) -> np.ndarray:
        a, b, c = values
        return (a * np.exp(-b * X) + c - measured) / sigma

    return Block(residual, np.arange(3))


def test_a_nonlinear_fit_finds_the_truth_from_afar():
    """Without noise the minimum is the truth."""
    found = solve([decay(np.zeros(40), 1.0)], np.array([1.0, 0.1, 0.0]), np.ones(3, bool))
    np.testing.assert_allclose(found.parameters, [3.0, 1.5, 0.5], atol=1e-6)
    assert found.redundancy == 37


def test_a_valley_that_needs_damping_is_followed():
    """Rosenbrock's valley from the classic start."""

    def residual(values: np.ndarray) -> np.ndarray:
        x, y = values
        return np.array([10 * (y - x * x), 1 - x])

    found = solve([Block(residual, np.arange(2))], np.array([-1.2, 1.0]), np.ones(2, bool))
    np.testing.assert_allclose(found.parameters, [1.0, 1.0], atol=1e-4)


def test_covariance_is_what_repetition_shows():
    """The stated sigmas are the spread of the fits of 300 noisy measurements."""
    rng = np.random.default_rng(0)
    fits = [
        solve([decay(rng.normal(0, 0.01, 40), 0.01)], np.array([3.0, 1.5, 0.5]), np.ones(3, bool))
        for _ in range(300)
    ]
    measured = np.std([fit.parameters for fit in fits], axis=0)
    np.testing.assert_allclose(np.sqrt(np.diag(fits[0].covariance)), measured, rtol=0.15)


def test_blocks_share_parameters_and_held_ones_do_not_move():
    """Two blocks over overlapping parameters; a held one keeps its value and has no variance."""
    blocks = [
        Block(lambda values: np.array([values[0] - 1.0, values[1] - values[0]]), np.array([0, 2])),
        Block(lambda values: np.array([values[0] + values[1] - 5.0]), np.array([1, 2])),
    ]
    free = np.array([True, False, True])
    found = solve(blocks, np.array([0.0, 3.0, 0.0]), free)
    # x0 = 1 and x2 = x0 and x2 = 2 at once: least squares gives 4/3 and 5/3.
    np.testing.assert_allclose(found.parameters, [4 / 3, 3.0, 5 / 3], atol=1e-6)
    assert (found.covariance[1] == 0).all()


def test_shared_errors_add_what_repetition_shows():
    """Two blocks with errors in common within each, one parameter held: 2000 fits say the same."""
    truth, free = np.array([1.0, -0.5, 2.0, 0.7]), np.array([True, True, True, False])
    x = np.linspace(-1.0, 2.0, 15)
    indices = np.array([0, 1, 3]), np.array([1, 2])
    patterns = [np.column_stack([np.full(15, 3.0), 2.0 * x]), 1.5 * x[:, None] ** 2]

    def blocks(errors: list[np.ndarray]) -> list[Block]:
        def first(values: np.ndarray) -> np.ndarray:
            return values[0] + values[1] * x + values[2] * x**2 - measured[0]

        def second(values: np.ndarray) -> np.ndarray:
            return np.exp(values[0] * x) + values[1] * x - measured[1]

        measured = (
            truth[0] + truth[1] * x + truth[3] * x**2 + errors[0],
            np.exp(truth[1] * x) + truth[2] * x + errors[1],
        )
        return [Block(first, indices[0]), Block(second, indices[1])]

    scale = 1e-3  # small, so that the fit is linear in the errors
    rng = np.random.default_rng(0)
    exact = blocks([np.zeros(15)] * 2)
    solution = solve(exact, truth, free)
    added = shared_error_covariance(exact, patterns, solution, free)
    fits = np.array(
        [
            solve(
                blocks(
                    [scale * pattern @ rng.normal(size=pattern.shape[1]) for pattern in patterns]
                ),
                truth,
                free,
            ).parameters
            for _ in range(2000)
        ]
    )
    repeated = np.cov(fits[:, free].T) / scale**2
    stated = added[np.ix_(free, free)]
    sigmas = np.sqrt(np.diag(repeated))
    np.testing.assert_allclose(np.sqrt(np.diag(stated)), sigmas, rtol=0.06)
    np.testing.assert_allclose(
        stated / np.outer(sigmas, sigmas), np.corrcoef(fits[:, free].T), atol=0.1
    )
    assert (added[3] == 0).all() and (added[:, 3] == 0).all()
    alone = np.sqrt(np.diag(solution.covariance))[:3]
    assert (sigmas > 1.5 * alone).all()  # independent errors of unit variance would promise less


def test_steps_into_values_without_meaning_are_not_taken():
    """A residual that is NaN beyond a border turns the search back."""

    def residual(values: np.ndarray) -> np.ndarray:
        with np.errstate(invalid="ignore"):
            return np.sqrt(values) - np.array([0.1])

    found = solve([Block(residual, np.arange(1))], np.array([4.0]), np.ones(1, bool))
    assert found.parameters[0] == pytest.approx(0.01, abs=1e-6)


def test_what_cannot_be_solved_is_refused():
    """Too few residuals, a start without meaning, and parameters that nothing depends on."""
    block = Block(lambda values: values[:1] - 1.0, np.arange(2))
    with pytest.raises(InputError, match="1 measurements cannot determine 2 parameters"):
        solve([block], np.zeros(2), np.ones(2, bool))
    with pytest.raises(InputError, match="do not determine all parameters"):
        solve([block, block], np.zeros(2), np.ones(2, bool))
    nothing = Block(lambda values: values * np.nan, np.arange(1))
    with pytest.raises(InputError, match="explain no measurement"):
        solve([nothing], np.zeros(1), np.ones(1, bool))
