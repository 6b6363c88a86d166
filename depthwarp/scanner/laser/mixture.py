"""Gaussian mixtures of colours, fitted by expectation maximization (EM)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError

__all__ = ["MIN_DEVIATION", "GaussianMixture", "MixtureFit", "fit_mixture"]

MIN_DEVIATION = 1.0
"""Least standard deviation of a component along any axis [grey levels]: colours are rounded to
whole levels, so nothing narrower can be told from them, and no component collapses on one."""

MAX_STEPS = 200
TOLERANCE = 1e-5  # of the mean log-likelihood a step
LLOYD_STEPS = 5  # of k-means, after the seeding

Colors = npt.NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GaussianMixture:
    """A density of colours: K Gaussians with full covariances.

    Attributes:
        weights: Shape (K,), above 0, sum 1.
        means: Shape (K, 3), blue, green, red [grey levels of 255].
        covariances: Shape (K, 3, 3), symmetric and positive definite [grey levels squared].

    Raises:
        InputError: Shapes that do not fit, weights that are no shares, or a covariance that is
            not positive definite.
    """

    weights: npt.NDArray[np.float64]
    means: npt.NDArray[np.float64]
    covariances: npt.NDArray[np.float64]

    def __post_init__(self) -> None:
        for name, tail in (("weights", ()), ("means", (3,)), ("covariances", (3, 3))):
            values = np.array(getattr(self, name), dtype=np.float64)
            if values.shape != (len(self.weights), *tail) or not np.isfinite(values).all():
                raise InputError(
                    f"{name} of a mixture of {len(self.weights)} must be finite, of shape "
                    f"{(len(self.weights), *tail)}, got shape {values.shape}"
                )
            values.flags.writeable = False
            object.__setattr__(self, name, values)
        if not ((self.weights > 0).all() and abs(float(self.weights.sum()) - 1.0) < 1e-6):
            raise InputError(f"weights of a mixture must be above 0 with sum 1, got {self.weights}")
        symmetric = np.allclose(self.covariances, self.covariances.transpose(0, 2, 1))
        if not symmetric or np.linalg.eigvalsh(self.covariances).min() <= 0:
            raise InputError("covariances of a mixture must be symmetric and positive definite")

    def log_density(self, colors: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """Logarithm of the density at colours of shape (..., 3); the result has shape (...)."""
        values = np.asarray(colors, dtype=np.float64)
        joint = self._log_joint(values.reshape(-1, 3))
        return _log_sum_exp(joint).reshape(values.shape[:-1])

    def _log_joint(self, colors: Colors) -> Colors:
        """log(weight * density), one row a component: shape (K, N)."""
        rows = np.empty((len(self.weights), len(colors)))
        for k, (weight, mean, covariance) in enumerate(
            zip(self.weights, self.means, self.covariances, strict=True)
        ):
            root = np.linalg.cholesky(covariance)
            whitened = np.linalg.inv(root) @ (colors - mean).T
            log_scale = np.log(weight) - np.log(np.diag(root)).sum() - 1.5 * np.log(2 * np.pi)
            rows[k] = log_scale - 0.5 * np.einsum("cn,cn->n", whitened, whitened)
        return rows


@dataclass(frozen=True, eq=False)
class MixtureFit:
    """What `fit_mixture` found.

    Attributes:
        mixture: The density.
        log_likelihoods: Mean log-likelihood of a colour before each step and after the last one;
            it never falls.
    """

    mixture: GaussianMixture
    log_likelihoods: tuple[float, ...]


def fit_mixture(colors: npt.ArrayLike, components: int, seed: int = 0) -> MixtureFit:
    """Fit a mixture by EM (Dempster, Laird, Rubin 1977), seeded by k-means++.

    Eigenvalues of a covariance are held at `MIN_DEVIATION`^2 or above. That is the maximum of
    the step under this constraint, so the likelihood still never falls. The same colours and the
    same seed give the same mixture.

    Args:
        colors: Shape (N, 3) [grey levels of 255].
        components: Number of Gaussians K.
        seed: Of the random choice of the first means.

    Raises:
        InputError: Fewer than 4 colours a component, a wrong shape, or values that are not finite.
    """
    values = np.asarray(colors, dtype=np.float64)
    if values.ndim != 2 or values.shape[1] != 3 or not np.isfinite(values).all():
        raise InputError(f"colors must be finite, of shape (N, 3), got shape {values.shape}")
    if components < 1 or len(values) < 4 * components:
        raise InputError(
            f"a mixture of {components} needs at least {4 * max(components, 1)} colours, got "
            f"{len(values)}: mark more pixels"
        )
    nearest = _k_means(values, components, np.random.default_rng(seed))
    mixture = _maximize(values, np.eye(components)[nearest].T)
    log_likelihoods: list[float] = []
    for _ in range(MAX_STEPS):
        joint = mixture._log_joint(values)
        log_densities = _log_sum_exp(joint)
        log_likelihoods.append(float(log_densities.mean()))
        if len(log_likelihoods) > 1 and log_likelihoods[-1] - log_likelihoods[-2] < TOLERANCE:
            break
        mixture = _maximize(values, np.exp(joint - log_densities))
    return MixtureFit(mixture, tuple(log_likelihoods))


def _k_means(colors: Colors, components: int, rng: np.random.Generator) -> npt.NDArray[np.intp]:
    """Index of the nearest mean, from k-means++ seeds (Arthur, Vassilvitskii 2007)."""
    means = colors[[rng.integers(len(colors))]]
    while len(means) < components:
        distances = _squared_distances(colors, means).min(axis=0)
        total = float(distances.sum())
        # Fewer different colours than components: the rest start anywhere.
        chances = distances / total if total > 0 else None
        means = np.vstack([means, colors[rng.choice(len(colors), p=chances)]])
    nearest = _squared_distances(colors, means).argmin(axis=0)
    for _ in range(LLOYD_STEPS):
        for k in range(components):
            if (nearest == k).any():
                means[k] = colors[nearest == k].mean(axis=0)
        nearest = _squared_distances(colors, means).argmin(axis=0)
    return np.asarray(nearest)


def _squared_distances(colors: Colors, means: Colors) -> Colors:
    """Shape (K, N)."""
    return np.stack([((colors - mean) ** 2).sum(axis=1) for mean in means])


def _maximize(colors: Colors, shares: Colors) -> GaussianMixture:
    """Weights, means and covariances that maximize the likelihood under shares of (K, N)."""
    totals = shares.sum(axis=1)
    # A component that nothing belongs to keeps a trace of everything, not a division by zero.
    empty = totals < 1e-6
    shares = np.where(empty[:, None], 1e-6 / len(colors), shares)
    totals = shares.sum(axis=1)
    means = (shares @ colors) / totals[:, None]
    covariances = np.empty((len(means), 3, 3))
    for k, mean in enumerate(means):
        offsets = colors - mean
        covariances[k] = _at_least((shares[k] * offsets.T) @ offsets / totals[k])
    return GaussianMixture(totals / totals.sum(), means, covariances)


def _at_least(covariance: Colors) -> Colors:
    """The covariance with its eigenvalues raised to the least variance."""
    variances, axes = np.linalg.eigh((covariance + covariance.T) / 2)
    floored = np.maximum(variances, MIN_DEVIATION**2)
    raised = (axes * floored) @ axes.T
    return np.asarray((raised + raised.T) / 2)


def _log_sum_exp(rows: Colors) -> Colors:
    """log(sum(exp(rows))) over the first axis, without overflow."""
    highest = rows.max(axis=0)
    return np.asarray(highest + np.log(np.exp(rows - highest).sum(axis=0)))
