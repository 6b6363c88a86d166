"""Nonlinear least squares over blocks of residuals that each depend on a few parameters.

Levenberg-Marquardt with the damping of Nielsen (1999), on dense normal equations: a calibration
has a few hundred parameters at most. Derivatives are central differences, taken block by block.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from depthwarp.errors import InputError

__all__ = ["Block", "Solution", "shared_error_covariance", "solve"]

Float64Array = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.intp]

MAX_ITERATIONS = 60
STEP = 1e-6
"""Relative step of the central differences, near the cube root of the rounding of float64."""

SMALLEST_GAIN = 1e-8
"""The search ends when a step lowers the sum of squares by less than this share of it."""


@dataclass(frozen=True, eq=False)
class Block:
    """Residuals and the parameters that they depend on.

    Attributes:
        residual: From the block's own parameters, in the order of `index`, to its residuals,
            each divided by its standard deviation. May return NaN: such a step is not taken.
        index: Where these parameters stand in the whole vector.
    """

    residual: Callable[[Float64Array], Float64Array]
    index: IntArray


@dataclass(frozen=True, eq=False)
class Solution:
    """Result of `solve`.

    Attributes:
        parameters: Shape (P,).
        covariance: Shape (P, P), for residuals of unit variance; zero for held parameters.
        residuals: Of each block.
        redundancy: Number of residuals less number of free parameters.
    """

    parameters: Float64Array
    covariance: Float64Array
    residuals: tuple[Float64Array, ...]
    redundancy: int


def solve(blocks: Sequence[Block], start: Float64Array, free: npt.NDArray[np.bool_]) -> Solution:
    """Minimize the sum of squares of all residuals.

    Args:
        blocks: The residuals.
        start: First guess, shape (P,).
        free: Which parameters may move, shape (P,); the others are held.

    Raises:
        InputError: Residuals that are not finite at the start, fewer of them than free
            parameters, or free parameters that the residuals do not determine.
    """
    parameters = np.array(start, np.float64)
    residuals = _evaluate(blocks, parameters)
    cost = _cost(residuals)
    redundancy = sum(map(len, residuals)) - int(free.sum())
    if redundancy < 0:
        raise InputError(
            f"{sum(map(len, residuals))} measurements cannot determine {int(free.sum())} "
            "parameters: take more views"
        )
    if not np.isfinite(cost):
        raise InputError("the adjustment starts from values that explain no measurement")

    damping, growth = 1e-4, 2.0
    for _ in range(MAX_ITERATIONS):
        normal, gradient = _normal_equations(blocks, residuals, parameters, free)
        step = _damped_step(normal, gradient, damping)
        trial = parameters.copy()
        trial[free] -= step
        trial_residuals = _evaluate(blocks, trial)
        gain = cost - _cost(trial_residuals)
        if not gain > 0:  # also when it is NaN
            if abs(gain) <= SMALLEST_GAIN * cost:
                break
            damping, growth = damping * growth, 2 * growth
            continue
        parameters, residuals, cost = trial, trial_residuals, cost - gain
        damping, growth = max(damping / 3, 1e-12), 2.0
        if gain <= SMALLEST_GAIN * cost:
            break

    normal, _ = _normal_equations(blocks, residuals, parameters, free)
    covariance = np.zeros((len(parameters), len(parameters)))
    covariance[np.ix_(free, free)] = _inverse(normal)
    return Solution(parameters, covariance, residuals, redundancy)


def shared_error_covariance(
    blocks: Sequence[Block],
    patterns: Sequence[Float64Array],
    solution: Solution,
    free: npt.NDArray[np.bool_],
) -> Float64Array:
    """What errors that many residuals of a block have in common add to the covariance.

    The least squares take residuals for independent. Errors common to a block do not average out
    within it: they are carried to the parameters as they are.

    Args:
        blocks: Blocks of the solution.
        patterns: For each block one column for each independent error: by how much one standard
            deviation of it moves the residuals, shape (N, K).
        solution: Of `solve`.
        free: Which parameters may move, shape (P,).

    Returns:
        Shape (P, P); zero for held parameters.
    """
    total = np.zeros_like(solution.covariance)
    for block, pattern in zip(blocks, patterns, strict=True):
        moving = np.flatnonzero(free[block.index])
        pull = _jacobian(block, solution.parameters[block.index], moving).T @ pattern
        target = block.index[moving]
        total[np.ix_(target, target)] += pull @ pull.T
    return solution.covariance @ total @ solution.covariance


def _evaluate(blocks: Sequence[Block], parameters: Float64Array) -> tuple[Float64Array, ...]:
    return tuple(block.residual(parameters[block.index]) for block in blocks)


def _cost(residuals: Sequence[Float64Array]) -> float:
    return float(sum(residual @ residual for residual in residuals))


def _normal_equations(
    blocks: Sequence[Block],
    residuals: Sequence[Float64Array],
    parameters: Float64Array,
    free: npt.NDArray[np.bool_],
) -> tuple[Float64Array, Float64Array]:
    """J^T J and J^T r over the free parameters."""
    place = np.full(len(parameters), -1)
    place[free] = np.arange(int(free.sum()))
    normal = np.zeros((int(free.sum()),) * 2)
    gradient = np.zeros(len(normal))
    for block, residual in zip(blocks, residuals, strict=True):
        moving = np.flatnonzero(free[block.index])
        jacobian = _jacobian(block, parameters[block.index], moving)
        target = place[block.index[moving]]
        normal[np.ix_(target, target)] += jacobian.T @ jacobian
        gradient[target] += jacobian.T @ residual
    return normal, gradient


def _jacobian(block: Block, values: Float64Array, moving: IntArray) -> Float64Array:
    columns = []
    for index in moving:
        step = STEP * max(1.0, abs(values[index]))
        up, down = values.copy(), values.copy()
        up[index] += step
        down[index] -= step
        columns.append((block.residual(up) - block.residual(down)) / (up[index] - down[index]))
    return np.stack(columns, axis=1)


def _damped_step(normal: Float64Array, gradient: Float64Array, damping: float) -> Float64Array:
    """The step with each parameter damped in its own unit."""
    scale = _scale(normal)
    scaled = normal / np.outer(scale, scale) + damping * np.eye(len(normal))
    return np.asarray(np.linalg.solve(scaled, gradient / scale) / scale)


def _inverse(normal: Float64Array) -> Float64Array:
    """Inverse of the normal matrix, refused when some combination of parameters is not seen."""
    scale = _scale(normal)
    scaled = normal / np.outer(scale, scale)
    if np.linalg.cond(scaled) > 1e13:
        raise InputError(
            "the views do not determine all parameters: take them at more distances, tilts, places "
            "in the image and motor angles"
        )
    return np.linalg.inv(scaled) / np.outer(scale, scale)


def _scale(normal: Float64Array) -> Float64Array:
    diagonal = np.sqrt(np.diag(normal))
    return np.where(diagonal > 0, diagonal, 1.0)
