"""Inverses of radial functions: where they stop to grow, and which argument gives a value."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt

__all__ = ["first_positive_root", "invert_increasing"]

Float64Array = npt.NDArray[np.float64]

SAMPLES = 4097


def first_positive_root(polynomial: np.polynomial.Polynomial) -> float:
    """Smallest root above 0 of a polynomial that is positive at 0; infinite if there is none."""
    trimmed = polynomial.trim()
    if trimmed.degree() == 0:
        return float("inf")
    roots = trimmed.roots()
    real = roots.real[(np.abs(roots.imag) <= 1e-9 * np.abs(roots)) & (roots.real > 0)]
    return float(real.min()) if real.size else float("inf")


def invert_increasing(
    function: Callable[[Float64Array], Float64Array], values: Float64Array, most: float
) -> Float64Array:
    """Arguments from 0 to `most` at which an increasing function takes values, to about 1e-6.

    Values beyond the function's greatest give `most`: the caller checks what comes out.
    """
    arguments = np.linspace(0.0, most, SAMPLES)
    found: Float64Array = np.interp(values, function(arguments), arguments)
    return found
