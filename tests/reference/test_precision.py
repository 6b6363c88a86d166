"""The rounding of the references: one floating point type, no mixture."""

from __future__ import annotations

import numpy as np
import pytest

from tests.reference import (
    precision,
)


def test_mixed_dtypes_are_refused():
    with pytest.raises(TypeError, match="float32"):
        precision.common_dtype(np.zeros(1, np.float32), np.zeros(1, np.float64))


def test_rounding_is_to_nearest_even_and_overflow_is_infinite():
    assert precision.rounded(1.0 + 2.0**-24, np.float32) == 1.0
    assert precision.rounded(1e300, np.float32) == np.inf
    assert precision.rounded([0.1, 0.2], np.float32).dtype == np.float32
