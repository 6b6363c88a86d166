"""Keeping every operation in the caller's floating point type."""

from __future__ import annotations

from typing import Any

import numpy as np


def rounded(value: Any, dtype: Any) -> Any:
    """`value` rounded once to `dtype`; too large becomes infinite, as a cast on a device does."""
    with np.errstate(over="ignore"):
        return np.asarray(value, dtype=dtype)[()]


def common_dtype(*arrays: np.ndarray) -> np.dtype:
    """The one dtype of all `arrays`; a mixture would silently upcast, so it is refused."""
    dtypes = {np.asarray(array).dtype for array in arrays}
    if len(dtypes) != 1 or not dtypes <= {np.dtype(np.float32), np.dtype(np.float64)}:
        raise TypeError(
            f"arrays must all be float32 or all float64, got {sorted(map(str, dtypes))}"
        )
    return dtypes.pop()
