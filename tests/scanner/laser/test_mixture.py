"""Gaussian mixtures of colours and their fit by EM."""

from __future__ import annotations

import numpy as np
import pytest

from depthwarp.errors import InputError
from depthwarp.scanner.laser import GaussianMixture, fit_mixture
from depthwarp.scanner.laser.mixture import MIN_DEVIATION

MEANS = np.array([[40.0, 50.0, 60.0], [200.0, 190.0, 60.0], [90.0, 220.0, 100.0]])
SPREAD = np.array([[64.0, 20.0, 0.0], [20.0, 36.0, 8.0], [0.0, 8.0, 25.0]])
SHARES = np.array([0.5, 0.3, 0.2])


def drawn(count: int = 6000) -> np.ndarray:
    """Colours of the three Gaussians."""
    rng = np.random.default_rng(0)
    which = rng.choice(3, count, p=SHARES)
    return MEANS[which] + rng.multivariate_normal(np.zeros(3), SPREAD, count)


def test_recovers_the_mixture_that_made_the_colors() -> None:
    """Means within 1 level, shares within 2 %, covariances within 15 % of the true ones."""
    mixture = fit_mixture(drawn(), 3).mixture
    order = [int(np.argmin(np.linalg.norm(mixture.means - mean, axis=1))) for mean in MEANS]
    assert sorted(order) == [0, 1, 2]
    np.testing.assert_allclose(mixture.means[order], MEANS, atol=1.0)
    np.testing.assert_allclose(mixture.weights[order], SHARES, atol=0.02)
    np.testing.assert_allclose(mixture.covariances[order], [SPREAD] * 3, atol=0.15 * 64)


@pytest.mark.parametrize("components", [1, 2, 3, 5, 8])
def test_likelihood_never_falls(components: int) -> None:
    """Each step of EM makes the colours at least as likely, also with floored covariances."""
    rng = np.random.default_rng(components)
    colors = np.concatenate([drawn(1500), np.full((300, 3), 255.0), rng.uniform(0, 255, (200, 3))])
    rising = np.array(fit_mixture(colors, components, seed=components).log_likelihoods)
    assert len(rising) > 1
    assert np.diff(rising).min() >= -1e-9


def test_same_seed_same_mixture() -> None:
    """A fit is deterministic: same colours, same seed, same bits; another seed may differ."""
    colors = drawn(1000)
    first, again = fit_mixture(colors, 4, seed=7).mixture, fit_mixture(colors, 4, seed=7).mixture
    np.testing.assert_array_equal(first.means, again.means)
    np.testing.assert_array_equal(first.covariances, again.covariances)


@pytest.mark.parametrize("components", [1, 3])
def test_equal_colors_do_not_collapse(components: int) -> None:
    """All colours alike: every component keeps the least deviation, nothing divides by zero."""
    mixture = fit_mixture(np.full((50, 3), 17.0), components).mixture
    eigenvalues = np.linalg.eigvalsh(mixture.covariances)
    np.testing.assert_allclose(eigenvalues, MIN_DEVIATION**2)
    assert np.isfinite(mixture.log_density(np.full(3, 17.0)))


def test_density_is_that_of_the_formula() -> None:
    """The log density equals the sum of normal densities written out, and integrates to 1."""
    mixture = GaussianMixture(SHARES, MEANS, np.stack([SPREAD, 2 * SPREAD, 3 * SPREAD]))
    colors = np.random.default_rng(1).uniform(0, 255, (40, 3))
    expected = np.zeros(40)
    for share, mean, covariance in zip(
        mixture.weights, mixture.means, mixture.covariances, strict=True
    ):
        offset = colors - mean
        distance = np.einsum("ni,ij,nj->n", offset, np.linalg.inv(covariance), offset)
        scale = share / np.sqrt((2 * np.pi) ** 3 * np.linalg.det(covariance))
        expected += scale * np.exp(-0.5 * distance)
    np.testing.assert_allclose(np.exp(mixture.log_density(colors)), expected, rtol=1e-10, atol=0)
    far = mixture.log_density(np.array([1e4, -1e4, 1e4]))
    assert np.isfinite(far) and far < -1e5


@pytest.mark.parametrize(
    ("colors", "components", "words"),
    [
        (np.zeros((11, 3)), 3, "at least 12 colours"),
        (np.zeros((50, 3)), 0, "mixture of 0"),
        (np.zeros((50, 2)), 3, r"shape \(N, 3\)"),
        (np.full((50, 3), np.nan), 3, "finite"),
    ],
)
def test_refuses_colors_that_cannot_be_fitted(
    colors: np.ndarray, components: int, words: str
) -> None:
    """Too few colours, wrong shapes and NaN are refused with what was expected."""
    with pytest.raises(InputError, match=words):
        fit_mixture(colors, components)


@pytest.mark.parametrize(
    ("weights", "covariance", "words"),
    [
        ([0.7, 0.7], np.eye(3), "sum 1"),
        ([1.5, -0.5], np.eye(3), "above 0"),
        ([0.5, 0.5], -np.eye(3), "positive definite"),
        ([0.5, 0.5], np.triu(np.ones((3, 3))), "symmetric"),
        ([0.5, np.nan], np.eye(3), "finite"),
    ],
)
def test_refuses_what_is_no_mixture(
    weights: list[float], covariance: np.ndarray, words: str
) -> None:
    """Shares that are none and covariances that are none are refused."""
    with pytest.raises(InputError, match=words):
        GaussianMixture(np.array(weights), np.zeros((2, 3)), np.stack([covariance] * 2))
